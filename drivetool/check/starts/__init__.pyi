from .backlash_multistart import confirmed as confirmed, rattles as rattles
from .base import (
    FAST as FAST,
    LATE as LATE,
    added as added,
    bodies_without as bodies_without,
    hardly_late as hardly_late,
    largest_torque as largest_torque,
    likeliest as likeliest,
    motion as motion,
    new_values as new_values,
    no_faster as no_faster,
    of_lag as of_lag,
    on_any_body as on_any_body,
    outer_bodies as outer_bodies,
    present as present,
    speeds as speeds,
    torque_size as torque_size,
    traceless as traceless,
    travel as travel,
    turns as turns,
)
from .gap_scan import half_gaps as half_gaps
from .instants import EARLY as EARLY, load_steps as load_steps
from .scan import (
    FOLLOWED as FOLLOWED,
    HIGHEST as HIGHEST,
    LINES as LINES,
    asked_for as asked_for,
    disturbance_response as disturbance_response,
    innovations as innovations,
    left_by as left_by,
    likely_large_tips as likely_large_tips,
    likely_middles as likely_middles,
    likely_orders as likely_orders,
    likely_tips as likely_tips,
)
from .start import Bounds as Bounds, Start as Start
