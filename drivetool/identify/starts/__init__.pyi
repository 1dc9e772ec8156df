from .attempts import attempt_or_none as attempt_or_none, without_failed as without_failed
from .cross_entropy_search import search_from_prior as search_from_prior
from .partial_record_restarts import restart_from_partial_records as restart_from_partial_records
from .process_noise_continuation import (
    SHAPE_QUANTITIES as SHAPE_QUANTITIES,
    choose_gap_sides as choose_gap_sides,
    continue_in_process_noise as continue_in_process_noise,
    frozen_observers as frozen_observers,
)
from .resonance import resonance_starts as resonance_starts
from .rigid_body_regression import (
    MAX_RELATIVE_STD as MAX_RELATIVE_STD,
    regressed_totals as regressed_totals,
    scaled_to_totals as scaled_to_totals,
)
from .search import (
    MAX_AGREEING_LOSS as MAX_AGREEING_LOSS,
    PARALLEL_STARTS as PARALLEL_STARTS,
    Descent as Descent,
    free_values as free_values,
    log_likelihood_distance as log_likelihood_distance,
    multi_start_search as multi_start_search,
    start_agrees as start_agrees,
)
