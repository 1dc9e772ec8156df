from .coast_down_fit import (
    NO_PRIOR as NO_PRIOR,
    CoastDownFit as CoastDownFit,
    fit as fit,
    run_of as run_of,
    simulated as simulated,
)
from .estimator import coast_down as coast_down, flux_decay as flux_decay
from .readings import UNIFORM_STD as UNIFORM_STD
from .report import (
    INERTIA as INERTIA,
    coast_down_assumed as coast_down_assumed,
    ratio_name as ratio_name,
    ratio_unit as ratio_unit,
)
from .stretches import Stretch as Stretch, find_coast_downs as find_coast_downs, stretches_of as stretches_of
