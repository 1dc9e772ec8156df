"""Takes a base, the catalogue and split samples, and looks for sets of causes.

It hands over what was found, what rivals it, and the models that a verdict is about.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
