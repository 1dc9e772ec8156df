"""The compiled kernel writes only into its arrays, and reads nothing outside them."""


import numpy as np
import pytest

from drivetool.drive.arrays.table import fields, packed
from drivetool.drive.effects.catalogue import EFFECTS
from drivetool.drive.simulation import simulate
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_effects import OUTPUTS, OWNER, SMOOTH, base, reversals
from tests.drive.test_kernel import STEP, THREE, drive_of, plant_of

pytestmark = pytest.mark.slow  # machine code of every size has to be compiled first

MARGIN = 64  # numbers before and after each array
MARGIN_FILL = {"float64": np.nan, "int64": 2**40 + 1}


class Fenced:
    """Tables whose arrays are copies between margins, which reveal reads and writes outside the arrays."""

    def __init__(self):
        self.kept = []

    def packed(self, values):
        inside = {}
        for name, number, dimensions in fields(type(values)):
            if dimensions:
                array = getattr(values, name)
                buffer = np.full(array.size + 2 * MARGIN, MARGIN_FILL[number.name], number)
                inside[name] = buffer[MARGIN:MARGIN + array.size].reshape(array.shape)
                inside[name][...] = array
                self.kept.append((name, buffer, inside[name], array))
        return packed(values._replace(**inside))

    def check(self):
        """Check the margins, and copy back what was written between them."""
        assert sum(array.size for _, _, _, array in self.kept) > 0
        for name, buffer, inside, array in self.kept:
            for margin in (buffer[:MARGIN], buffer[-MARGIN:]):
                np.testing.assert_array_equal(margin, np.full(MARGIN, MARGIN_FILL[buffer.dtype.name]), err_msg=name)
            if array.flags.writeable:
                array[...] = inside


@pytest.fixture
def fenced(monkeypatch):
    """A function that calls another with all arrays of the kernel between margins."""
    call = simulate.Plant._call

    def inside(function, *arguments):
        made = Fenced()

        def checked(plant, *given):
            events = call(plant, *given)
            made.check()
            return events

        with monkeypatch.context() as patch:
            patch.setattr(simulate, "packed", made.packed)
            patch.setattr(simulate.Plant, "_call", checked)
            return function(*arguments)

    return inside


def all_passes(drive, outputs, free, record, start):
    """All passes of the kernel: simulation and filter, with and without sensitivities and observer."""
    plant = plant_of(drive, outputs, free)
    n = len(outputs)
    out, states, _ = plant.simulate(record, start[:plant.nx], keep=True)
    filtered = plant.filter(record, start[:plant.nx], np.full(n, 1e-4), 1e-2, np.zeros(plant.system.nx))
    seen = plant.simulate(record, start[:plant.nx], filtered.gains)[0]
    free_run, slopes = plant.jacobian(record, start[:plant.nx])
    _, observed = plant.jacobian(record, start[:plant.nx], filtered.gains)
    return out, states, filtered.innovations, filtered.states, seen, free_run, slopes, observed


def assert_same_results(fenced, drive, outputs, free):
    """Compare runs with and without margins, some measurements missing."""
    torque = reversals(300)
    measured = np.random.default_rng(1).normal(0.0, 0.1, (len(torque), len(outputs)))
    measured[::7, 1] = np.nan
    record, start = Trace(torque[:, None], measured, STEP), np.array([0.5, -0.3, 0.012, *np.zeros(9)])
    given = drive, outputs, free, record, start
    for one, other in zip(fenced(all_passes, *given), all_passes(*given), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("law", ["inside", "always"])
@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.code)
def test_arrays_between_margins_give_the_same(effect, law, fenced):
    """Each effect acting, with its parameters fixed and free."""
    drive = base(law, **SMOOTH.get(effect.code, {}))
    names = [f"{OWNER[effect.of]}.{suffix}" for suffix in effect.quantities]
    names = [name for name in names if np.isfinite(drive.values.get(name, np.nan))]
    for free in ((), names):
        assert_same_results(fenced, drive, OUTPUTS, free)


def test_three_masses_between_margins_give_the_same(fenced):
    drive = drive_of(THREE)
    for free in ((), ("motor.inertia", "shaft2.stiffness", "shaft.half_gap", "gear.coulomb")):
        assert_same_results(fenced, drive, ("motor_speed", "arm_speed"), free)
