"""A path to a log comes in, and a recording with its digest goes out.

The suffix chooses the reader. Start and metadata of a recording, and the summary of a site, are read here as well.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
