"""The physics we believe: a drive as a chain of bodies and shafts with values.

It is assembled into equations with derivatives over its parameters, or linearised. No file is read here, and
nothing is fitted.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
