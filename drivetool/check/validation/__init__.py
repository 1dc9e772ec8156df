"""Validates a drive on records that its fit has not seen.

Simulation, required torque and coast-downs are tested; the result is a validation with its findings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
