"""How much a lead in log likelihood says, and what takes its word away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erfc, erfcx

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.significance import SEARCHED_HYPOTHESES, log_chi2_tail
from drivetool.check.heldout.folds import blocks_of
from drivetool.check.heldout.free_run_error import FreeRuns, blocks_under_test, gain_of
from drivetool.check.heldout.samples import Samples
from drivetool.check.heldout.scores import Score, log_scanned_values, total_evidence, training_evidence
from drivetool.check.search import candidate_report, heldout_test, search as searching
from drivetool.check.search.candidate_fit import CandidateFit
from drivetool.check.search.decision import Decision, decide, is_equivalent
from drivetool.check.search.result import Base
from drivetool.drive.simulation import Filtered, Trace
from drivetool.identify.noise import minus_log_likelihood
from tests.check.models import Unfolded, model_of, true_model
from tests.diagnosed import gain

BASE = Base(true_model(), ())
AGREES, DISAGREES = np.full(8, 2.0) + 0.1 * np.arange(8), np.full(8, -1.0)


def score(lead, gains=AGREES, further=1, code="quadratic-drag", ratio=-30.0, frees="load.drag"):
    model = model_of(code, free=("motor.inertia", frees))
    return Score(model, gains, (ratio, ratio), (0.0, 0.0), (model, model), lead, further)


@pytest.mark.parametrize("lead", [5.0, 12.0, 20.0])
def test_of_one_parameter_the_chance_is_that_of_a_normal_variable(lead):
    assert np.exp(-training_evidence(score(lead))) == pytest.approx(SEARCHED_HYPOTHESES * erfc(np.sqrt(lead)),
                                                                    rel=1e-9)


@pytest.mark.parametrize("x", [600.0, 1100.0, 1200.0, 1e4, 1e6])
def test_evidence_is_a_number_however_strong_it_is(x):
    """The share itself is zero beyond 1480: erfc for one degree, exp(-x/2) for two, (1 + x/2) of that for four."""
    assert log_chi2_tail(x, 1) == pytest.approx(np.log(erfcx(np.sqrt(0.5 * x))) - 0.5 * x, abs=1e-5)
    assert log_chi2_tail(x, 2) == pytest.approx(-0.5 * x, abs=1e-9 * x)
    assert log_chi2_tail(x, 4) == pytest.approx(np.log1p(0.5 * x) - 0.5 * x, abs=1e-5)
    assert decide([score(0.5 * x)], 0.01).evidence > 60.0


def test_more_parameters_need_a_larger_lead():
    found = [training_evidence(score(20.0, further=n)) for n in (1, 2, 3)]
    assert found[0] > found[1] > found[2]


def test_the_lead_counts_for_nothing_where_the_samples_held_out_disagree():
    assert training_evidence(score(200.0, DISAGREES)) == -np.inf
    assert decide([score(200.0, DISAGREES)], 0.01).best is None


@pytest.mark.parametrize(("gains", "sure"), [
    ([10.1, -1.5, 0.9, 1.7, -1.2, 55.7, 0.9, -0.3], True),  # one block shows most of it, the others agree
    ([0.2, -0.4, 0.1, 0.3, -0.2, 55.7, 0.1, -0.1], False),  # the others say nothing
    ([14.0, -9.0, 3.0, 5.0, -7.0, 20.0, 1.0, -2.0], False),  # some speak against it
    ([30.0, 40.0, -9.0, 35.0, 45.0, 25.0, 50.0, 20.0], True),  # by the standard error
    (AGREES, True), (DISAGREES, False)])
def test_blocks_are_sure_where_hardly_one_loses_by_what_others_gain(gains, sure):
    assert score(200.0, np.array(gains)).sure == sure


def test_what_a_search_ended_with_is_decided_on_by_any_name():
    """Where nothing but the base is left at its end, too."""
    assert decide([score(200.0, code="base")], 0.01).best.model.code == "base"


def test_a_cause_that_ran_away_has_a_line_without_values(monkeypatch):
    def fails(*_):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(candidate_report, "added_parameters", fails)
    base, found = BASE.model, score(200.0)
    found = replace(found, model=replace(found.model, value=base.value - 200.0, problem=base.problem))
    tried = CandidateFit(CAUSES[found.model.code], found.model, {})
    (line,) = candidate_report.candidate_results([tried], [found], decide([found], 0.01), base, 0.0, {})
    assert (line.state, line.parameters) == ("named", {}) and line.gain == found.gain


def test_a_small_lead_behind_a_large_gain_may_be_an_inexact_law():
    assert np.isfinite(training_evidence(score(25.0), gained=500.0))
    assert training_evidence(score(25.0), gained=1000.0) == -np.inf


def test_a_law_is_no_discovery_where_its_special_case_is_as_likely():
    """On data held out it came out ahead, fitted under another noise."""
    simple = score(500.0, AGREES, code="coulomb-load")
    for lead, named in ((503.0, "coulomb-load"), (505.0, "stribeck-load")):
        general = score(lead, 1.5 * AGREES, further=3, code="stribeck-load")
        assert decide([simple, general], 0.01).best.model.code == named


def test_a_special_case_in_a_worse_optimum_restarts_from_the_end_of_the_law(monkeypatch):
    """Dry friction of 29 % of the rated torque, given up after a few steps, was named breakaway friction."""
    calls = []

    def refitted(simple, general, *_):
        calls.append((simple.cause.code, general.cause.code))
        return simple if simple.cause.code == "coulomb-motor" else replace(simple, reason="again")

    monkeypatch.setattr(searching, "as_special_case", refitted)
    tried = {c: CandidateFit(CAUSES[c], None, {}) for c in (
        "coulomb-motor", "coulomb-load", "stribeck-motor", "stribeck-load", "imbalance")}
    search = Unfolded()
    search._special_cases(search.root, tried)
    assert calls == [("coulomb-motor", "stribeck-motor"), ("coulomb-load", "stribeck-load")]
    assert {c for c, t in tried.items() if t.reason} == {"coulomb-load"}  # what is no better stays as it was


@pytest.mark.parametrize(("lead", "tied"), [(300.0, True), (290.0, False)])
def test_rivals_that_look_alike_tie_where_the_whole_record_is_as_likely(lead, tied):
    best = score(300.0, 2.0 * AGREES, code="dead-time")
    for gains in (1.2 * AGREES, -0.1 * AGREES):  # whatever half of the record said of the other half
        assert is_equivalent(score(lead, gains, code="converter-lag"), best) == tied
    assert not is_equivalent(score(lead, 1.2 * AGREES), best)  # others are separated by held-out data


@pytest.mark.parametrize(("lead", "tied"), [(275.0, True), (200.0, False)])
def test_where_blocks_decide_by_half_the_whole_record_may_decide(lead, tied):
    """Blocks scatter by more than they differ on average: then a tenth of the best cause's gain decides."""
    scattered = 20.0 + 100.0 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    best = score(300.0, 60.0 + scattered, code="backlash")
    assert is_equivalent(score(lead, np.full(8, 60.0), code="hardening-stiffness"), best) == tied
    assert is_equivalent(score(lead, np.full(8, 60.0), code="quadratic-drag"), best)  # by data held out alone


@pytest.mark.parametrize(("rival", "tied"), [("converter-lag", True), ("dead-time", False)])
def test_where_noise_enters_does_not_separate_a_lag_from_a_filter(rival, tied):
    """As little as the motion does: a lag of the torque makes that of a filter, and a dead time does not."""
    best, one = score(300.0, 2.0 * AGREES, code="speed-filter"), score(100.0, 0.1 * AGREES, code=rival)
    assert is_equivalent(one, best, lambda *_: True) is tied
    assert not is_equivalent(one, best)


def test_records_without_a_cause_are_not_found_more_often_than_the_budget_says():
    """The lead of one parameter that is looked at LOOKED times is at most this large, but for a share of them."""
    rng = np.random.default_rng(11)
    most = [0.5 * np.max(rng.standard_normal(int(SEARCHED_HYPOTHESES)) ** 2) for _ in range(300)]
    found = [decide([score(lead)], 0.05).best is not None for lead in most]
    assert np.mean(found) < 0.05
    assert decide([score(22.0)], 0.05).best is not None


def test_a_cause_that_is_picked_from_a_list_counts_as_one_parameter():
    assert training_evidence(score(20.0, further=0)) == training_evidence(score(20.0, further=1))


def gain_to(after, scatter=0.0):
    return gain(1.0, after, bar=scatter)


@pytest.fixture
def run_decision(monkeypatch):
    """Decides on scores by a given free-run gain per cause; of the requested causes, by default all."""
    def decided(decision, scores, gains, gained=0.0, wanted=("first", "second")):
        monkeypatch.setattr(heldout_test, "gain_between", lambda _, after, *more: gains[after[0].code])
        return heldout_test.apply_heldout_test(decision, scores, BASE, None, gained, 0.01, wanted)

    return decided


@pytest.mark.parametrize(("first", "second", "gained", "best", "against"), [
    (gain_to(0.9), gain_to(0.5), 1e4, "first", set()),
    (gain_to(1.05), gain_to(0.5), 1e4, "first", set()),  # a little is no objection
    (gain_to(1.3, 0.4), gain_to(0.5), 1e4, "first", set()),  # nor what scatters as much
    (gain_to(1.3, 0.1), gain_to(0.9), 1e4, "second", {"first"}),
    (gain_to(1.3), gain_to(1.2), 1e4, None, {"first", "second"}),
    (gain_to(1.3), gain_to(1.2), 10.0, "first", set()),  # much by itself: no makeshift for what came before
    (gain_to(11.0, 9.0), gain_to(0.9), 0.0, "second", {"first"}),  # runs away
    (gain_to(2.2, 0.3), gain_to(0.9), 0.0, "second", {"first"}),  # doubles the error
    (gain_to(2.2, 0.7), gain_to(0.9), 0.0, "first", set()),  # that may be scatter
    (gain_to(0.5), gain_to(1.3, 0.1), 1e4, "first", {"second"}),  # what ties is held against the same
])
def test_a_small_cause_that_worsens_the_free_run_is_not_named(run_decision, first, second, gained, best, against):
    """first has the larger gain per step; gains are stood in for."""
    scores = [score(300.0, 2.0 * AGREES, code="first"), score(290.0, code="second", ratio=30.0)]
    decision = Decision(scores[0], ("first", "second"), 100.0)
    found, objected = run_decision(decision, scores, {"first": first, "second": second}, gained)
    assert (found.best and found.best.model.code) == best and set(objected) == against
    assert set(found.between) == ({"first", "second"} - against if best else set())


def test_what_ties_with_a_cause_that_is_dropped_must_be_found_by_itself(run_decision):
    for ratio, best in ((30.0, "second"), (-5.0, None)):
        scores = [score(300.0, 2.0 * AGREES, code="first"), score(6.0, code="second", ratio=ratio)]
        decision = Decision(scores[0], ("first", "second"), 100.0)
        found, _ = run_decision(decision, scores, {"first": gain_to(1.3), "second": gain_to(0.9)}, 1e4)
        assert (found.best and found.best.model.code) == best


@pytest.mark.parametrize(("blocks", "gained", "frees", "named"), [
    ([2, -5, 4, 5, -2, 2, 1, 40], 2000.0, "motor.ripple_order", False),  # one rattle that the gap before it missed
    ([0, 0, 0, 0, 0, 0, 0, 40], 2000.0, "load.step_time", True),  # an event is in one place
    ([0, 0, 0, 25, 0, 0, 0, 22], 2000.0, "shaft.half_gap", True),
    ([0, 0, 0, 0, 0, 0, 0, 40], 0.0, "shaft.half_gap", True),  # nothing before it that could be inexact
    ([0, 0, 0, 0, 0, 0, 0, 399], 2000.0, "shaft.half_gap", False),
    ([0, 0, 0, 0, 0, 0, 0, 401], 2000.0, "shaft.half_gap", True)])  # much by itself
def test_a_small_cause_that_gains_in_one_place_only_is_not_named(run_decision, blocks, gained, frees, named):
    only = score(300.0, np.array(blocks, float), code="first", frees=frees)
    found, objected = run_decision(Decision(only, ("first",), 100.0), [only], {"first": gain_to(0.5)}, gained)
    assert (found.best is only) == named and ("first" in objected) != named


@pytest.mark.parametrize(("share", "after", "best"), [
    (0.6, 0.5, "second"), (0.4, 0.5, "first"), (0.0, 0.95, "first")])
def test_what_quantisation_explains_as_well_is_not_named(monkeypatch, run_decision, share, after, best):
    """The first gains this share on records made up without it; a ripple hardly shows in free runs of an angle."""
    scores = [score(300.0, 2.0 * AGREES, code="first"), score(290.0, code="second", ratio=30.0)]
    monkeypatch.setattr(heldout_test, "gain_from_quantisation", lambda _, cause,
                        __: share * 300.0 if cause.code == "first" else 0.0)
    gains = {"first": gain_to(after, 0.1), "second": gain_to(0.5, 0.1)}
    found, objected = run_decision(Decision(scores[0], ("first", "second"), 100.0), scores, gains)
    assert found.best.model.code == best and set(objected) == ({"first"} if best == "second" else set())
    assert found.between == (("second",) if best == "second" else ("first", "second"))


def test_a_cause_behind_a_base_of_another_noise_is_not_attributed_to_quantisation(run_decision):
    """Records made up show nothing; the base leads on the samples that both were fitted to."""
    only = score(-3.0, 2.0 * AGREES, code="first", ratio=30.0)
    found, objected = run_decision(Decision(only, ("first",), 100.0), [only], {"first": gain_to(0.5)})
    assert found.best is only and not objected


def test_either_way_of_finding_costs_half_of_the_budget():
    assert total_evidence([score(0.0, ratio=7.0)]) == pytest.approx(7.0 - np.log(2.0))
    assert total_evidence([score(30.0)]) == pytest.approx(training_evidence(score(30.0)) - np.log(2.0))
    assert total_evidence([]) == -np.inf


def test_a_filter_that_ran_away_has_no_likelihood_and_raises_no_warning():
    runaway = Filtered(None, np.array([[1e200], [1.0]]), np.ones((2, 1)), np.zeros((2, 1)))
    assert minus_log_likelihood([runaway]) == np.inf


def test_of_two_as_good_the_requested_one_is_taken(run_decision):
    scores = [score(300.0, 2.0 * AGREES, code="first"), score(290.0, code="second")]
    gains = dict.fromkeys(("first", "second"), gain_to(0.5))
    found, _ = run_decision(Decision(scores[0], ("first", "second"), 100.0), scores, gains, wanted={"second"})
    assert found.best.model.code == "second" and found.between == ("first", "second")


@pytest.mark.parametrize(("possible", "expected"), [
    ({"dead-time", "speed-filter", "converter-lag"}, {"dead-time", "speed-filter"}),
    ({"dead-time", "converter-lag"}, {"dead-time"})])
def test_what_looks_like_a_cause_is_tried_unless_the_record_rules_it_out(monkeypatch, possible, expected):
    """An angle logged with the speed shows that the speed is not filtered."""
    tried_codes = []

    class Tried(Unfolded):
        def _fit_candidates(self, node, among, *_):
            tried_codes.append({c.code for c in among})
            return [CandidateFit(c, None, {}) for c in among]

        def _cross_validated(self, node, tried):
            return [score(200.0, AGREES + (t.cause.code == "converter-lag"), code=t.cause.code) for t in tried]

    monkeypatch.setattr(searching, "candidate_results", lambda *_: ())
    monkeypatch.setattr(searching, "apply_heldout_test", lambda decision, *_: (replace(decision, best=None), {}))
    search = Tried({"converter-lag"}, possible)
    found = search.expand(search.root, 0.01)
    assert tried_codes == [{"converter-lag"}, expected] and len(found.scores) == 1 + len(expected)


def test_what_the_whole_record_was_searched_for_has_its_price_once():
    """The order of a ripple is found with the test samples in sight; in a later round the base has it."""
    plain, ripple, drag, both = (model_of(free=("motor.inertia", *more)) for more in (
        (), ("motor.ripple_sine", "motor.ripple_order"), ("load.drag",),
        ("motor.ripple_sine", "motor.ripple_order", "load.drag")))
    assert log_scanned_values(ripple, plain) > np.log(100.0)
    assert log_scanned_values(drag, plain) == log_scanned_values(both, ripple) == 0.0


@pytest.mark.parametrize(("differences", "tied"), [
    ([5.6, 93.6, -0.3, 3.6, 13.4, 78.2, 10.2, 4.5], False),  # two blocks contribute most, and all but one agree
    ([56.0, 93.6, -40.0, -30.0, 13.4, 78.2, 10.2, 4.5], True),  # within twice the scatter
    ([0.1, 0.2, 0.1, 0.3, 0.2, 9.0, 0.2, 6.0], True),  # of one mind about hardly anything
    ([20.0, 22.0, 21.0, 25.0, 24.0, 20.0, 23.0, 22.0], False)])
def test_two_causes_are_separated_where_the_blocks_agree(differences, tied):
    best = score(500.0, np.full(8, 100.0))
    assert is_equivalent(score(450.0, best.gains - np.array(differences), code="other"), best) is tied


def test_known_look_alikes_are_separated_by_their_whole_scatter_only():
    best = score(500.0, np.full(8, 100.0), code="speed-filter")
    lag = score(450.0, best.gains - [2.8, 6.5, 0.4, 0.4, 23.9, 2.2, -1.3, 2.6], code="converter-lag")
    assert is_equivalent(lag, best)


def test_free_runs_skip_blocks_without_a_measurement():
    outputs = np.zeros((12000, 1))
    outputs[7000:] = np.nan
    trace = Trace(np.zeros((12000, 1)), outputs, 1e-3)
    seen = blocks_under_test(Samples([], [np.ones(12000, bool)], []), (trace,))
    assert 0 < len(seen) < len(blocks_of((trace,))) and all(np.isfinite(t.outputs).any() for t in seen)


@pytest.mark.parametrize(("after", "coverage"), [(0.01, (0.93, 0.97)), (0.5, (0.93, 0.97))])
def test_the_interval_of_a_gain_holds_the_gain_on_a_fresh_record(after, coverage):
    """What the base errs beyond the better model differs by a factor between records, 95 % of them within 1.75."""
    rng = np.random.default_rng(12)
    low, high = gain(1.0, np.sqrt(after), std=0.01, blocks=8).further_record_interval
    beyond = (1.0 - after) * 1.75 ** (2.0 * rng.normal(size=4000) / 1.96)
    true = np.sqrt(after + beyond) - np.sqrt(after)
    assert coverage[0] <= np.mean((low <= true) & (true <= high)) <= coverage[1]


@pytest.mark.parametrize(("std", "low", "high"), [(0.29, 0.343, 1.05), (0.31, -0.5, 1.7)])
def test_blocks_of_an_insignificant_gain_widen_its_interval(std, low, high):
    made = gain(0.6, 0.0, std=std, blocks=8)
    assert made.further_record_interval == pytest.approx((low, high), abs=0.05)


@pytest.mark.parametrize(("before", "after", "low", "high"), [
    (1.0, 0.0, 1.0 / 1.75, 1.75), (5.0, 4.0, np.hypot(4.0, 3.0 / 1.75) - 4.0, np.hypot(4.0, 3.0 * 1.75) - 4.0),
    (4.0, 5.0, 4.0 - np.hypot(4.0, 3.0 * 1.75), 4.0 - np.hypot(4.0, 3.0 / 1.75))])
def test_what_the_worse_model_errs_beyond_the_better_differs_between_records(before, after, low, high):
    made = gain(before, after, std=1e-9, blocks=8)
    assert made.further_record_interval == pytest.approx((low, high), rel=1e-6)


def test_a_gain_that_does_not_scatter_has_no_interval():
    same = FreeRuns((np.zeros(2),) * 8, (np.ones(2),) * 8)
    assert gain_of(same, same, "rad/s", 1.5, 0.1, 0.0).further_record_interval is None
