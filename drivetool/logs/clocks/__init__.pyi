from .batched_times import find_batches as find_batches
from .clean_stamps import MAX_ABS_TIME as MAX_ABS_TIME, clean_clock as clean_clock
from .rate_changes import Rate as Rate, at_rate as at_rate, find_rates as find_rates
from .resample import (
    CleanSignals as CleanSignals,
    clean_signals as clean_signals,
    leader_of as leader_of,
    onto_grid as onto_grid,
)
