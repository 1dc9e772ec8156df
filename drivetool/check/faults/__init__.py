"""Takes records, and a model where one is needed, and finds faults of the record itself.

Outliers, resolution, delays, signs and scales of channels come out as faults, with mended records.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
