from .experiment import (
    Channel as Channel,
    Experiment as Experiment,
    Recording as Recording,
    Source as Source,
    display_name as display_name,
    group_by_rate as group_by_rate,
    natural_order as natural_order,
    number_duplicates as number_duplicates,
    parts_at_all_rates as parts_at_all_rates,
    recording_number as recording_number,
    recording_sources as recording_sources,
    refuse_copies as refuse_copies,
    start_date as start_date,
)
from .grid import (
    GAP_STEPS as GAP_STEPS,
    JITTER_TOLERANCE as JITTER_TOLERANCE,
    MAX_STEPS_WITHIN_SEGMENT as MAX_STEPS_WITHIN_SEGMENT,
    MIN_SAMPLES as MIN_SAMPLES,
    STEP_TOLERANCE as STEP_TOLERANCE,
    Grid as Grid,
    fit_grid as fit_grid,
    median_step as median_step,
    true_runs as true_runs,
    usual_step as usual_step,
)
from .roles import (
    INPUTS as INPUTS,
    MOTOR_TORQUES as MOTOR_TORQUES,
    ROLE_NAME_PATTERN as ROLE_NAME_PATTERN,
    ROLES as ROLES,
    is_motion as is_motion,
    ordered_roles as ordered_roles,
    quantity as quantity,
    role_of as role_of,
)
from .signals import Signal as Signal
from .units import (
    COUNTS as COUNTS,
    PERCENT as PERCENT,
    RELATIVE as RELATIVE,
    UNIT_TABLE as UNIT_TABLE,
    Unit as Unit,
    parse_unit as parse_unit,
)
