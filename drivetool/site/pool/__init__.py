"""Takes tasks and limits, and does them in worker processes of this machine or of a Dask cluster.

A function that is handed in does the steps. Answers come out as they end.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
