"""Whether a torque of known size acts on a drive with backlash."""

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.identifiability import only_ratios
from drivetool.identify.problem import Solution
from drivetool.identify.setup import Outcome, Task, first_point, roles_of
from tests.recover import STEP, experiment, truth
from tests.simulator.experiments import alternating
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import at_rest, machine_by_seed, running
from tests.simulator.records import white_noise


def rattling(seed, driven):
    """(machine, record) of 20 s in which torque steps rattle through a wide gap; else the drive coasts."""
    machine = machine_by_seed(seed, gap=1.0, idle_torque=(0.0, 0.0))
    size, rated = 20000, machine.rated_torque
    steps = alternating(0.0, (0.1 * rated, 0.3 * rated), (0.1, 0.4), 200, 0.2, STEP, seed)[:size]
    torque = steps if driven else np.zeros(size)
    run = simulate_fast(machine, torque, STEP, at_rest(machine) if driven else running(machine, 60.0), None,
                        white_noise(len(torque), 0.002 * rated, seed))
    noise = white_noise(len(torque), 0.0005 * rated / sum(machine.inertia), seed + 1)
    return machine, experiment(torque, run.speeds[:, 0] + noise)


@pytest.mark.parametrize("seed", [601, 605, 611, 613, 619, 620])
@pytest.mark.parametrize("driven", [True, False])
def test_torque_has_a_size_where_it_drives_a_rattling_drive(seed, driven):
    """The information of a free run over the whole record is rounding: sensitivities reach 1e20 and more."""
    machine, record = rattling(seed, driven)
    free = ("motor.inertia", "load.inertia", "total.viscous", "shaft.stiffness", "shaft.damping", "shaft.half_gap")
    values = {n: v for n, v in truth(machine).items() if n in free}
    drive = two_mass().with_values(values)
    fit = Task(drive, free, roles_of([record], drive), (record,))
    problem = fit.problem()
    point = first_point(drive, problem, fit.roles)
    outcome = Outcome(fit, problem, Solution(point, problem.normal(point), 1, True), None, (), True)
    assert only_ratios(outcome) != driven
