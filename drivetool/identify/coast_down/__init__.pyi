from .estimator import coast_down as coast_down, flux_decay as flux_decay
from .readings import UNIFORM as UNIFORM
from .report import (
    INERTIA as INERTIA,
    ratio_name as ratio_name,
    ratio_unit as ratio_unit,
    switched_off_assumed as switched_off_assumed,
)
from .run_down_fit import NOTHING as NOTHING, Fitted as Fitted, fit as fit, run_of as run_of, simulated as simulated
from .stretches import Stretch as Stretch, run_downs as run_downs, stretches_of as stretches_of
