from .estimator import (
    MIN_FIRST_STAGE_F as MIN_FIRST_STAGE_F,
    check_inverse_options as check_inverse_options,
    greybox_by_inverse as greybox_by_inverse,
)
from .missing_laws import missing_laws_of as missing_laws_of, with_laws as with_laws
from .regression import (
    InverseRegression as InverseRegression,
    first_stage_f as first_stage_f,
    regression_of as regression_of,
    sample_count as sample_count,
    solve_inverse as solve_inverse,
    with_instruments as with_instruments,
)
