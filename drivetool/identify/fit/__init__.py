"""The fit that greybox, backlash and blackbox share.

A task comes in. An outcome by innovations or by simulation, sums of friction and their parts, and the contact in a
gap go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
