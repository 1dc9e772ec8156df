from .catalogue import (
    CAUSES as CAUSES,
    DECIDES as DECIDES,
    FITTED as FITTED,
    chosen_causes as chosen_causes,
    mistaken_for as mistaken_for,
    told_sizes as told_sizes,
)
from .cause import Cause as Cause
