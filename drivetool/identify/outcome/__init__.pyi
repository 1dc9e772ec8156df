from .composition import (
    CORRELATED as CORRELATED,
    compose as compose,
    estimate_from_outcome as estimate_from_outcome,
    held_value_sensitivity as held_value_sensitivity,
    not_converged as not_converged,
    outcome_figures as outcome_figures,
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
