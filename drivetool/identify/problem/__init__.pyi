from .least_squares import (
    Solution as Solution,
    approach as approach,
    blocked as blocked,
    marquardt_step as marquardt_step,
    schur as schur,
    solve as solve,
)
from .problem import Normal as Normal, Point as Point, Problem as Problem
