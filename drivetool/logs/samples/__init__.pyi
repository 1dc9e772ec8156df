from .quantised_speed import quantised_speed_findings as quantised_speed_findings
from .speed_check import (
    MIN_LAG_LIKELIHOOD_GAIN as MIN_LAG_LIKELIHOOD_GAIN,
    compare_speed_and_angle as compare_speed_and_angle,
    differentiate as differentiate,
    nearest_peak as nearest_peak,
)
from .spikes import (
    MAD_PER_STD as MAD_PER_STD,
    STD_PER_MAD as STD_PER_MAD,
    hold_count as hold_count,
    quantisation_step as quantisation_step,
    remove_spikes as remove_spikes,
)
from .unmeasured_samples import unmeasured_findings as unmeasured_findings, without_unmeasured as without_unmeasured
from .wrap import looks_unsigned as looks_unsigned, looks_wrapped as looks_wrapped, unwrap as unwrap
from .zero_phase import MAX_BRIDGED_SAMPLES as MAX_BRIDGED_SAMPLES, low_pass as low_pass
