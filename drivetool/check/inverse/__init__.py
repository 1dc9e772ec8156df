"""Diagnosis where the motion is imposed: by the error of the required torque (inverse dynamics).

It takes the same options and returns the same diagnosis as the search by simulation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
