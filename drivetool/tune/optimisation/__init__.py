"""A loop, a criterion and limits come in.

The best settings go out, and how far they still hold for drives drawn from the covariance or varied one parameter
at a time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
