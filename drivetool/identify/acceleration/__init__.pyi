from .estimator import (
    Rigid as Rigid,
    acceleration as acceleration,
    held_value as held_value,
    in_the_drive as in_the_drive,
    rigid_of as rigid_of,
)
