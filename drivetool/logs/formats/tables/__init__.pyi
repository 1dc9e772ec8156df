from .parquet import natural_order as natural_order, read_parquet as read_parquet
