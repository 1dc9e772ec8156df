"""What a fit says of the channels it used: suspect signs and units, single wrong samples, a torque logged late,
roles that are unused, feedback.

A task or outcome comes in. Findings, or samples to leave out, go out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
