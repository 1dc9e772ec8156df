"""An experiment and the requested steps come in.

The experiment after these steps goes out, each with a finding. The parts to keep or omit are cut here too,
before any check.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
