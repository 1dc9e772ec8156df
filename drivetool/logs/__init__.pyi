from .experiment import (
    Channel as Channel,
    Experiment as Experiment,
    Recording as Recording,
    Source as Source,
    began as began,
    every_part as every_part,
    no_copies as no_copies,
    number_of as number_of,
    numbered as numbered,
    of_one_rate as of_one_rate,
    shown as shown,
    sources as sources,
)
from .grid import (
    BRIDGE_STEPS as BRIDGE_STEPS,
    GAP_STEPS as GAP_STEPS,
    JITTER as JITTER,
    LIKE_STEP as LIKE_STEP,
    Grid as Grid,
    fit_grid as fit_grid,
    median_step as median_step,
    usual_step as usual_step,
)
from .roles import (
    INPUTS as INPUTS,
    MOTORS as MOTORS,
    NAMES as NAMES,
    ROLES as ROLES,
    is_motion as is_motion,
    ordered as ordered,
    quantity as quantity,
    role_of as role_of,
)
from .signals import Signal as Signal
from .units import (
    COUNTS as COUNTS,
    PERCENT as PERCENT,
    RELATIVE as RELATIVE,
    TABLE as TABLE,
    Unit as Unit,
    parse_unit as parse_unit,
)
