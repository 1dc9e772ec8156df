"""Takes files in their shapes and prints them as tables of 80 columns for a person.

The catalogues of effects and of finding codes have their tables here too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
