from .chain_torque import initial_transient as initial_transient, torque_of_chain as torque_of_chain
from .filtered_equations import (
    CONSTANT_TORQUE_TOLERANCE as CONSTANT_TORQUE_TOLERANCE,
    Equations as Equations,
    TorqueFit as TorqueFit,
    at_standstill as at_standstill,
    equations as equations,
    near_reversal as near_reversal,
    smoothed as smoothed,
    torque_fit as torque_fit,
    torque_picture as torque_picture,
)
from .instruments import predicted_by_reference as predicted_by_reference, reference_of as reference_of
from .linear import (
    AUTOREGRESSION_ORDER as AUTOREGRESSION_ORDER,
    INFLUENCE_BLOCKS as INFLUENCE_BLOCKS,
    Rows as Rows,
    autoregression as autoregression,
    between_block_std as between_block_std,
    change_of as change_of,
    covariance_of as covariance_of,
    influence_of as influence_of,
    inverse_of as inverse_of,
)
from .motion import (
    NOISE_SHARE as NOISE_SHARE,
    SIGN_SIGNIFICANCE as SIGN_SIGNIFICANCE,
    Motion as Motion,
    Motions as Motions,
    Smoothing as Smoothing,
    motion_of as motion_of,
    motions_of as motions_of,
    motions_through as motions_through,
)
from .required_torque import check_no_signal_path as check_no_signal_path, first_body as first_body
