from .look import Look as Look, look_at as look_at
from .read import read_recording as read_recording
from .summary import Row as Row, read_summary as read_summary
