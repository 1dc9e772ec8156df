"""A tuned loop around the whole drive, gaps and friction included, comes in.

Its motion goes out: whether it hunts after a kick, and what it would have done on a record.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
