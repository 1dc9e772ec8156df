"""A recording and a channel map come in.

An experiment goes out: in SI, uniform, immutable, or a refusal in a sentence. What a log holds, channel by channel,
is told here too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
