"""The named tuples of arrays that compiled code works on: the system, its laws, a pass over a record and the cache.

They are packed here into one pointer, so that a call stays short.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
