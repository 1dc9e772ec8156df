from . import (
    idle_torque as idle_torque,
    induction as induction,
    load_step as load_step,
    torque_constant as torque_constant,
)
from .catalogue import EFFECTS as EFFECTS, LAW_TORQUES as LAW_TORQUES
from .effect import Effect as Effect
from .induction import (
    EFFECT as EFFECT,
    FLUXES as FLUXES,
    VOLTAGES as VOLTAGES,
    mean_torque as mean_torque,
    steady_torque as steady_torque,
)
from .load_step import (
    STEP_NAMES as STEP_NAMES,
    STEP_RECORDS as STEP_RECORDS,
    STEP_TIMES as STEP_TIMES,
    STEP_TORQUES as STEP_TORQUES,
    values_in_record as values_in_record,
)
from .ripple import RIPPLE_QUANTITIES as RIPPLE_QUANTITIES, RIPPLES as RIPPLES
from .torque_constant import NAME as NAME
