"""Takes models and samples that they were not fitted to.

It gives scores, gains and evidence, and free runs over blocks of data held out. It also tells whether records held
out differ.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
