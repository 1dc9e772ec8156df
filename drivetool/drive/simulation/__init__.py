"""A drive and a layout come in, and a plant goes out.

It takes the inputs of a record and gives outputs, residuals, sensitivities or a filtered record, by calls of the
kernel.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
