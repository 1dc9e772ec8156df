from .layout import BrokenMessage as BrokenMessage
from .topics import ENCODINGS as ENCODINGS, Fields as Fields, open_topic as open_topic
