"""The catalogue of what a diagnosis looks for, one file per cause.

A cause takes a fitted base and gives starts, bounds and reasons. What fits it is handed in by the search.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
