"""From which size on a change is an alarm: a file of its own, since the help of a command states it."""

# Standard deviations of the runs before. A choice: a change from which a visit to the machine is worth while. With
# enough recordings far smaller changes are significant, but need no visit.
DEFAULT_ALARM_RATIO = 5.0
