"""A resonance whose gain in likelihood is no more than that of a noise peak has no interval."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.recover import STEP, drive_like, experiment, resonance, truth
from tests.simulator.experiments import multisine, steps
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

SHAPE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")
SIZE = 6000


def record(machine, seed, excitation):
    """Slow steps of torque, and a multisine about the resonance whose share of the rated torque is `excitation`."""
    start, rated = running(machine, 20.0), machine.rated_torque
    torque = steps(start.torque, [0.08 * rated] * 8, (0.6, 1.0), 0.5, STEP, seed)[:SIZE]
    excited = multisine(np.linspace(0.3, 2.0, 9) * resonance(machine), rated, SIZE * STEP, STEP, seed)
    torque = torque + excitation * excited[:SIZE]
    run = simulate_linear(machine, torque, STEP, start, np.zeros(SIZE))
    sensor = 0.01 * rated * 0.25 / sum(machine.inertia)
    return experiment(torque, run.speeds[:, 0] + white_noise(SIZE, sensor, 7 * seed))


# On this machine the steps alone hardly excite the resonance: it is fast and the load inertia low.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 13])
def test_only_an_excited_resonance_has_intervals(seed):
    machine = machine_by_seed(seed, inertia=(1.0, 0.3), stiffness=(2.4e4,), damping=(8.0,), rated_torque=40.0,
                              idle_torque=(0.0, 2.0), viscous=(0.02, 0.006))
    drive = drive_like(machine, list(SHAPE), 0.1, seed).with_values(
        {n: truth(machine)[n] for n in ("total.viscous", "total.idle_torque")})
    quiet, excited = (greybox([record(machine, seed, s)], drive, Options()) for s in (0.0, 0.05))
    lines = {p.name: p for p in quiet.parameters}
    assert all(lines[n].status == "not-identifiable" and lines[n].ci95 is None for n in SHAPE)
    # One sentence for all four, not the values that each has at a noise peak.
    found = [f.code for f in quiet.findings if any(n in f.text for n in (*SHAPE, "resonance of shaft"))]
    assert found == ["shaft-not-identifiable"]
    assert not set(quiet.covariance.names) & set(SHAPE)
    total = lines["motor.inertia"].value + lines["load.inertia"].value
    assert total == pytest.approx(sum(machine.inertia), rel=0.01)
    assert [r.ci95 is not None for r in quiet.ratios] == [True]  # in one direction idle torque and Coulomb friction
    lines = {p.name: p for p in excited.parameters}
    assert all(lines[n].ci95[0] < truth(machine)[n] < lines[n].ci95[1] for n in SHAPE)
    assert "shaft-not-identifiable" not in {f.code for f in excited.findings}
