from .loop import (
    SHAFT_TORQUE_SHARE as SHAFT_TORQUE_SHARE,
    Configuration as Configuration,
    DeadTimeForm as DeadTimeForm,
    Loop as Loop,
    Settings as Settings,
    Wiring as Wiring,
    build as build,
    check_wiring as check_wiring,
    lag_time as lag_time,
    mechanics as mechanics,
)
from .response import (
    Modes as Modes,
    absolute_integrals as absolute_integrals,
    decompose as decompose,
)
from .sections import MarginsSection as MarginsSection
from .sensitivity import (
    Plant as Plant,
    forbidden_gains as forbidden_gains,
    max_sensitivity as max_sensitivity,
    plant as plant,
    rate_range as rate_range,
    with_fine_peaks as with_fine_peaks,
)
from .stability_margins import margins as margins
from .working_point import (
    FLAT_AT_STANDSTILL as FLAT_AT_STANDSTILL,
    acting_effects as acting_effects,
    left_out_parameters as left_out_parameters,
    steady_torques as steady_torques,
)
