"""A recording and a channel map come in.

An experiment goes out: in SI, uniform, immutable, or a refusal in a sentence. The contents of a log, channel by
channel, are reported here too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
