"""Simulates a tuned loop around the whole drive with gaps and friction.

The results are limit cycles after a kick, and the response to the load torque of a record.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
