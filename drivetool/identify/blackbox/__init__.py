"""The step blackbox.

Experiments that keep the gap closed come in. Start values of inertias, stiffness and damping go out as an Estimate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
