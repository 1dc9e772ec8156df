"""One file per command: its help, its example, its options, and a function that opens, calls and delivers.

Only the command line imports them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
