from .agenda import Agenda as Agenda
from .initial_site import Seen as Seen, first_site as first_site, kinds_of as kinds_of
from .recipe import steps_of as steps_of
from .recordings import (
    Machine as Machine,
    Recording as Recording,
    find as find,
    is_recording as is_recording,
    machines_of as machines_of,
)
from .setting import Setting as Setting
from .site_file import load_site as load_site, with_recordings as with_recordings
from .tasks import Task as Task, again as again, shared as shared
