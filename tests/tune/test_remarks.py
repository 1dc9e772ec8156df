"""What tune says of the uncertainty of its figures and of a gap."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.estimate import Covariance
from drivetool.tune.gains import Design, TuneOptions
from drivetool.tune.optimisation.scenarios import Spread, draw, joint
from drivetool.tune.remarks import of_design, uncertainty
from drivetool.tune.simulation.hunting import Cycle, Watch
from drivetool.tune.speed_loop.loop import Settings, Wiring
from tests.tallfors import two_mass_plant

HEAVY = two_mass_plant("heavy")
EVERY = {n: 1e-3 * abs(HEAVY.value(n)) for n in HEAVY.values
         if n.endswith(("inertia", "stiffness", "damping", "dead_time", "bandwidth"))}
NONE = np.zeros(2)


def of_file(known=None, stds=None):
    """Codes about the uncertainty that a parameter file states."""
    options = TuneOptions(known=known, stds=stds or {}, draws=20)
    covariance = joint(HEAVY, options.known, options.stds)
    draws = draw(HEAVY, covariance, 20, 1) if covariance else None
    return [f.code for f in uncertainty(HEAVY, options, covariance, draws)]


def test_what_the_spread_leaves_out():
    assert of_file() == ["no-spread"]
    assert of_file(stds=EVERY) == []
    assert of_file(stds={"motor.inertia": EVERY["motor.inertia"]}) == ["spread-is-partial"]
    one = Covariance(("motor.inertia",), np.array([[EVERY["motor.inertia"] ** 2]]))
    assert of_file(one, EVERY) == ["drawn-without-correlation"]
    whole = Covariance(tuple(EVERY), np.diag(np.square(list(EVERY.values()))))
    assert of_file(whole, EVERY) == []


SPREAD = Spread(20, 0, 0, tuple(EVERY), 0.0, {"max_sensitivity": {"0.95": 2.01}}, {})
DESIGN = Design(Wiring(), Settings(2000.0, 0.05), 1.0, "sensitivity", None, None, (), SPREAD)


def codes(design, **options):
    return [f.code for f in of_design(HEAVY, design, TuneOptions(**options))]


def test_a_design_whose_spread_stays_near_its_limit_needs_no_word():
    assert codes(DESIGN) == []


def test_a_limit_that_the_uncertainty_exceeds():
    """Five per cent of the draws reach 2.5 where 2 is the limit; a design that was made for it is judged by fresh
    draws instead."""
    wide = replace(SPREAD, quantiles={"max_sensitivity": {"0.95": 2.5}}, above_limit=0.3)
    assert codes(replace(DESIGN, spread=wide)) == ["limit-uncertain"]
    assert codes(replace(DESIGN, spread=wide, kept=0.94), confidence=0.95) == []
    assert codes(replace(DESIGN, spread=wide, kept=0.8), confidence=0.95) == ["confidence-missed"]


def test_draws_that_are_unstable():
    assert codes(replace(DESIGN, spread=replace(SPREAD, unstable=3))) == ["unstable-draws"]


@pytest.mark.parametrize(("configuration", "hunts", "said"), [
    ("siso", True, ["loop-hunts"]), ("siso", False, ["gap-may-cycle"]),
    ("mimo", None, ["gap-may-cycle", "gap-not-simulated"])])
def test_a_gap_that_would_make_the_loop_unstable(configuration, hunts, said):
    """Above the gain that is stable at each stiffness; a loop with shaft-torque feedback is not watched."""
    watches = () if hunts is None else (Watch(Cycle("moving", hunts), *[NONE] * 5),)
    found = replace(DESIGN, wiring=Wiring(configuration), safe_gain=100.0, watches=watches)
    assert codes(found) == said
    assert codes(replace(found, safe_gain=None)) == (["loop-hunts"] if hunts else [])
