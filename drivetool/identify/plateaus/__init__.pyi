from .intervals import (
    SteadyInterval as SteadyInterval,
    find_intervals as find_intervals,
    mean_variances as mean_variances,
    rough_inertia as rough_inertia,
    speed_of as speed_of,
)
from .line import (
    LINE_KEYS as LINE_KEYS,
    FrictionLine as FrictionLine,
    fit_line as fit_line,
    refuse_scatter as refuse_scatter,
)
from .points import (
    STANDSTILL_SPEED_SHARE as STANDSTILL_SPEED_SHARE,
    SteadyPoints as SteadyPoints,
    make_points as make_points,
)
from .report import (
    LineTask as LineTask,
    coulomb_body_findings as coulomb_body_findings,
    line_findings as line_findings,
    line_parameter as line_parameter,
    one_direction_finding as one_direction_finding,
    point_list as point_list,
    record_plot as record_plot,
    steady_plots as steady_plots,
)
from .state import block_means as block_means, steady_intervals as steady_intervals
