from .estimator import WEAK as WEAK, askable as askable, greybox_by_inverse as greybox_by_inverse
from .missing_laws import lacking as lacking, with_laws as with_laws
from .regression import (
    Inverse as Inverse,
    count_of as count_of,
    recorded as recorded,
    solved as solved,
    strength as strength,
    with_instruments as with_instruments,
)
