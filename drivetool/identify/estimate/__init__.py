"""What every estimator returns.

A solution of the least squares comes in. Lines of a table with interval and status, covariance, pictures and
derived figures go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
