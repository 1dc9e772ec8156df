"""The step steady: constant speeds, constant torques, or run-downs.

Experiments and options come in. An Estimate of friction, and what else the method tells, goes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
