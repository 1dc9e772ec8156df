"""The least-squares problem and its solver.

Traces, free parameters with bounds and residuals come in. A point with its normal equations goes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
