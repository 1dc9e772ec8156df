"""Mass and friction from intervals of constant torque, on one road or on both directions of it.

Experiments and options come in. An Estimate goes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
