"""What acts behind a gear begins, and is bounded, in torques and speeds of that side."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import all_samples, fit_from_start
from drivetool.check.search.prepared_start import prepare_start, reference_model
from drivetool.drive import two_mass
from drivetool.identify.setup import Task, roles_of
from tests.recover import reversing_record
from tests.simulator.machine import machine_by_seed

GEAR = 100.0
# Power of the gear by which a value behind it differs from that referred to the motor.
POWER = {"coulomb": 1, "stribeck": 1, "stribeck_speed": -1, "stribeck_power": 0, "viscous_asymmetry": 2, "drag": 3,
         "half_gap": -1, "hardening_twist": -1, "hardening_power": 0, "hardening": 0, "load_damping": -1}
CODES = ("backlash", "coulomb-load", "stribeck-load", "asymmetric-friction", "quadratic-drag",
         "hardening-stiffness", "load-dependent-damping")


@pytest.fixture(scope="module")
def bases():
    """A drive without gear, and one with, that moves its motor alike."""
    machine = machine_by_seed(23)
    record, _ = reversing_record(machine, 23)
    values = {"motor.inertia": machine.inertia[0], "motor.viscous": machine.viscous[0]}
    behind = {"load.inertia": machine.inertia[1], "load.viscous": machine.viscous[1],
              "shaft.stiffness": machine.stiffness[0], "shaft.damping": machine.damping[0]}
    found = []
    for gear in (1.0, GEAR):
        drive = two_mass().with_values({**values, **{n: v * gear**2 for n, v in behind.items()},
                                        "shaft.ratio": gear})
        task = Task(drive, tuple(n for n in drive.quantities if n in {*values, *behind}),
                    roles_of([record], drive), (record,))
        found.append(fit_from_start(task, max_iterations=0))
    return found


@pytest.mark.parametrize("code", CODES)
def test_a_cause_begins_alike_on_both_sides_of_a_gear(bases, code):
    plain, geared = (CAUSES[code].starts(base) for base in bases)
    assert plain and len(plain) == len(geared)
    masks, stands = all_samples(bases[0].problem), [reference_model(base) for base in bases]
    for one, other in zip(plain, geared, strict=True):
        assert one.task.free == other.task.free
        plain_start, geared_start = (prepare_start(stand, CAUSES[code], start, masks)
                        for stand, start in zip(stands, (one, other), strict=True))
        for j, name in enumerate(one.task.free):
            owner, _, what = name.rpartition(".")
            if name in bases[0].task.free:
                continue
            scale = 1.0 if owner == "motor" else GEAR ** POWER[what]
            if name not in one.amplitudes:
                plain_value, geared_value = (at.model.point.values[j] for at in (plain_start, geared_start))
                assert geared_value == pytest.approx(scale * plain_value, rel=1e-6), name
            allowed = one.task.drive.quantity(name).bounds  # of a unit, not of a drive
            for end in ("low", "high"):
                plain_value, geared_value = (getattr(at.model.problem, end)[j]
                                             for at in (plain_start, geared_start))
                if plain_value not in allowed:
                    assert geared_value == pytest.approx(scale * plain_value, rel=1e-6), name
        if np.isfinite(plain_start.expected_gain):
            assert geared_start.expected_gain == pytest.approx(plain_start.expected_gain, rel=1e-3, abs=1e-3)
