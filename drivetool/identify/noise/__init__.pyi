from .innovations import (
    ABANDON_EXCESS as ABANDON_EXCESS,
    MAX_REPEATED_FITS as MAX_REPEATED_FITS,
    Fit as Fit,
    fit_innovations as fit_innovations,
    refit_with_tight_tolerance as refit_with_tight_tolerance,
    solve_under_noise as solve_under_noise,
    until_converged as until_converged,
    with_global_noise_search as with_global_noise_search,
)
from .log_noise import expected_recording_noise as expected_recording_noise
from .noise import (
    MAX_MINUS_LOG_LIKELIHOOD as MAX_MINUS_LOG_LIKELIHOOD,
    Noise as Noise,
    dense_normal_equations as dense_normal_equations,
    filtered as filtered,
    filtered_normal_equations as filtered_normal_equations,
    first_samples_of as first_samples_of,
    fit_correlated_noise as fit_correlated_noise,
    fit_ratio as fit_ratio,
    minimise_by_parabolas as minimise_by_parabolas,
    minus_log_likelihood as minus_log_likelihood,
    minus_log_likelihood_at as minus_log_likelihood_at,
    restricted_likelihood as restricted_likelihood,
    unit_noise_ratio as unit_noise_ratio,
    with_disturbance_state as with_disturbance_state,
    with_torque_noise as with_torque_noise,
)
