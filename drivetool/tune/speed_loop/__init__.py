"""A drive comes in and becomes, at its working point, a linear speed loop that is affine in the settings.

Its sensitivity, its margins and its step responses go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
