"""One file per command: its help as docstring, an example, its options, and a function that opens, calls, delivers.

Only the command line imports them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
