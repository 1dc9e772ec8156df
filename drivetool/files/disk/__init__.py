"""Takes paths and bytes.

Files are written whole or not at all; a folder on the command line becomes the recordings in it. It knows nothing
of what is in a file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
