from .composition import (
    CORRELATED as CORRELATED,
    compose as compose,
    held_value_sensitivity as held_value_sensitivity,
    how_it_ended as how_it_ended,
    noise_parameters as noise_parameters,
    not_converged as not_converged,
    one_step_percent as one_step_percent,
    record_plots as record_plots,
    still_correlated as still_correlated,
)
from .noise_ratio_uncertainty import MAX_UNCERTAIN_RATIO as MAX_UNCERTAIN_RATIO
from .repeats import (
    RecordingEstimate as RecordingEstimate,
    identifiable_alone as identifiable_alone,
    repeatability_of as repeatability_of,
    with_scatter as with_scatter,
)
from .scatter import (
    mean_of as mean_of,
    p_value_of_equality as p_value_of_equality,
    restricted_variance as restricted_variance,
    variance_between as variance_between,
)
