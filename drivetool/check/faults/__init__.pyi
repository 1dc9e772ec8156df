from .late_torque import torque_timing_findings as torque_timing_findings
from .load_side_scale import load_scale as load_scale
from .record_faults import (
    MIN_DELAY_SAMPLES as MIN_DELAY_SAMPLES,
    Fault as Fault,
    encoder_step_findings as encoder_step_findings,
    record_faults_of as record_faults_of,
)
from .sensor_delay import speed_delay as speed_delay
from .shaft import (
    MIN_SHAFT_SCALE_ERROR as MIN_SHAFT_SCALE_ERROR,
    SENSOR_SIGNIFICANCE as SENSOR_SIGNIFICANCE,
    rescaled as rescaled,
    scale_fault as scale_fault,
    shaft_fault as shaft_fault,
)
from .spikes import (
    expected_peaks as expected_peaks,
    with_outliers_restored as with_outliers_restored,
    without_model_outliers as without_model_outliers,
    without_outliers as without_outliers,
)
