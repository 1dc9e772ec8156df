"""An MCAP file comes in, whole or cut short.

A recording with one clock per topic goes out. The container gives its messages, and the decoders their numbers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
