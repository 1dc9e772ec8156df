from .attainable_fit import (
    UNEXPLAINED_RUN_DRAWS as UNEXPLAINED_RUN_DRAWS,
    attainable_fits as attainable_fits,
    unexplained_free_run as unexplained_free_run,
    whole_run_findings as whole_run_findings,
)
from .engine import (
    MIN_COLOUR_GAIN as MIN_COLOUR_GAIN,
    by_innovations as by_innovations,
    by_noise_continuation as by_noise_continuation,
    by_simulation as by_simulation,
    fit_noise_only as fit_noise_only,
    fit_task as fit_task,
    free_run as free_run,
    looks_coloured as looks_coloured,
    refit as refit,
    segment_of as segment_of,
    segment_states as segment_states,
    smoothed_starts as smoothed_starts,
    with_coloured_noise as with_coloured_noise,
)
from .friction_split import (
    MAX_PART_STD_SHARE as MAX_PART_STD_SHARE,
    parts_identifiable as parts_identifiable,
    small_idle_torque as small_idle_torque,
    tasks_with_parts as tasks_with_parts,
)
from .friction_totals import (
    fit_with_friction_split as fit_with_friction_split,
    split_totals as split_totals,
    with_friction_parts as with_friction_parts,
    with_totals as with_totals,
)
from .gap_contact import (
    Contact as Contact,
    contact_of as contact_of,
    opened_gap_findings as opened_gap_findings,
    shaft_torque_row as shaft_torque_row,
    with_closed_gaps as with_closed_gaps,
)
