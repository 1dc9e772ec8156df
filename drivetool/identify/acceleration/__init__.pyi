from .estimator import (
    RigidDrive as RigidDrive,
    acceleration as acceleration,
    as_drive_parameters as as_drive_parameters,
    held_value as held_value,
    rigid_of as rigid_of,
)
