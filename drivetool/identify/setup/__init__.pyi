from .by_record import as_recorded as as_recorded, shared_free_names as shared_free_names
from .options import (
    HELD_OUT_SHARE as HELD_OUT_SHARE,
    NONLINEAR as NONLINEAR,
    Options as Options,
    refuse_other_free as refuse_other_free,
    refuse_unused as refuse_unused,
)
from .rates import at_rates as at_rates, rates_left_out as rates_left_out
from .sampled_response import HeldResponse as HeldResponse
from .setup import (
    UNNAMED_RECORDINGS as UNNAMED_RECORDINGS,
    Roles as Roles,
    after_transient as after_transient,
    both_outputs as both_outputs,
    first_point as first_point,
    first_states as first_states,
    measured_states as measured_states,
    problem_of as problem_of,
    refuse_transmission_loss as refuse_transmission_loss,
    reverses as reverses,
    roles_of as roles_of,
    sensor_stds as sensor_stds,
    sensors_of as sensors_of,
    starts_or_stops as starts_or_stops,
    traces_of as traces_of,
    white_std as white_std,
    with_known_states as with_known_states,
    with_trial_values as with_trial_values,
)
from .start import (
    REST as REST,
    KnownStart as KnownStart,
    check_state as check_state,
    contradicted_start_findings as contradicted_start_findings,
    known_states as known_states,
)
from .supply import (
    SUPPLY_ROLES as SUPPLY_ROLES,
    as_stator_voltages as as_stator_voltages,
    fed_by_voltages as fed_by_voltages,
    supply_of as supply_of,
)
from .task import Outcome as Outcome, Task as Task, has_gap as has_gap, run_length as run_length
from .torque_constant import (
    as_torques as as_torques,
    as_torques_for_models as as_torques_for_models,
    check_torque_scale as check_torque_scale,
    electric_inputs as electric_inputs,
    refuse_free_torque_constants as refuse_free_torque_constants,
)
