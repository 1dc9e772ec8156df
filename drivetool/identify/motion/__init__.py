"""Inverse dynamics without a fit: smoothed motion, required torque, filtered equations, instruments, the linear
estimate.

Experiments and a drive come in. Equations and their solution go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
