from .held import contradicted_holds as contradicted_holds
from .joint_identifiability import (
    on_the_last as on_the_last,
    only_ratios as only_ratios,
    told_together as told_together,
    without_sizes as without_sizes,
)
from .light import fit_light as fit_light, judged as judged, load_share as load_share, loosened as loosened
from .profile_likelihood import LEVEL95 as LEVEL95, Profile as Profile, profile as profile
from .shown import not_of_shaft as not_of_shaft, told_by as told_by, worth_of_shafts as worth_of_shafts
from .uncrossed import (
    all_uncrossed as all_uncrossed,
    from_below as from_below,
    never_crossed as never_crossed,
    unbounded as unbounded,
)
