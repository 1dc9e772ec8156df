from .hunting import Watch as Watch, safe_gain as safe_gain, watch as watch
from .nonlinear import has_gap as has_gap
from .replay import COMPARED as COMPARED, LoopReplay as LoopReplay, replay_load_step as replay_load_step
