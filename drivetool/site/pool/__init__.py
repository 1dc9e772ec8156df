"""Takes tasks and limits, and runs them in worker processes of this machine or of a Dask cluster.

A function that is passed in runs the steps. Answers are returned as the tasks end.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
