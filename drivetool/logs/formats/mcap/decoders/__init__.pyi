from .layout import Broken as Broken
from .topics import ENCODINGS as ENCODINGS, Fields as Fields, open_topic as open_topic
