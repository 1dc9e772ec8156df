from .explanation import (
    MIN_EXPLAINED_FIT as MIN_EXPLAINED_FIT,
    Explanation as Explanation,
    default_fit as default_fit,
    with_total_uncertainty as with_total_uncertainty,
)
from .influence import (
    FEW_BLOCKS_FACTOR as FEW_BLOCKS_FACTOR,
    sandwich_covariance as sandwich_covariance,
    scores_of as scores_of,
    with_standard_deviations as with_standard_deviations,
)
from .law_selection import (
    FOLDS as FOLDS,
    MAX_LAWS as MAX_LAWS,
    MIN_LAW_GAIN as MIN_LAW_GAIN,
    forward_selection as forward_selection,
)
from .laws import (
    STRIBECK_NAME as STRIBECK_NAME,
    Law as Law,
    law_library as law_library,
    model_error as model_error,
    significant_laws as significant_laws,
)
from .missing_structure import (
    can_be_tested as can_be_tested,
    find_missing_structure as find_missing_structure,
    missing_structure as missing_structure,
)
from .projected_parameters import (
    projected_within_bounds as projected_within_bounds,
    projection_of_laws as projection_of_laws,
)
from .third_mass import (
    third_mass_names as third_mass_names,
    third_mass_score_test as third_mass_score_test,
    with_split_load as with_split_load,
)
