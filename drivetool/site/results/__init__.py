"""What came of the tasks: the manifest of what was done, what each file tells, and the summary as rows, CSV and
Parquet.

It reads files of steps and decides nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
