from .builder import (
    estimate_from_fit as estimate_from_fit,
    free_run_figures as free_run_figures,
    record_picture as record_picture,
)
from .derived_figures import derived_figures_of as derived_figures_of
from .estimate import (
    Z95 as Z95,
    Covariance as Covariance,
    Estimate as Estimate,
    FoundLaw as FoundLaw,
    HeatMap as HeatMap,
    Parameter as Parameter,
    PlotData as PlotData,
    std_by_gradient as std_by_gradient,
)
from .interval_and_status import (
    MAX_INFLATION as MAX_INFLATION,
    Z95_ONE_SIDED as Z95_ONE_SIDED,
    covariance_of as covariance_of,
    experiment_for as experiment_for,
    held_uncertainty as held_uncertainty,
    inverted as inverted,
    parameters_of as parameters_of,
    sensitivity_to_held as sensitivity_to_held,
)
from .lines import (
    held_line as held_line,
    in_order as in_order,
    line_of as line_of,
    whole_table as whole_table,
)
from .percent import fit_percent as fit_percent, fit_text as fit_text
from .rounding import (
    explains_to_rounding as explains_to_rounding,
    only_rounding as only_rounding,
    rounding_finding as rounding_finding,
)
from .sections import (
    DerivedSection as DerivedSection,
    LawSection as LawSection,
    ParameterSection as ParameterSection,
    StartsSection as StartsSection,
)
from .verdict import (
    NOT_CONVERGED_TEXT as NOT_CONVERGED_TEXT,
    Check as Check,
    Verdict as Verdict,
    masked as masked,
)
