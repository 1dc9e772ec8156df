"""Identification from a measured shaft torque: each side, the gap by its dead stretches, the law of the gap.

Experiments with that channel come in. Estimates of both sides go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
