"""The grey box by inverse dynamics.

Experiments, a drive and options come in. An estimate of what the motion asks of the torque, and the laws it lacks,
go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
