"""Messages of a topic come in, encoded as JSON, Protobuf, or ROS 1 or 2.

The fields that hold numbers go out, with their units, and columns of these numbers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
