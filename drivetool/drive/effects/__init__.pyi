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
from .load_step import RECORDS as RECORDS, STEPS as STEPS, TIMES as TIMES, TORQUES as TORQUES, felt_in as felt_in
from .ripple import KINDS as KINDS, RIPPLES as RIPPLES
from .torque_constant import NAME as NAME
