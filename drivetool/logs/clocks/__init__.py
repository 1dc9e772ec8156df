"""Time stamps and signals on their own clocks come in.

Stamps in order, the rate of each stretch, and signals on one uniform grid go out. What was lost, late or resampled
is reported in findings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
