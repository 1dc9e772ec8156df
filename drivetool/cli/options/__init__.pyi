from . import common as common
from .inputs import (
    check_outputs as check_outputs,
    collected_findings as collected_findings,
    drive_for as drive_for,
    errors_as_usage as errors_as_usage,
    is_input as is_input,
    noted_options as noted_options,
    open_all as open_all,
    start_of as start_of,
    with_set_values as with_set_values,
    with_torques as with_torques,
)
from .job import WORD_SEPARATOR as WORD_SEPARATOR, Job as Job, Opened as Opened
from .record_option import (
    RECORD_OPTION as RECORD_OPTION,
    held_out_differences as held_out_differences,
    join_record_words as join_record_words,
    only_known_differences as only_known_differences,
    record_differences as record_differences,
)
from .stages_option import windows_of as windows_of
from .units_of import check_common_units as check_common_units
