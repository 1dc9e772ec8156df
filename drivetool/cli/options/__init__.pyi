from . import common as common, record_option as record_option
from .inputs import (
    as_set as as_set,
    as_usage as as_usage,
    check_outputs as check_outputs,
    drive_for as drive_for,
    findings as findings,
    is_input as is_input,
    noted as noted,
    open_all as open_all,
    start_of as start_of,
    with_torques as with_torques,
)
from .job import BETWEEN as BETWEEN, Job as Job, Opened as Opened
from .record_option import (
    OPTION as OPTION,
    differing as differing,
    only_stated as only_stated,
    own_of_held_out as own_of_held_out,
)
from .stages_option import windows_of as windows_of
from .units_of import one_kind as one_kind
