"""Starts of a fit: multi-start search, rigid-body regression, continuation in process noise, cross-entropy search,
partial records, a grid over the stiffness.

A task comes in. Points to fit from go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
