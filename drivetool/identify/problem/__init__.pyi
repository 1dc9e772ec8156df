from .least_squares import (
    Solution as Solution,
    blocked_by_bounds as blocked_by_bounds,
    marquardt_step as marquardt_step,
    nonzero_scale as nonzero_scale,
    schur as schur,
    solve as solve,
    take_steps as take_steps,
)
from .problem import MIN_SPARE_SAMPLES as MIN_SPARE_SAMPLES, Normal as Normal, Point as Point, Problem as Problem
