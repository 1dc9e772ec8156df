from .held_value_test import contradicted_held_values as contradicted_held_values
from .joint_identifiability import (
    Freed as Freed,
    if_freed as if_freed,
    lumped_friction as lumped_friction,
    lumped_on_last_body as lumped_on_last_body,
    only_ratios as only_ratios,
    ratios_of_torques as ratios_of_torques,
    sums_of_constant_torques as sums_of_constant_torques,
)
from .low_inertia_ratio import (
    load_inertia_ratio as load_inertia_ratio,
    low_inertia as low_inertia,
    with_uncertain_values_free as with_uncertain_values_free,
)
from .one_sided_backlash import (
    never_crossed as never_crossed,
    uncrossed_gaps as uncrossed_gaps,
    without_upper_limit as without_upper_limit,
)
from .profile_likelihood import HALF_CHI2_95 as HALF_CHI2_95, Profile as Profile, profile as profile
from .shaft_likelihood_ratio import (
    insignificant_shafts as insignificant_shafts,
    names_joined_by as names_joined_by,
    shaft_gain as shaft_gain,
)
