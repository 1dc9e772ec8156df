from .by_record import as_recorded as as_recorded, shared_by_some as shared_by_some
from .options import Options as Options
from .rates import at_rates as at_rates, rates_left_out as rates_left_out
from .sampled_response import HeldResponse as HeldResponse
from .setup import (
    EVERY as EVERY,
    Roles as Roles,
    both_outputs as both_outputs,
    first_point as first_point,
    first_states as first_states,
    led_in as led_in,
    measured_states as measured_states,
    problem_of as problem_of,
    replaced as replaced,
    reverses as reverses,
    roles_of as roles_of,
    sensor_stds as sensor_stds,
    sensors_of as sensors_of,
    traces_of as traces_of,
    white_std as white_std,
    with_known as with_known,
)
from .start import (
    REST as REST,
    Start as Start,
    checked_state as checked_state,
    contradicted_start as contradicted_start,
    known_states as known_states,
)
from .supply import (
    SUPPLY as SUPPLY,
    as_stator_voltages as as_stator_voltages,
    fed_by_voltages as fed_by_voltages,
    supply_of as supply_of,
)
from .task import Outcome as Outcome, Task as Task, has_gap as has_gap
from .torque_constant import (
    as_torques as as_torques,
    check_scale as check_scale,
    electric as electric,
    for_models as for_models,
    only_in_greybox as only_in_greybox,
)
