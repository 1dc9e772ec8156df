"""The results of the tasks: the manifest of the tasks, the content of each file, and the summary as rows, CSV and
Parquet.

It reads the files of steps and makes no decisions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
