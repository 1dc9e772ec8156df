"""Values of one signal come in, with their stamps where needed.

Spikes, wrapped counters, samples that no sensor measured, and speeds that disagree with angles go out, as repaired
values or findings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
