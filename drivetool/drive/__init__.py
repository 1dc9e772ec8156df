"""The physical model: a drive as a chain of bodies and shafts with values.

It is assembled into equations with derivatives over its parameters, or linearised. This package reads no file and
fits nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
