"""Compiles the sources of the kernel and gives the addresses of its machine code.

The kernel is compiled once, stored in a folder safe from other users, and loaded without the compiler. All use of
Numba's internals is here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
