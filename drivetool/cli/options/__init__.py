"""Takes words of options and gives values: a job, opened recordings and parameter files, the drive with what was
set.

Everything is checked before anything runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
