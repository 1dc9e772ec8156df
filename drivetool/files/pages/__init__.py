"""Takes a diagnosis and the files about it, and gives one HTML page that needs nothing else.

Every page is made from a template in the folder beside; the style of pages is shared.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
