"""The bytes of an MCAP file come in.

Its topics go out, with their messages block by block. Broken records are skipped and reported.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
