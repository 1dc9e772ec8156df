from .engine import (
    COLOUR_GAIN as COLOUR_GAIN,
    again as again,
    by_cooling as by_cooling,
    by_innovations as by_innovations,
    by_simulation as by_simulation,
    coloured as coloured,
    fit_task as fit_task,
    free_run as free_run,
    frozen as frozen,
    looks_coloured as looks_coloured,
    segment_of as segment_of,
    segment_states as segment_states,
    smoothed_starts as smoothed_starts,
)
from .gap_contact import (
    Contact as Contact,
    contact as contact,
    opened_gaps as opened_gaps,
    shut as shut,
    spring_of as spring_of,
)
from .parts import SHARE as SHARE, parted as parted, size_of_idle as size_of_idle, told_apart as told_apart
from .sums import apart as apart, fit_apart as fit_apart, split_totals as split_totals, with_totals as with_totals
