from .derived_figures import derived as derived
from .estimate import (
    Covariance as Covariance,
    Estimate as Estimate,
    Exhibit as Exhibit,
    FoundLaw as FoundLaw,
    HeatMap as HeatMap,
    Parameter as Parameter,
    Starts as Starts,
    without_intervals as without_intervals,
)
from .interval_and_status import (
    COLLINEAR as COLLINEAR,
    ONE_SIDED as ONE_SIDED,
    Z95 as Z95,
    covariance_of as covariance_of,
    experiment_for as experiment_for,
    held_uncertainty as held_uncertainty,
    inverted as inverted,
    moved_by_held as moved_by_held,
    parameters_of as parameters_of,
    why_on_bound as why_on_bound,
    without_untold as without_untold,
)
from .percent import fit_percent as fit_percent, fit_words as fit_words
from .rounding import explains as explains, only_rounding as only_rounding, rounding_alone as rounding_alone
