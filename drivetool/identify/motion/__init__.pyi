from .chain_torque import begins as begins, behind as behind
from .filtered_equations import (
    ROUNDED as ROUNDED,
    Equations as Equations,
    TorqueFit as TorqueFit,
    equations as equations,
    smoothed as smoothed,
    stands as stands,
    torque_fit as torque_fit,
    torque_picture as torque_picture,
    turns as turns,
)
from .instruments import foretold as foretold, reference_of as reference_of
from .linear import (
    BLOCKS as BLOCKS,
    ORDER as ORDER,
    Rows as Rows,
    autoregression as autoregression,
    beyond_stationary as beyond_stationary,
    change_of as change_of,
    covariance_of as covariance_of,
    influence_of as influence_of,
    inverse_of as inverse_of,
)
from .motion import (
    NOISE_SHARE as NOISE_SHARE,
    SURE as SURE,
    Motion as Motion,
    Motions as Motions,
    Smoothing as Smoothing,
    motion_of as motion_of,
    motions_of as motions_of,
    motions_through as motions_through,
)
from .required_torque import first_body as first_body, logged_as_it_acts as logged_as_it_acts
