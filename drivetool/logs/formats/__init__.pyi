from .read import file_sha256 as file_sha256, read_recording as read_recording
from .recording_header import RecordingHeader as RecordingHeader, read_header as read_header
from .summary import Row as Row, read_summary as read_summary
