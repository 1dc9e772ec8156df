from .friction_split import with_parts as with_parts
from .gauss_newton_step import amplitude_std as amplitude_std, linear_step as linear_step
from .model import (
    FIRST_FIT_ITERATIONS as FIRST_FIT_ITERATIONS,
    FIT_ERRORS as FIT_ERRORS,
    MAX_FIT_ITERATIONS as MAX_FIT_ITERATIONS,
    Masks as Masks,
    Model as Model,
    all_samples as all_samples,
    fit as fit,
    fit_from_start as fit_from_start,
    free_runs_clearly_worse as free_runs_clearly_worse,
    gauss_newton_iterations as gauss_newton_iterations,
    initial_noise as initial_noise,
    masked_loss as masked_loss,
    noise_absorbs_effect as noise_absorbs_effect,
    over_traces as over_traces,
    reestimate_noise as reestimate_noise,
    sample_losses as sample_losses,
    sensor_std as sensor_std,
    sensor_variance as sensor_variance,
    total_loss as total_loss,
    with_likeliest_noise as with_likeliest_noise,
)
from .quantisation import MIN_ROUNDING_VARIANCE_SHARE as MIN_ROUNDING_VARIANCE_SHARE, resolution as resolution
from .reduce import (
    SIZE_SIGNIFICANCE as SIZE_SIGNIFICANCE,
    added_parameters as added_parameters,
    refit_without as refit_without,
)
from .residual_tests import (
    MAX_RESIDUAL_GAIN as MAX_RESIDUAL_GAIN,
    MAX_RESIDUAL_SHARE as MAX_RESIDUAL_SHARE,
    ResidualTests as ResidualTests,
    gain_from_quantisation as gain_from_quantisation,
    residuals_large as residuals_large,
    run_residual_tests as run_residual_tests,
)
from .significance import MIN_TESTABLE_GAIN as MIN_TESTABLE_GAIN, neg_log_p_corrected as neg_log_p_corrected
from .structure import (
    may_have_third_mass as may_have_third_mass,
    on_task as on_task,
    third_mass_of as third_mass_of,
    transferred_point as transferred_point,
    with_end_mass as with_end_mass,
    with_intermediate_mass as with_intermediate_mass,
    with_large_end_mass as with_large_end_mass,
)
