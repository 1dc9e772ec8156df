"""Diagnosis: from records and a fitted drive to the law that the drive lacks.

Its packages build upon one another: fit, starts, causes, heldout, search, verdict.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
