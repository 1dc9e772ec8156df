from .initial_site import RecordingGroup as RecordingGroup, first_site as first_site, kinds_of as kinds_of
from .recipe import steps_of as steps_of
from .recordings import (
    Machine as Machine,
    Recording as Recording,
    find_recordings as find_recordings,
    is_recording as is_recording,
    machines_of as machines_of,
)
from .run_options import RunOptions as RunOptions
from .schedule import Schedule as Schedule
from .site_file import load_site as load_site, with_recordings as with_recordings
from .tasks import StepTask as StepTask, duplicates as duplicates, retry_reasons as retry_reasons
