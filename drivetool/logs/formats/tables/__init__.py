"""A Parquet file, or a folder of its parts, comes in, with a column per channel or a row per value.

A recording goes out; its findings report the damage.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
