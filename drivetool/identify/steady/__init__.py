"""The step steady: constant speeds, constant torques, or coast-downs.

Experiments and options come in. An Estimate of friction, and of what else the method identifies, goes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
