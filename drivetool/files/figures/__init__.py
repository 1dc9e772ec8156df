"""Takes plot data and gives pictures: PNG files for a folder, SVG for a page.

Equal input gives equal bytes. Plot data with a method `figure` draw themselves.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
