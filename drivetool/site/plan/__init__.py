"""Takes a site file and the recordings that it names, and says what is to be done.

Tasks come out in an order in which they can be done, with what has changed since the last run.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
