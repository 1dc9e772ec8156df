from .clamped import check_clamped as check_clamped
from .estimator import (
    ALL as ALL,
    default_free as default_free,
    free_parameters as free_parameters,
    greybox as greybox,
    with_all_expanded as with_all_expanded,
)
