from .backlash_multistart import backlash_fits as backlash_fits, with_neighbouring_fits as with_neighbouring_fits
from .base import (
    DELAY_STARTS_IN_SAMPLES as DELAY_STARTS_IN_SAMPLES,
    MIN_LAG_SAMPLES as MIN_LAG_SAMPLES,
    NEGLIGIBLE_FRICTION_SHARE as NEGLIGIBLE_FRICTION_SHARE,
    bodies_without as bodies_without,
    gear_ratio as gear_ratio,
    is_present as is_present,
    lag_bounds as lag_bounds,
    lag_starts as lag_starts,
    largest_torque as largest_torque,
    likeliest_start as likeliest_start,
    new_values as new_values,
    outer_bodies as outer_bodies,
    shortest_delay as shortest_delay,
    speed_and_duration as speed_and_duration,
    speeds as speeds,
    start_with as start_with,
    starts_on_any_body as starts_on_any_body,
    too_short_to_detect as too_short_to_detect,
    torque_size as torque_size,
    travel as travel,
)
from .gap_scan import half_gaps as half_gaps
from .load_step_scan import MIN_STEP_DISTANCE as MIN_STEP_DISTANCE, load_steps as load_steps
from .scan import (
    MAX_RIPPLE_FREQUENCY as MAX_RIPPLE_FREQUENCY,
    MIN_FOLLOWED_SHARE as MIN_FOLLOWED_SHARE,
    RESPONSE_FREQUENCIES as RESPONSE_FREQUENCIES,
    disturbance_response as disturbance_response,
    equivalent_motor_torque as equivalent_motor_torque,
    innovations as innovations,
    likely_end_masses as likely_end_masses,
    likely_intermediate_masses as likely_intermediate_masses,
    likely_large_end_masses as likely_large_end_masses,
    likely_orders as likely_orders,
    response_energy as response_energy,
)
from .start import Bounds as Bounds, Start as Start
