from .criteria import (
    Criterion as Criterion,
    criterion as criterion,
    impact_drops as impact_drops,
    signals as signals,
    values as values,
)
from .load_step_factors import Factors as Factors, SpeedFactors as SpeedFactors, factors as factors
from .robust import robust_optimum as robust_optimum, share_kept as share_kept
from .scenarios import Draws as Draws, Spread as Spread, draw as draw, joint as joint, spread as spread
from .search import (
    Found as Found,
    Limits as Limits,
    Task as Task,
    allowed as allowed,
    check_finite as check_finite,
    lowest_sensitivity as lowest_sensitivity,
    optimum as optimum,
    shapes_of as shapes_of,
    task as task,
)
from .variations import Variation as Variation, study as study
