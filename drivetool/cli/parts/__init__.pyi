from . import swap as swap
from .replay import replay_gains as replay_gains
from .run_downs import (
    COAST_DOWN as COAST_DOWN,
    judged_by as judged_by,
    on_run_downs as on_run_downs,
    refuse_run_downs as refuse_run_downs,
    with_decay as with_decay,
)
from .step import estimator_command as estimator_command
