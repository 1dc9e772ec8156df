"""The channel map says which channel plays which role and what its numbers mean.

Names of channels go in, and those to read come out; a recording goes in, and signals in SI come out. The protocol
of a reader is defined here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
