from .clamped import check_clamped as check_clamped
from .estimator import (
    ALL as ALL,
    chosen as chosen,
    default_free as default_free,
    expanded as expanded,
    greybox as greybox,
)
