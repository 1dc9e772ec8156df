"""The step backlash.

Experiments that open the gap, a drive and options come in. The half gap and the other free parameters go out as an
Estimate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
