from .parquet import natural as natural, read_parquet as read_parquet
