"""Takes a drive with free parameters, its records and a mask of the samples that count.

It gives a fitted model with its likelihood, and what that model leaves over. It knows no causes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
