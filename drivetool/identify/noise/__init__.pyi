from .innovations import (
    MAX_REPEATED_FITS as MAX_REPEATED_FITS,
    Fit as Fit,
    fit_innovations as fit_innovations,
    polish as polish,
    until_converged as until_converged,
    with_global_noise_search as with_global_noise_search,
)
from .log_noise import expected_recording_noise as expected_recording_noise
from .noise import (
    MAX_MINUS_LOG_LIKELIHOOD as MAX_MINUS_LOG_LIKELIHOOD,
    Noise as Noise,
    arrow as arrow,
    excerpt as excerpt,
    filtered as filtered,
    fit_correlated_noise as fit_correlated_noise,
    fit_ratio as fit_ratio,
    minimise_by_parabolas as minimise_by_parabolas,
    minus_log_likelihood as minus_log_likelihood,
    natural_ratio as natural_ratio,
    normal_under as normal_under,
    restricted_likelihood as restricted_likelihood,
    with_disturbance_state as with_disturbance_state,
    with_torque_noise as with_torque_noise,
)
