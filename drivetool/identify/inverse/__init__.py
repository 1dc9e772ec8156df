"""The grey box by inverse dynamics.

Experiments, a drive and options come in. An estimate by the torque that the motion requires, and the laws that the
drive lacks, go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
