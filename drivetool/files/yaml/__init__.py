"""Takes YAML text and gives checked files: parameters, channel map, units.

What is wrong becomes one sentence. It also writes plain values as YAML or JSON, the same bytes for the same value.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
