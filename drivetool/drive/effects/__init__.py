"""The catalogue of physical effects, one file each.

An effect says its parameters, its law, its source and what shows it. It stamps its law into the equations that are
assembled.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
