"""Takes exhibits and gives pictures: PNG files for a folder, SVG for a page.

Equal input gives equal bytes. A picture that knows how it is drawn draws itself.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
