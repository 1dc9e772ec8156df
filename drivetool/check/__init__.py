"""Takes records and a fitted drive, and says which law the drive lacks.

It returns a diagnosis. Its wings build upon one another: fit, starts, causes, heldout, search, verdict.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
