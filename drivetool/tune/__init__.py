"""Takes an identified drive, its covariance and the requirements on the loop.

Gives gains with criterion, margins, their spread, remarks, and the data of the pictures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
