"""A transmission loss that the model lacks: the default fit finds it, and its inertias still hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from drivetool.drive import one_body, two_mass
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.laws.transmission import NAME
from drivetool.identify.setup.options import Options
from tests.recover import STEP, experiment, resonance
from tests.simulator.effects import Effects
from tests.simulator.experiments import multisine, trapezoids
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, at_rest
from tests.simulator.records import white_noise

FIRST_SEED, RECORDS = 673_000, 40
LOSSES = (0.0, 0.02, 0.05, 0.1)
SECONDS = 10.0
# Where the transmission drives it loses a share of the torque that enters; where it is driven, one of three laws.
DRIVEN = {
    "the same share": lambda loss: loss,
    "one efficiency": lambda loss: loss / (1.0 - loss),
    "the same share of what comes out": lambda loss: loss / (1.0 - 2.0 * loss),
}


def machine_of(seed, loss):
    """One body or two masses by turns; of one body a share of the inertia is in front of the transmission."""
    rng = np.random.default_rng(seed)
    inertia, rated = rng.uniform(0.01, 0.1), rng.uniform(3.0, 10.0)
    both = {"loss_driving": (loss,), "loss_driven": (DRIVEN[rng.choice(list(DRIVEN))](loss),)}
    coulomb, viscous = rated * rng.uniform(0.03, 0.1), rated / 100.0 * rng.uniform(0.02, 0.1)
    if seed % 2 == 0:
        effects = Effects(**both, rotor_inertia=inertia * rng.uniform(0.0, 0.6))
        return Machine((inertia,), (viscous,), (coulomb,), rated_torque=rated, effects=effects)
    load, rate = inertia * rng.uniform(0.5, 3.0), 2.0 * np.pi * rng.uniform(10.0, 40.0)
    reduced = inertia * load / (inertia + load)
    share = rng.uniform(0.3, 0.7)
    return Machine((inertia, load), (share * viscous, (1.0 - share) * viscous),
                   (share * coulomb, (1.0 - share) * coulomb), (0.0, 0.0), (reduced * rate**2,),
                   (2.0 * rng.uniform(0.02, 0.1) * reduced * rate,), rated_torque=rated, effects=Effects(**both))


def record_of(machine, seed):
    """Trapezoids of the speed of both signs, a weak multisine; gains and tops of their own."""
    rng = np.random.default_rng(seed + 10_000)
    rated, total = machine.rated_torque, sum(machine.inertia)
    size, top = round(SECONDS / STEP), rng.uniform(0.1, 0.25) * machine.rated_torque / total
    reference = trapezoids(top, rng.uniform(0.6, 1.2), rng.uniform(0.2, 0.5), SECONDS, STEP, seed)[:size]
    f = resonance(machine) if machine.bodies > 1 else 10.0
    excite = multisine(np.linspace(0.2, 2.0, 15) * f, rng.uniform(0.005, 0.02) * rated, SECONDS, STEP, seed)[:size]
    gain = rng.uniform(4.0, 10.0) * total
    run = simulate_fast(machine, excite, STEP, at_rest(machine), PI(reference, gain, 2.0 * gain, limit=rated),
                        white_noise(size, 0.002 * rated, 3 * seed),
                        sensor_noise=white_noise(size, 2e-3 * top, 3 * seed + 1))
    return experiment(run.command, run.measured)


def fitted(seed, loss):
    """(machine, estimate) of one record by the default fit, from values 15 % off."""
    machine = machine_of(seed, loss)
    signs = np.random.default_rng(seed + 20_000).choice([-0.15, 0.15], 6) + 1.0
    values = {"motor.inertia": machine.inertia[0] * signs[0], "motor.viscous": machine.viscous[0] * signs[1],
              "motor.coulomb": machine.coulomb[0] * signs[2]}
    drive = one_body().with_values(values)
    if machine.bodies == 2:
        drive = two_mass().with_values({
            "motor.inertia": values["motor.inertia"], "load.inertia": machine.inertia[1] * signs[3],
            "shaft.stiffness": machine.stiffness[0] * signs[4], "shaft.damping": machine.damping[0] * signs[5],
            "motor.viscous": machine.viscous[0], "load.viscous": machine.viscous[1],
            "motor.coulomb": machine.coulomb[0], "load.coulomb": machine.coulomb[1]})
    return machine, greybox([record_of(machine, seed)], drive, Options())


def results(loss, records):
    """(inertias that hold, their number, records in which the law is found, largest error over half width)."""
    held, found, largest = [], 0, 0.0
    for seed in range(FIRST_SEED, FIRST_SEED + records):
        machine, estimate = fitted(seed, loss)
        lines = {p.name: p for p in estimate.parameters}
        found += any(law.name.startswith(NAME) for law in estimate.laws)
        for name, value in zip(("motor.inertia", "load.inertia"), machine.inertia, strict=False):
            distance = abs(lines[name].value - value) / (1.96 * lines[name].std) if lines[name].std else np.inf
            held.append(distance <= 1.0)
            largest = max(largest, distance)
    return sum(held), len(held), found, largest


@pytest.mark.slow
def test_a_loss_of_a_tenth_is_found_and_the_inertias_hold():
    held, count, found, largest = results(0.1, 4)
    assert (count, found) == (6, 4) and held >= 5 and largest < 2.0


@pytest.mark.study
@pytest.mark.parametrize("loss", LOSSES)
def test_inertias_of_a_drive_with_an_unknown_loss(loss):
    """They hold in 85 % unless the whole 99 % interval of their share is below; without a loss none is found."""
    held, count, found, largest = results(loss, RECORDS)
    interval = binomtest(held, count).proportion_ci(0.99)
    print(f"\nloss {loss}: {held} of {count} inertias hold, {held / count:.3f}, 99 % {interval.low:.3f} to "
          f"{interval.high:.3f}; largest error {largest:.1f} half widths; the law is found in {found} of {RECORDS}")
    assert interval.high > 0.85
    assert binomtest(found, RECORDS).proportion_ci(0.99).low <= 0.01 or loss > 0.0
