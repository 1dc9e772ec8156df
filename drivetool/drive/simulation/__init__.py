"""Makes a plant of a drive and a layout.

The plant calls the kernel with the inputs of a record and returns outputs, residuals, sensitivities or a filtered
record.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
