from .chance import TRIFLE as TRIFLE, unlikely as unlikely
from .gauss_newton_step import alone as alone, linear_step as linear_step
from .model import (
    BROKEN as BROKEN,
    FIRST as FIRST,
    MOST as MOST,
    Masks as Masks,
    Model as Model,
    begun as begun,
    everything as everything,
    few_steps as few_steps,
    first_noise as first_noise,
    fit as fit,
    from_start as from_start,
    heard as heard,
    judge as judge,
    likeliest_noise as likeliest_noise,
    losses as losses,
    over as over,
    runs_worse as runs_worse,
    sensor_std as sensor_std,
    spread as spread,
    stands_in as stands_in,
    total as total,
)
from .parts import with_parts as with_parts
from .quantisation import COARSE as COARSE, resolution as resolution
from .reduce import TOLD as TOLD, values_of as values_of, without_them as without_them
from .residual_tests import (
    LEFT as LEFT,
    LITTLE as LITTLE,
    Remainder as Remainder,
    faked as faked,
    much_left as much_left,
    remainder as remainder,
)
from .structure import (
    carried as carried,
    may_have_tip as may_have_tip,
    third_of as third_of,
    with_large_tip as with_large_tip,
    with_middle as with_middle,
    with_tip as with_tip,
)
