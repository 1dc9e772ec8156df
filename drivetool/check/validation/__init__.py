"""Takes a drive and records that its fit has not seen, and checks whether the drive is true.

Simulation, required torque and run-downs are judged; a validation with its remarks comes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
