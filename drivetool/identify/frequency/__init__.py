"""Frequency responses and fits to them.

Experiments come in. A spectrum with variance and coherence, or an estimate fitted to it, goes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
