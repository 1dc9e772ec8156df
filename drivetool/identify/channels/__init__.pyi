from .channel_doubt import doubted_channels as doubted_channels, doubted_units as doubted_units
from .feedback import Feedback as Feedback, feedback_in as feedback_in, feedback_of as feedback_of
from .late_torque import ROLE as ROLE, explains as explains, torque_timing as torque_timing
from .outliers import without_outliers as without_outliers
from .unused import AT_MOTOR as AT_MOTOR, unused_roles as unused_roles, used_by as used_by
