"""Modes that decay within a sample: a shaft damped so strongly that no record resolves it, with smooth laws."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import two_mass
from drivetool.drive.simulation import augment
from drivetool.drive.simulation.simulate import Trace

STEP, SIZE = 1e-3, 2000
LAWS = {
    "ripple": {"motor.ripple_cosine": 45.0, "motor.ripple_order": 7.3},
    "imbalance": {"load.imbalance_sine": 40.0},
    "stribeck": {"motor.coulomb": 20.0, "motor.stribeck": 15.0, "motor.stribeck_speed": 0.5},
    "drag": {"load.drag": 0.5},
    "hardening": {"shaft.hardening": 0.5, "shaft.hardening_twist": 0.01},
    "load-damping": {"shaft.load_damping": 20.0},
    "drift": {"motor.coulomb": 20.0, "motor.drift_coulomb": 10.0, "motor.drift_time": 1.0}}


def run(values, pieces=0):
    """(spans of a sample, motor speed (n,)) under steps of torque with noise."""
    rng = np.random.default_rng(1)
    torque = np.repeat(rng.uniform(-400.0, 400.0, SIZE // 50), 50) + 20.0 * rng.standard_normal(SIZE)
    drive = replace(two_mass(), values={
        "motor.inertia": 6.5, "load.inertia": 20.9, "motor.viscous": 1.9, "load.viscous": 1.9, **values})
    with pytest.MonkeyPatch.context() as patch:
        if pieces:
            patch.setattr(augment, "_pieces", lambda *_: pieces)
        plant = augment.plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), STEP, gradient=False))
    trace = Trace(torque[:, None], np.zeros((SIZE, 1)), STEP)
    return len(plant.system.part_lengths), plant.outputs(trace, np.zeros(plant.nx))[:, 0]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("shaft", [(22080.0, 66260.0), (1.3e6, 823300.0)], ids=["13 a sample", "170 a sample"])
def test_few_pieces_are_as_good_as_many(law, shaft):
    """A decayed mode does not oscillate: many pieces would only cost time."""
    values = {"shaft.stiffness": shaft[0], "shaft.damping": shaft[1], **LAWS[law]}
    spans, speed = run(values)
    _, exact = run(values, 20)
    assert spans <= 3
    assert np.abs(speed - exact).max() < 1e-6 * np.abs(exact).max()


def test_what_swings_is_cut_as_fine_as_before():
    spans, _ = run({"shaft.stiffness": 3e7, "shaft.damping": 50.0, **LAWS["drag"]})
    assert spans == pytest.approx(np.sqrt(3e7 * (1.0 / 6.5 + 1.0 / 20.9)) * STEP / augment.MAX_PIECE_RATE, abs=1.0)
