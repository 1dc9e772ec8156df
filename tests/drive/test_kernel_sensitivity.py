"""Sensitivities of the kernel against central differences of the kernel itself."""

from dataclasses import dataclass

import numpy as np
import pytest

from drivetool.drive.assemble import Assembly, Layout
from drivetool.drive.simulation.simulate import ObserverGains, Trace
from tests.drive.test_kernel import CHAIN, STEP, THREE, changed, drive_of, levels, plant_of, rms, start_of
from tests.simulator.machine import Machine, State, machine_by_seed

ERROR_BOUND = 1e-5
OUTPUTS = ("motor_speed", "load_speed", "shaft_torque", "motor_angle", "load_angle")
RIG = Machine((0.6, 5.2), (0.8, 0.3), (), (0.0, 8.0), (3300.0,), (3.1,), (0.01,), rated_torque=200.0)
RUBBING = changed(RIG, coulomb=(5.0, 4.0), viscous=(3.0, 1.0))
MOVING = State((0.5, 0.3), (0.012,))  # at rest, a start speed has no two-sided derivative


@dataclass(frozen=True)
class Case:
    """A drive and a record at which derivatives are taken."""

    machine: Machine
    torque: np.ndarray
    free: tuple[str, ...] = ()
    start: State | None = None
    outputs: tuple[str, ...] = OUTPUTS
    memory: float | None = None
    gains: ObserverGains | None = None

    def names(self):
        """Every parameter with a value, unless the case says otherwise."""
        return self.free or tuple(
            n for n, v in drive_of(self.machine).values.items()
            if not n.endswith(".order") and (v or n.endswith(("ratio", "viscous"))))

    def plant(self, values=None, gradient=True):
        """The drive with some values replaced."""
        drive = drive_of(self.machine)
        drive = type(drive)(**vars(drive) | {"values": {**drive.values, **(values or {})}})
        return plant_of(drive, self.outputs, self.names() if gradient else (), memory=self.memory)

    def begin(self, plant):
        """Start state, with a disturbance where there is one."""
        x = start_of(self.machine, plant, self.start)
        if self.memory is not None:
            x[-1] = 3.0
        return x

    def trace(self):
        """Measured outputs that are not the simulated ones."""
        rng = np.random.default_rng(3)
        return Trace(self.torque[:, None], rng.standard_normal((len(self.torque), len(self.outputs))), STEP)

    def outputs_at(self, values, shift=None):
        """(n, ny) outputs with changed parameters or start state."""
        plant = self.plant(values, gradient=False)
        x = self.begin(plant)
        return plant.outputs(self.trace(), x if shift is None else x + shift, self.gains)


def differences(case, column, plant):
    """(n, ny) central differences for several steps of a column: (step sizes, n, ny)."""
    names, values, found = case.names(), drive_of(case.machine).values, []
    for relative in (3e-4, 3e-5, 3e-6):
        if column < len(names):
            size = relative * max(abs(values[names[column]]), 1e-2)
            pair = [case.outputs_at({names[column]: values[names[column]] + s}) for s in (size, -size)]
        else:
            kind = state_names(case)[column - plant.system.nq].rpartition(".")[2]
            size = relative * {"twist": 1e-2, "rate": 1e3}.get(kind, 1.0)
            shift = np.eye(plant.system.nx)[column - plant.system.nq] * size
            pair = [case.outputs_at({}, s) for s in (shift, -shift)]
        found.append((pair[0] - pair[1]) / (2.0 * size))
    return found


def state_names(case):
    """Names of the states, in order."""
    layout = Layout((), ("motor_torque",), case.outputs, STEP, case.memory, gradient=False)
    return Assembly(drive_of(case.machine), layout).states


def largest_error(case):
    """Largest relative error over columns and outputs; best of three step sizes."""
    plant = case.plant()
    _, jac = plant.jacobian(case.trace(), case.begin(plant), case.gains)
    if case.gains is not None:
        jac = jac / case.gains.weight[:, :, None]
    nq, found = plant.system.nq, {}
    for column in [*range(len(case.names())), *range(nq, nq + plant.system.nx)]:
        tries = differences(case, column, plant)
        for m in range(len(case.outputs)):
            scale = max(rms(tries[0][:, m]), 1e-6 * max(rms(t) for t in tries))
            found[column, m] = min(rms(jac[:, m, column] - t[:, m]) for t in tries) / max(scale, 1e-12)
    return max(found.values())


ROTOR = Machine((2.0,), (0.3,), (1.7,), (0.4,), rated_torque=20.0)
REVERSALS = levels(RIG, 800, 4, share=0.1)
SEEDED = machine_by_seed(6, gap=0.1, friction=True)
CASES = {
    "linear": Case(machine_by_seed(3), levels(machine_by_seed(3), 300, 1)),
    "one body": Case(ROTOR, levels(ROTOR, 600, 5, share=0.5), start=State((0.5,), ()),
                     outputs=("motor_speed",)),
    "chain with converter and dead time": Case(
        CHAIN, np.repeat([20.0, -20.0, 5.0], 100), start=State((1.0, 0.5, 1.0), (0.01, 0.02), 0.3, 20.0)),
    "chain with converter of first order": Case(
        changed(CHAIN, converter_damping=np.inf), np.repeat([20.0, -20.0, 5.0], 100),
        start=State((1.0, 0.5, 1.0), (0.01, 0.02), 0.3, 20.0)),
    "gap inside": Case(RIG, levels(RIG, 500, 1)),
    "gap always": Case(changed(RIG, law="always"), levels(RIG, 500, 1)),
    "stick and slip": Case(changed(RUBBING, half_gap=(0.0,)), REVERSALS, start=MOVING),
    "gap, stick and slip": Case(RUBBING, REVERSALS, start=MOVING),
    "seeded": Case(SEEDED, levels(SEEDED, 600, 2), start=MOVING),
    "three bodies with everything": Case(
        THREE, levels(THREE, 300, 3), start=State((0.5, 0.3, -0.3), (0.012, 0.001))),
    "dead time with events": Case(
        changed(RUBBING, converter_bandwidth=433.0, dead_time=2.4 * STEP), REVERSALS, start=MOVING),
    "dead time alone lets go": Case(
        changed(RUBBING, dead_time=1.4 * STEP, half_gap=(0.0,)),
        np.repeat([4.0, 15.0, -1.0, -20.0], 100), start=MOVING),
    "memory of a disturbance": Case(RIG, levels(RIG, 400, 1), memory=0.97),
}


@pytest.mark.parametrize("name", CASES)
def test_sensitivities(name):
    assert largest_error(CASES[name]) < ERROR_BOUND


@pytest.mark.parametrize("coulomb", [(), (5.0, 4.0)], ids=["gap", "gap and friction"])
@pytest.mark.parametrize("outputs", [("motor_speed", "shaft_torque"), ("motor_speed", "load_speed")])
def test_sensitivities_under_an_observer(coulomb, outputs):
    """Gains and weights that change from sample to sample, some outputs not measured."""
    machine = changed(RIG, coulomb=coulomb)
    rng = np.random.default_rng(7)
    n = 300
    gain = rng.uniform(-0.02, 0.02, (n, 2, 3)) * [1.0, 1.0, 1e-3]
    gains = ObserverGains(gain, rng.uniform(0.5, 2.0, (n, 2)))
    case = Case(machine, levels(machine, n, 6), start=MOVING, outputs=outputs, gains=gains)
    assert largest_error(case) < ERROR_BOUND


def test_sensitivity_of_a_gap_of_zero():
    """One side only: a half gap cannot be negative."""
    machine = changed(RIG, half_gap=(0.0,), idle_torque=(0.0, 2.0))
    case = Case(machine, levels(RIG, 400, 1), ("shaft.half_gap",), MOVING)
    plant = case.plant()
    _, jac = plant.jacobian(case.trace(), case.begin(plant))
    size = 1e-6
    y0, y1, y2 = (case.outputs_at({"shaft.half_gap": k * size}) for k in range(3))
    ahead = (-3.0 * y0 + 4.0 * y1 - y2) / (2.0 * size)
    for m in range(5):
        assert rms(jac[:, m, 0] - ahead[:, m]) < 1e-4 * rms(ahead[:, m])


def test_a_start_speed_that_friction_holds_does_not_count():
    """At rest with a torque that friction holds: a start speed is gone before the next sample."""
    machine = changed(RUBBING, half_gap=(0.0,), idle_torque=())
    case = Case(machine, np.concatenate([np.full(50, 3.0), np.full(50, 30.0)]))
    plant = case.plant()
    _, jac = plant.jacobian(case.trace(), case.begin(plant))
    speeds = jac[1:, :, plant.system.nq:plant.system.nq + 2]
    assert np.all(speeds == 0.0) and np.all(jac[0, :2, plant.system.nq:plant.system.nq + 2] == np.eye(2))


@pytest.mark.parametrize("excess", [1e-3, 1e-9, 1e-12, 1e-15, 0.0])
def test_sensitivities_survive_release_and_capture(excess):
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,), damping=(3.1,))
    start = State((0.0, -5e-3), (-(5.0 + excess + 3.1 * 5e-3) / 3300.0,))
    plant = plant_of(drive_of(machine), OUTPUTS, ("motor.inertia", "motor.coulomb", "shaft.stiffness"))
    still = Trace(np.zeros((50, 1)), np.zeros((50, 5)), STEP)
    _, jac = plant.jacobian(still, start_of(machine, plant, start))
    assert np.abs(jac[:, 0]).max() < 2.0
