from .counts import made_of_counts as made_of_counts
from .not_measured import measured as measured, unmeasured as unmeasured
from .speed_check import (
    SURE as SURE,
    compare_speed_and_angle as compare_speed_and_angle,
    differentiate as differentiate,
)
from .spikes import despiked as despiked, held as held, quantum as quantum
from .wrap import looks_unsigned as looks_unsigned, looks_wrapped as looks_wrapped, unwrap as unwrap
from .zero_phase import BRIDGED as BRIDGED, low_pass as low_pass
