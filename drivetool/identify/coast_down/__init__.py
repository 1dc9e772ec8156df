"""A drive that coasts down without torque.

Experiments and options come in. Friction over inertia, and both where a scale is known, go out as an Estimate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
