from .batched_times import batches as batches
from .clean_stamps import FAR as FAR, clean_clock as clean_clock
from .rate_changes import Rate as Rate, at_rate as at_rate, rates as rates
from .resample import Clean as Clean, cleaned as cleaned, leader_of as leader_of, onto_grid as onto_grid
