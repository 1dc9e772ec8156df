"""Intervals of constant speed.

An experiment comes in. Steady points with their uncertainty, the friction line through them and its report go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
