"""The types of all files as they are on disk, with unit and meaning in the field.

JSON Schemas are made from them. No file is read or written with them here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
