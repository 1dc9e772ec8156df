from .composition import (
    CORRELATED as CORRELATED,
    compose as compose,
    how_it_ended as how_it_ended,
    moved_with as moved_with,
    noise_figures as noise_figures,
    one_step_percent as one_step_percent,
    record_exhibits as record_exhibits,
    still_correlated as still_correlated,
    unsettled as unsettled,
)
from .noise_doubt import KNOWN as KNOWN
from .repeats import Told as Told, repeats_of as repeats_of, tells as tells, with_scatter as with_scatter
from .scatter import chance_of as chance_of, mean_of as mean_of, restricted as restricted
