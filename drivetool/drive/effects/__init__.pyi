from . import (
    hardening as hardening,
    idle_torque as idle_torque,
    induction as induction,
    load_damping as load_damping,
    load_step as load_step,
    transmission_loss as transmission_loss,
)
from .catalogue import (
    EFFECT_INPUTS as EFFECT_INPUTS,
    EFFECTS as EFFECTS,
    FRICTION_SUFFIXES as FRICTION_SUFFIXES,
    GEAR_RATIO_EXPONENTS as GEAR_RATIO_EXPONENTS,
    LAW_TORQUES as LAW_TORQUES,
    OPTIONAL_SUFFIXES as OPTIONAL_SUFFIXES,
    TOTAL_RULES as TOTAL_RULES,
    TOTALS as TOTALS,
)
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
