from .channel import check_shaft_torque as check_shaft_torque
from .gap_laws import (
    GapLaws as GapLaws,
    dead_stretch_details as dead_stretch_details,
    fit_gap_laws as fit_gap_laws,
    fit_gap_laws_from as fit_gap_laws_from,
    gap_law_findings as gap_law_findings,
)
from .sides import (
    friction_of_file as friction_of_file,
    has_sides as has_sides,
    with_frictions as with_frictions,
    with_identified_friction as with_identified_friction,
)
