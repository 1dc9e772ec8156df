"""The findings of tune on the uncertainty of its figures and on backlash."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.estimate import Covariance
from drivetool.tune.gains import Design, TuneOptions
from drivetool.tune.optimisation.scenarios import FigureSpread, draw_drives, joint_covariance
from drivetool.tune.remarks import design_findings, spread_findings
from drivetool.tune.simulation.limit_cycle import DisturbanceResponse
from drivetool.tune.speed_loop.loop import Settings, Wiring
from tests.tallfors import two_mass_plant

HEAVY = two_mass_plant("heavy")
LOOP_STDS = {n: 1e-3 * abs(HEAVY.value(n)) for n in HEAVY.values
             if n.endswith(("inertia", "stiffness", "damping", "dead_time", "bandwidth"))}
NO_SAMPLES = np.zeros(2)


def uncertainty_codes(known=None, stds=None):
    """Codes of the findings on the uncertainty that a parameter file states."""
    options = TuneOptions(known=known, stds=stds or {}, draws=20)
    covariance = joint_covariance(HEAVY, options.known, options.stds)
    draws = draw_drives(HEAVY, covariance, 20, 1) if covariance else None
    return [f.code for f in spread_findings(HEAVY, options, covariance, draws)]


def test_what_the_spread_leaves_out():
    assert uncertainty_codes() == ["covariance-incomplete"]
    assert uncertainty_codes(stds=LOOP_STDS) == []
    assert uncertainty_codes(stds={"motor.inertia": LOOP_STDS["motor.inertia"]}) == ["covariance-incomplete"]
    single_parameter = Covariance(("motor.inertia",), np.array([[LOOP_STDS["motor.inertia"] ** 2]]))
    assert uncertainty_codes(single_parameter, LOOP_STDS) == ["covariance-incomplete"]
    all_parameters = Covariance(tuple(LOOP_STDS), np.diag(np.square(list(LOOP_STDS.values()))))
    assert uncertainty_codes(all_parameters, LOOP_STDS) == []


SPREAD = FigureSpread(20, 0, 0, list(LOOP_STDS), 0.0, {"max_sensitivity": {"0.95": 2.01}}, {})
DESIGN = Design(Wiring(), Settings(2000.0, 0.05), 1.0, "sensitivity", None, None, (), SPREAD)


def design_codes(design, **options):
    return [f.code for f in design_findings(HEAVY, design, TuneOptions(**options))]


def test_a_design_whose_spread_stays_near_its_limit_needs_no_word():
    assert design_codes(DESIGN) == []


def test_a_limit_that_the_uncertainty_exceeds():
    """Five per cent of the draws reach 2.5 where 2 is the limit; a robust design is tested with fresh draws
    instead."""
    wide = SPREAD.replace(quantiles={"max_sensitivity": {"0.95": 2.5}}, above_limit=0.3)
    assert design_codes(replace(DESIGN, spread=wide)) == ["limit-uncertain"]
    assert design_codes(replace(DESIGN, spread=wide, kept=0.94), confidence=0.95) == []
    assert design_codes(replace(DESIGN, spread=wide, kept=0.8), confidence=0.95) == ["limit-uncertain"]


def test_draws_that_are_unstable():
    assert design_codes(replace(DESIGN, spread=SPREAD.replace(unstable=3))) == ["unstable-draws"]


@pytest.mark.parametrize(("configuration", "has_cycle", "expected_codes"), [
    ("siso", True, ["limit-cycle"]), ("siso", False, ["limit-cycle"]),
    ("mimo", None, ["limit-cycle", "shaft-feedback-not-evaluated"])])
def test_a_gap_that_would_make_the_loop_unstable(configuration, has_cycle, expected_codes):
    """Above the gain that is stable at each stiffness; a loop with shaft-torque feedback is not simulated."""
    watches = () if has_cycle is None else (
        DisturbanceResponse("moving", has_cycle, 0.0, 0.0, 0.0, 0.0, 0.0, *[NO_SAMPLES] * 5),)
    found = replace(DESIGN, wiring=Wiring(configuration), safe_gain=100.0, watches=watches)
    assert design_codes(found) == expected_codes
    assert design_codes(replace(found, safe_gain=None)) == (["limit-cycle"] if has_cycle else [])
