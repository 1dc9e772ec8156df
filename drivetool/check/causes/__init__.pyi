from .catalogue import (
    CAUSES as CAUSES,
    DECISIVE_EXPERIMENTS as DECISIVE_EXPERIMENTS,
    FITTED as FITTED,
    chosen_causes as chosen_causes,
    mistaken_for as mistaken_for,
    size_parameters as size_parameters,
)
from .cause import Cause as Cause
