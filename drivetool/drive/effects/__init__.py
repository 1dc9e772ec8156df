"""The catalogue of physical effects, one file each.

An effect declares its parameters, its law, its source and the data that identifies it. It stamps its law into the
assembled equations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
