"""The default fit across a gap: free runs confirm laws, start another fit, and contribute to the interval."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.laws import across_gap, law_selection
from drivetool.identify.laws.across_gap import laws_reduce_free_run_error, optimum_confirmed, restart_from_free_runs
from drivetool.identify.laws.candidates import CandidateSet
from drivetool.identify.laws.explanation import parameter_uncertainty
from drivetool.identify.laws.free_run_test import FREE_RUN_LENGTH
from drivetool.identify.laws.laws import Law
from drivetool.identify.motion.linear import INFLUENCE_BLOCKS
from drivetool.identify.problem.least_squares import solve
from drivetool.identify.problem.problem import Normal, Point
from drivetool.identify.setup.task import Outcome, Task, run_length
from tests.study.shared.command import greybox
from tests.study.two_masses.estimators import NAMES, start_values
from tests.study.two_masses.record import STEP, draw

FREE = ("motor.inertia", "motor.coulomb", "shaft.half_gap")


def task(gap=0.01, free=FREE, step=1e-3):
    return Task(two_mass().with_values({"shaft.half_gap": gap}), free, None, (SimpleNamespace(step=step),))


def outcome(value, numbers, starts=(), of=None):
    """A fit of two parameters whose cost is one per degree of freedom, the curvature the unit matrix."""
    normal = Normal(np.eye(2), (), (), np.zeros(2), (), 100.0)
    problem = SimpleNamespace(count=102, unknowns=2, variance=lambda cost: cost / 100.0)
    solution = SimpleNamespace(point=Point(np.array(numbers), ()), normal=normal, cost=100.0)
    made = of or SimpleNamespace(free=("a", "b"), at_point=lambda point: point)
    return Outcome(made, problem, solution, SimpleNamespace(value=value), tuple(starts), True)


@pytest.mark.parametrize("gap, free, seconds", [(0.0, FREE[:2], 1.0), (0.01, FREE[:2], 0.2), (0.0, FREE, 0.2)])
def test_free_runs_are_short_where_a_gap_acts_or_is_fitted(gap, free, seconds):
    assert run_length(task(gap, free), FREE_RUN_LENGTH) == seconds
    assert run_length(task(gap, free, step=0.1), FREE_RUN_LENGTH) == 2.0  # twenty samples, whatever the drive


@pytest.mark.parametrize("ratio, straight, wanted", [
    (1.15, 1.0, False), (1.25, 1.0, True), (1.0 / 1.25, 1.0, False), (9.0, 0.0, False)])
def test_laws_are_confirmed_by_a_smaller_error_of_free_runs(ratio, straight, wanted):
    judge = SimpleNamespace(error=lambda point: float(point.values[0]), straight_line_error=lambda task: straight)
    without, with_them = outcome(0.0, [ratio, 0.0]), outcome(-1e6, [1.0, 0.0])
    assert laws_reduce_free_run_error(judge, without, with_them) is wanted


def sums_that_gain(much):
    """A stand-in for the sums of products: a parameter, and a law whose log likelihood gains so much."""
    correlation = np.sqrt(1.0 - np.exp(-2.0 * much / 1000.0))
    one = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, correlation], [0.0, correlation, 1.0]])
    return np.repeat(one[None], law_selection.FOLDS, axis=0)


@pytest.mark.parametrize("drive, gain, taken", [
    (one_body(), 12.0, False), (one_body(), 18.0, True),
    (two_mass().with_values({"shaft.half_gap": 0.01}), 32.0, False),
    (two_mass().with_values({"shaft.half_gap": 0.01}), 48.0, True)])
def test_a_law_must_gain_more_across_a_gap(monkeypatch, drive, gain, taken):
    monkeypatch.setattr(law_selection, "_sums", lambda *_: sums_that_gain(gain))
    law = Law("a law", (np.zeros((1, 1)),), "idle torque", body="motor")
    made = SimpleNamespace(drive=drive, free=("motor.inertia",), problem=lambda: SimpleNamespace(count=1000))
    assert (law_selection.select_laws(made, None, None, [law])[0] == [law]) is taken


@pytest.mark.parametrize("value, numbers, likelier, agree", [
    (2.0, [1.0, 3.0], False, True),  # the same place
    (2.0, [1.0, 13.0], False, False),  # as likely, and elsewhere
    (-0.5, [1.0, 13.0], False, False), (90.0, [1.0 + 1e-7, 2.0], False, True), (-2.0, [1.0, 3.0], True, True),
    (-90.0, [1.0, 13.0], True, False)])
def test_the_descent_from_free_runs_confirms_or_is_taken(monkeypatch, value, numbers, likelier, agree):
    best = outcome(0.0, [1.0, 2.0], [{"reached": {"a": 1.0, "b": 2.0}, "apart": 0.0,
                                      "minus_log_likelihood_above_best": 0.0}])
    other = outcome(value, numbers, of=best.task)
    monkeypatch.setattr(across_gap, "near", lambda task, before: other)
    found = restart_from_free_runs(best, best.task)
    assert found.fit.value == (value if likelier else 0.0) and (found.solution is other.solution) is likelier
    last = found.starts[-1]
    assert len(found.starts) == 2
    assert (last["minus_log_likelihood_above_best"] < 5.0 and last["apart"] < 20.0) is agree


@pytest.mark.parametrize("starts, ways", [
    ([{"reached": {"a": 1.0}}] * 2, ["best", "free runs"]),  # fewer were free in the search
    ([], ["best", "free runs"]),  # none was made
    ([{"reached": {"a": 1.0, "b": 2.0}}] * 2, ["found", "found", "free runs"])])
def test_of_a_drive_with_more_free_the_search_says_nothing(monkeypatch, starts, ways):
    best = outcome(0.0, [1.0, 2.0], [{"way": "found", "minus_log_likelihood_above_best": 0.0, **s} for s in starts])
    monkeypatch.setattr(across_gap, "near", lambda task, before: outcome(90.0, [9.0, 9.0], of=best.task))
    assert [s["way"] for s in restart_from_free_runs(best, best.task).starts] == ways


@pytest.mark.parametrize("starts, wanted", [
    ([(0.0, 0.0), (4.0, 15.0)], True), ([(0.0, 0.0), (6.0, 15.0)], False), ([(0.0, 0.0), (4.0, 25.0)], False),
    ([(0.0, None)], True)])  # a fit from one place, that was confirmed
def test_two_starts_confirm_a_place(starts, wanted):
    earlier = [{"minus_log_likelihood_above_best": behind} | ({} if far is None else {"apart": far})
            for behind, far in starts]
    assert optimum_confirmed(outcome(0.0, [1.0, 2.0], earlier)) is wanted


def test_free_runs_are_the_only_candidate_and_none_for_friction():
    made = task()
    rng = np.random.default_rng(1)
    blocks = 1e-6 * rng.standard_normal((INFLUENCE_BLOCKS, 3))

    def candidate(*own):
        return SimpleNamespace(own=np.array(own), influence=blocks, covariance=None, blocks=np.full(3, np.inf))

    field = CandidateSet({"coloured, laws": candidate(1.0, 1.0, 1.0), "white, laws": candidate(3.0, 3.0, 3.0),
                   "free runs, laws": candidate(1.1, 1.1, 1.1)}, (), None, {}, made)
    errors = dict.fromkeys(field.candidates, 1.0)
    structure = parameter_uncertainty(field, errors, "coloured, laws", made.free)[1]
    np.testing.assert_allclose(structure, np.array([0.2, 0.0, 0.2]) / 1.96, rtol=1e-2, atol=1e-9)
    # Of free runs that err by far more nothing is believed.
    far = errors | {"free runs, laws": 2.5}
    assert not parameter_uncertainty(field, far, "coloured, laws", made.free)[1].any()


@pytest.mark.slow
def test_a_law_beside_a_gap_is_taken_out_and_leaves_the_shaft_right():
    seed = 912_001
    record = draw("gap+motor.stribeck", "S", 2, seed)
    start = start_values(record, seed)
    words = ["--drive", "two-mass", "--free", "shaft.half_gap"]
    found, plain = (greybox(STEP, record.channels, start, NAMES, [*words, "--criterion", criterion])
                    for criterion in ("auto", "innovations"))
    assert "model-error" in found["findings"]
    t = record.truth
    truth = {"motor.inertia": t.motor_inertia, "load.inertia": t.load_inertia, "shaft.stiffness": t.stiffness,
             "shaft.half_gap": t.half_gap}
    for name, true in truth.items():
        low, high = found["ci95"][NAMES.index(name)]
        assert low < true < high and high - low < 0.01 * true

    def friction(answer):
        motor, load, level = (answer["value"][NAMES.index(f"{b}.{n}")] for b, n in (
            ("motor", "viscous"), ("load", "viscous"), ("motor", "coulomb")))
        return np.sqrt(np.mean(((motor + load) * t.speeds + level - t.curve) ** 2)) / np.mean(t.curve)

    assert friction(found) < friction(plain)


class Kinked:
    """Two traces with a start each: one is straight, the other has its least where its slope does not point."""

    low, high, size = np.full(1, -np.inf), np.full(1, np.inf), np.ones(1)
    free_start = np.arange(1)

    def residuals(self, point):
        (p,), ((a,), (b,)) = point.values, point.starts
        # A step along the slope of the second at b = 1 goes to -999, where it is far worse.
        return [np.array([p + a - 3.0, a - 1.0]), np.array([1.0 + 1e-3 * b + 1e3 * min(b - 1.0, 0.0) ** 2])]

    def costs(self, point, gains=None):
        return np.array([r @ r for r in self.residuals(point)])

    def cost(self, point, gains=None):
        return float(self.costs(point).sum())

    def normal(self, point, gains=None):
        one, two = self.residuals(point)
        first, second = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0, 1e-3]])
        g = [first.T @ first, second.T @ second]
        s = [first.T @ one, second.T @ two]
        return Normal(g[0][:1, :1] + g[1][:1, :1], (g[0][:1, 1:], g[1][:1, 1:]), (g[0][1:, 1:], g[1][1:, 1:]),
                      s[0][:1] + s[1][:1], (s[0][1:], s[1][1:]), self.cost(point))

    def moved(self, point, step, own):
        return Point(point.values + step, tuple(a + b for a, b in zip(point.starts, own, strict=True)))


@pytest.mark.parametrize("keeps_worse, reached", [(True, True), (False, False)])
def test_a_trace_that_is_hard_to_start_does_not_hold_up_the_others(keeps_worse, reached):
    begin = Point(np.zeros(1), (np.zeros(1), np.ones(1)))
    found = solve(Kinked(), begin, max_iterations=8, keeps_worse=keeps_worse)
    assert bool(Kinked().costs(found.point)[0] < 1e-6) is reached
    assert found.cost < Kinked().cost(begin)
