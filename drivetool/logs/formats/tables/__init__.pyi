from .parquet import read_parquet as read_parquet
