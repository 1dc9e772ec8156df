from .intervals import (
    Interval as Interval,
    find_intervals as find_intervals,
    mean_variances as mean_variances,
    rough_inertia as rough_inertia,
    speed_of as speed_of,
)
from .line import KEYS as KEYS, Line as Line, fit_line as fit_line
from .points import Points as Points, make_points as make_points
from .report import (
    Task as Task,
    body_findings as body_findings,
    exhibits as exhibits,
    in_one_direction as in_one_direction,
    line_findings as line_findings,
    parameter as parameter,
    point_list as point_list,
    record_with as record_with,
)
from .state import block_means as block_means, steady_intervals as steady_intervals
