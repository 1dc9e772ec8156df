from .criteria import (
    Criterion as Criterion,
    criterion as criterion,
    criterion_values as criterion_values,
    impact_drops as impact_drops,
    signals as signals,
)
from .load_step_factors import Factors as Factors, SpeedFactors as SpeedFactors, factors as factors
from .robust import robust_optimum as robust_optimum, share_within_limit as share_within_limit
from .scenarios import (
    Draws as Draws,
    FigureSpread as FigureSpread,
    draw_drives as draw_drives,
    joint_covariance as joint_covariance,
    spread_of_figures as spread_of_figures,
)
from .search import (
    Optimum as Optimum,
    TuneLimits as TuneLimits,
    TuningProblem as TuningProblem,
    allowed_gains as allowed_gains,
    check_gain_is_limited as check_gain_is_limited,
    grid_shapes as grid_shapes,
    lowest_sensitivity as lowest_sensitivity,
    optimum as optimum,
    tuning_problem as tuning_problem,
)
from .sections import (
    CriterionSection as CriterionSection,
    SpreadSection as SpreadSection,
    VariationSection as VariationSection,
)
from .variations import Variation as Variation, depends_on as depends_on, variation_study as variation_study
