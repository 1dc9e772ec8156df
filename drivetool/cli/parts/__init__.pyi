from . import swap as swap
from .coast_downs import (
    COAST_DOWN as COAST_DOWN,
    refuse_coast_downs as refuse_coast_downs,
    validate_coast_downs as validate_coast_downs,
    with_coast_down_criterion as with_coast_down_criterion,
    with_flux_decay as with_flux_decay,
)
from .replay import replay_gains as replay_gains
from .step import estimator_command as estimator_command
