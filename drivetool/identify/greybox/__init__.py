"""The step greybox.

Experiments, a drive with start values and options come in. The physical parameters go out as an Estimate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
