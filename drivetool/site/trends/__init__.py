"""Takes the rows of a summary and gives means, drifts, steps and outlying recordings per parameter and machine.

It also makes the trends file and its pictures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
