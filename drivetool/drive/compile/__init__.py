"""The sources of the kernel come in, and addresses of its machine code go out.

It is compiled once, kept in a folder safe from others, and loaded without the compiler. All use of Numba's inner
parts is here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
