from .messages import Topic as Topic
from .offsets import Offsets as Offsets
from .source import McapSource as McapSource
