from .held_value_test import contradicted_held_values as contradicted_held_values
from .joint_identifiability import (
    Freed as Freed,
    lumped_on_last_body as lumped_on_last_body,
    only_ratios as only_ratios,
    with_sums_of_constant_torques as with_sums_of_constant_torques,
    without_joint_intervals as without_joint_intervals,
    without_torque_intervals as without_torque_intervals,
)
from .low_inertia_ratio import (
    load_inertia_ratio as load_inertia_ratio,
    with_low_inertia_findings as with_low_inertia_findings,
    with_uncertain_values_free as with_uncertain_values_free,
)
from .one_sided_backlash import (
    never_crossed as never_crossed,
    uncrossed_gaps as uncrossed_gaps,
    with_lower_limit_only as with_lower_limit_only,
    without_upper_limit as without_upper_limit,
)
from .profile_likelihood import HALF_CHI2_95 as HALF_CHI2_95, Profile as Profile, profile as profile
from .shaft_likelihood_ratio import (
    shaft_gain as shaft_gain,
    without_shaft_intervals as without_shaft_intervals,
    without_unidentified as without_unidentified,
)
