"""Diagnosis where the motion is imposed: the torque that it asks for is the judge.

It takes the same options and returns the same diagnosis as the search by simulation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
