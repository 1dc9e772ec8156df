from .parts import (
    CutSignals as CutSignals,
    cut_signals as cut_signals,
    kept_windows as kept_windows,
    restart_after_cuts as restart_after_cuts,
)
from .steps import (
    ConditioningStep as ConditioningStep,
    condition as condition,
    parse_step as parse_step,
    read_only as read_only,
)
