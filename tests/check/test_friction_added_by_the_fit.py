"""Dry friction that a fit has added by itself is a cause for the diagnosis, not a part of its base."""

from drivetool.check.full_diagnosis import without_added_friction
from drivetool.drive import two_mass

DRIVE = two_mass().with_values({"motor.coulomb": 0.5, "load.coulomb": 0.3})
FREE = ("motor.coulomb", "load.coulomb")


def test_friction_that_the_fit_has_added_behind_the_motor_is_taken_out():
    drive, free = without_added_friction(DRIVE, FREE, {"motor.coulomb": 0.0, "load.coulomb": 0.0})
    assert drive.values["load.coulomb"] == 0.0 and drive.values["motor.coulomb"] == 0.5
    assert free == ("motor.coulomb",)


def test_friction_that_was_given_stays():
    drive, free = without_added_friction(DRIVE, FREE, {"motor.coulomb": 0.4, "load.coulomb": 0.2})
    assert drive.values == DRIVE.values and free == FREE
