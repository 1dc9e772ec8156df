"""The catalogue of causes of a diagnosis, one file per cause.

A cause takes a fitted base and gives starts, bounds and reasons. The search passes in the functions that fit it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
