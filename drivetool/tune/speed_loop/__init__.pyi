from .loop import (
    SHARE as SHARE,
    Configuration as Configuration,
    DeadTimeForm as DeadTimeForm,
    Loop as Loop,
    Settings as Settings,
    Wiring as Wiring,
    bare as bare,
    build as build,
    check_wiring as check_wiring,
    lag_time as lag_time,
    mechanics as mechanics,
)
from .response import (
    Modes as Modes,
    absolute_integral as absolute_integral,
    absolute_integrals as absolute_integrals,
    decompose as decompose,
)
from .sensitivity import (
    Plant as Plant,
    forbidden as forbidden,
    max_sensitivity as max_sensitivity,
    plant as plant,
    refined as refined,
    speeds_of as speeds_of,
)
from .stability_margins import Margins as Margins, margins as margins
from .working_point import FLAT as FLAT, acting as acting, carried as carried, left_out as left_out
