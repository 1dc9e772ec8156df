from .channel_plausibility import (
    suspect_channel_findings as suspect_channel_findings,
    suspect_unit_findings as suspect_unit_findings,
)
from .feedback import Feedback as Feedback, feedback_in as feedback_in, feedback_of as feedback_of
from .late_torque import (
    TORQUE_ROLE as TORQUE_ROLE,
    residual_uncorrelated as residual_uncorrelated,
    torque_timing as torque_timing,
)
from .outliers import without_outliers as without_outliers
from .unused import AT_MOTOR as AT_MOTOR, unused_roles as unused_roles, used_by as used_by
