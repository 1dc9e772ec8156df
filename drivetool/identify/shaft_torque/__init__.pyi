from .channel import check_shaft_torque as check_shaft_torque
from .gap_laws import (
    BothLaws as BothLaws,
    both_laws as both_laws,
    both_laws_from as both_laws_from,
    details_of as details_of,
    laws_told as laws_told,
)
from .sides import (
    as_in_file as as_in_file,
    friction_told as friction_told,
    has_sides as has_sides,
    with_frictions as with_frictions,
)
