from .channel import check_shaft_torque as check_shaft_torque
from .gap_laws import (
    BothLaws as BothLaws,
    both_laws as both_laws,
    both_laws_from as both_laws_from,
    dead_stretch_details as dead_stretch_details,
    gap_law_findings as gap_law_findings,
)
from .sides import (
    has_sides as has_sides,
    with_friction_of_file as with_friction_of_file,
    with_frictions as with_frictions,
    with_identified_friction as with_identified_friction,
)
