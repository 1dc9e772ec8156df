from .limit_cycle import (
    DisturbanceResponse as DisturbanceResponse,
    disturbance_responses as disturbance_responses,
    safe_gain as safe_gain,
)
from .nonlinear import has_gap as has_gap
from .replay import COMPARED_ROLES as COMPARED_ROLES, LoopReplay as LoopReplay, replay_load_step as replay_load_step
from .sections import HuntingSection as HuntingSection
