"""Takes the rows of a summary and gives means, drifts, steps and outlying recordings of each parameter of each
machine.

The trends file and its pictures are made here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
