"""Forward selection of causes, from a base model, the catalogue and split samples.

It returns the selected causes, their rivals, and the models that the verdict is about.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
