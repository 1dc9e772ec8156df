"""An identified drive, its covariance and what is asked of the loop come in.

Gains go out, with criterion, margins, their spread, remarks, and the values that pictures show.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
