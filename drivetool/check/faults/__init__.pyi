from .late_torque import looked_at as looked_at
from .lateness import lag_of as lag_of
from .load_side_scale import load_scale as load_scale
from .record_faults import LATE as LATE, Fault as Fault, fine_steps as fine_steps, preflight as preflight
from .shaft import (
    BLAMED as BLAMED,
    SCALE as SCALE,
    rescaled as rescaled,
    scale_fault as scale_fault,
    shaft_fault as shaft_fault,
)
from .spikes import (
    expected_peaks as expected_peaks,
    put_back as put_back,
    without_outliers as without_outliers,
    without_surprises as without_surprises,
)
