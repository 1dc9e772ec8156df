from .messages import Topic as Topic
from .places import Places as Places
from .source import Source as Source
