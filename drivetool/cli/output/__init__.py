"""Takes a finished file and its plot data and delivers them: on disk, on standard output, as table or picture.

Outcomes become exit codes and errors become sentences here alone.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
