"""Forward selection: which causes are fitted on top of a node, which are cross-validated, and the next node."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import fit_from_start
from drivetool.check.fit.reduce import refit_without
from drivetool.check.fit.residual_tests import ResidualTests, run_residual_tests
from drivetool.check.heldout.samples import split_of
from drivetool.check.heldout.scores import Score
from drivetool.check.outcome.diagnosis import DiagnoseOptions
from drivetool.check.search import search as searching
from drivetool.check.search.candidate_fit import CandidateFit
from drivetool.check.search.decision import Decision
from drivetool.check.search.exchange_pass import run_exchange_pass
from drivetool.check.search.prepared_start import PreparedStart
from drivetool.check.search.run_search import search_causes
from drivetool.check.search.search import Expansion, ForwardSelection, Node
from drivetool.drive import one_body
from drivetool.identify.setup import Task, roles_of
from tests.check.models import Unfolded, model_of, true_model
from tests.recover import STEP, experiment
from tests.simulator.effects import Effects
from tests.simulator.experiments import multisine, trapezoids
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, at_rest
from tests.simulator.records import white_noise

ROOT = Node((), true_model(), ())


class Tries:
    """Replaces screens and fits: cause -> (expected gain of its best start, gain of its fit)."""

    def __init__(self, monkeypatch, causes, left=30.0):
        self.causes, self.fitted, self.goals = causes, [], {}
        monkeypatch.setattr(searching, "screen", self.screen)
        monkeypatch.setattr(searching, "attempt", self.attempt)
        monkeypatch.setattr(searching, "run_residual_tests", lambda _: ResidualTests(left, 0.0, 0.0))

    def screen(self, cause, *_):
        start = PreparedStart(model_of(cause.code), self.causes[cause.code][0], {})
        return CandidateFit(cause, smallest={"x": 1.0}, prepared_starts=(start,))

    def attempt(self, screened, base, masks, more=(), goal=np.inf):
        code = screened.cause.code
        self.fitted.append(code)
        self.goals[code] = goal
        return CandidateFit(screened.cause, model_of(code, base.value - self.causes[code][1]), screened.smallest)

    def tried(self, node=ROOT, requested=False):
        """The causes on top of a node, by code."""
        found = Unfolded()._fit_candidates(node, [CAUSES[c] for c in self.causes], requested, ())
        return {t.cause.code: t for t in found}


@pytest.mark.parametrize(("promise", "fitted"), [(251.0, True), (239.0, False)])
def test_the_largest_expected_gain_comes_first_and_others_while_they_can_tie_with_it(monkeypatch, promise, fitted):
    """A full fit gains four times its expected gain at most; twenty behind is no tie."""
    tries = Tries(monkeypatch, {"quadratic-drag": (promise, 20.0), "coulomb-motor": (400.0, 1000.0)})
    found = tries.tried()
    assert tries.fitted == ["coulomb-motor", *["quadratic-drag"] * fitted]
    assert set(found) == {"quadratic-drag", "coulomb-motor"}
    assert (found["quadratic-drag"].model is not None) == fitted
    # What is far behind the leader after a few rounds goes no further.
    assert tries.goals == {"coulomb-motor": np.inf, **({"quadratic-drag": -1000.0} if fitted else {})}


@pytest.mark.parametrize(("code", "promise", "fitted"), [
    ("quadratic-drag", 5.0, False), ("quadratic-drag", 7.0, True),
    # The whole record was looked at for a thousand orders.
    ("torque-ripple", 12.0, False), ("torque-ripple", 14.0, True)])
def test_a_small_expected_gain_is_not_fitted_unless_it_is_requested(monkeypatch, code, promise, fitted):
    tries = Tries(monkeypatch, {code: (promise, 3.0)})
    assert (tries.tried()[code].model is not None) == fitted
    assert tries.tried(requested=True)[code].model is not None


@pytest.mark.parametrize(("promises", "fitted"), [
    ((400.0, 350.0, 300.0, 110.0), 4), ((400.0, 350.0, 300.0, 90.0), 3), ((400.0, 20.0, 18.0, 16.0), 3)])
def test_a_quarter_of_the_best_expected_gain_is_fitted_and_the_best_three_always(monkeypatch, promises, fitted):
    codes = ("coulomb-motor", "quadratic-drag", "asymmetric-friction", "imbalance")
    tries = Tries(monkeypatch, {c: (p, 50.0) for c, p in zip(codes, promises, strict=True)})  # all of them can tie
    tries.tried()
    assert sorted(tries.fitted) == sorted(codes[:fitted])


@pytest.mark.parametrize(("surplus", "fitted"), [(1.5, False), (2.5, True)])
def test_a_law_that_gains_no_more_than_its_special_case_waits_for_that(monkeypatch, surplus, fitted):
    tries = Tries(monkeypatch, {"coulomb-motor": (100.0, 110.0), "stribeck-motor": (100.0 + surplus, 111.0)})
    tries.tried()
    assert ("stribeck-motor" in tries.fitted) == fitted and "coulomb-motor" in tries.fitted


@pytest.mark.parametrize(("left", "causes", "looked"), [
    (0.0, {"coulomb-motor": (100.0, 110.0)}, False), (30.0, {"coulomb-motor": (100.0, 110.0)}, True),
    (0.0, {}, True), (30.0, {}, True)])
def test_what_costs_much_is_looked_for_where_nothing_else_explains_the_records(monkeypatch, left, causes, looked):
    """On top of the base whatever its one-step errors say: those of a resonance may pass for noise."""
    tries = Tries(monkeypatch, {**causes, "third-mass": (50.0, 60.0)}, left)
    found = tries.tried()
    assert ("third-mass" in tries.fitted) == ("third-mass" in found) == looked
    assert tries.fitted[-1] == ("third-mass" if looked else "coulomb-motor")
    # Beside what was found before the base itself may explain all.
    found = Tries(monkeypatch, {"third-mass": (50.0, 60.0)}, left).tried(replace(ROOT, causes=("backlash",)))
    assert ("third-mass" in found) == (left > 0.0)
    assert "third-mass" in Tries(monkeypatch, {"third-mass": (50.0, 60.0)}, left).tried(
        replace(ROOT, causes=("backlash",)), requested=True)


@pytest.fixture
def held_out(monkeypatch):
    """(codes that were tested on held-out samples; cause -> what it gains there, half if it is not said)."""
    tested, worth = [], {}

    def score(model, *_):
        tested.append(model.code)
        return score_of(model, worth.get(model.code, -0.5 * model.value), f"{model.value}")

    monkeypatch.setattr(searching, "score", score)
    return tested, worth


def score_of(model, worth, trained):
    return Score(model, np.full(4, worth / 4.0), (), (), (trained,))


@pytest.mark.parametrize(("second", "worth", "expected"), [
    (60.0, {"coulomb-motor": 90.0, "quadratic-drag": 50.0}, {"coulomb-motor", "quadratic-drag"}),
    (40.0, {"coulomb-motor": 90.0, "quadratic-drag": 30.0}, {"coulomb-motor"}),
    (40.0, {"coulomb-motor": -90.0, "quadratic-drag": 30.0}, {"coulomb-motor", "quadratic-drag"})],
    ids=["it may tie", "it cannot tie", "held out samples speak against the best"])
def test_held_out_samples_test_the_best_and_what_may_tie(held_out, second, worth, expected):
    held_out[1].update(worth)
    gains = {"coulomb-motor": 100.0, "quadratic-drag": second, "load-step": 1.0}
    tried = [CandidateFit(CAUSES[c], replace(ROOT.model, code=c, value=-g), {}) for c, g in gains.items()]
    absent = replace(ROOT.model, code="imbalance", value=-9e3)
    tried.append(CandidateFit(CAUSES["imbalance"], absent, {}, "none", "no-gain"))
    scores = Unfolded()._cross_validated(ROOT, tried)
    assert set(held_out[0]) == expected == {s.model.code for s in scores}


def test_a_law_takes_the_place_of_its_special_case_that_was_found_before():
    before = ("motor.inertia", "motor.coulomb", "load.drag")
    node = Node(("coulomb-motor", "quadratic-drag"), model_of("quadratic-drag", -300.0, before), (),
                {"coulomb-motor": ("motor.coulomb",), "quadratic-drag": ("load.drag",)}, 300.0)
    model = model_of("stribeck-motor", -400.0, (*before, "motor.stribeck", "motor.stribeck_speed"))
    child = Unfolded()._child(node, score_of(model, 80.0, "trained"))
    assert child.causes == ("quadratic-drag", "stribeck-motor") and child.gained == 380.0
    assert child.added == {"quadratic-drag": ("load.drag",),
                           "stribeck-motor": ("motor.coulomb", "motor.stribeck", "motor.stribeck_speed")}
    assert child.model is model and child.trained == ("trained",)


@pytest.mark.parametrize(("gain", "taken"), [(90.0, True), (70.0, False)])
def test_one_more_of_its_kind_is_taken_where_samples_held_out_agree(monkeypatch, held_out, gain, taken):
    one, more = model_of("torque-ripple", -90.0), model_of("torque-ripple", -180.0)
    cause = replace(CAUSES["torque-ripple"], another=lambda model, *_: more if model is one else None)
    monkeypatch.setattr(searching, "CAUSES", {**CAUSES, "torque-ripple": cause})
    held_out[1]["torque-ripple"] = gain
    child = Unfolded()._child(ROOT, score_of(one, 80.0, "one"))
    expected = (more, ("-180.0",), gain) if taken else (one, ("one",), 80.0)
    assert (child.model, child.trained, child.gained) == expected


def test_friction_that_can_be_split_is_trained_in_every_fold(monkeypatch, held_out):
    """With a sum that is split by rule, the free-run test would reject a gap that is there."""
    whole, parted = model_of("backlash", -90.0), model_of("backlash", -180.0)
    monkeypatch.setattr(searching, "with_parts", lambda model, _: parted if model is whole else model)
    child = Unfolded()._child(ROOT, score_of(whole, 80.0, "-90.0"))
    assert (child.model, child.trained, child.gained) == (parted, ("-180.0",), 90.0)
    child = Unfolded()._child(ROOT, score_of(parted, 80.0, "as it was"))
    assert (child.model, child.trained, child.gained) == (parted, ("as it was",), 80.0)


class Steps(Unfolded):
    """A search whose steps are given: the causes found, one after the other, until None."""

    def __init__(self, found, rounds=3, wanted=CAUSES, root=ROOT.model):
        super().__init__(wanted, CAUSES, root, rounds=rounds)
        self.found, self.budgets, self.better = list(found), [], {}

    def _improved_base(self, node, one):
        """The same node with another model, once, where it is so many causes deep."""
        value = self.better.pop(len(node.causes), None)
        return None if value is None else replace(node, model=replace(node.model, value=value))

    def expand(self, node, budget, *_):
        self.budgets.append(budget)
        code = self.found[len(node.causes)]
        child = None if code is None else replace(node, causes=(*node.causes, code))
        return Expansion(node, (), Decision(None, (), 0.0), (), child, child and "gain")


@pytest.mark.parametrize(("found", "options", "causes", "not_requested"), [
    (["backlash", "imbalance", None], {}, ["backlash", "imbalance", None], ""),
    ([None], {}, [None], ""),
    # One more than is looked for is not taken.
    (["backlash", "imbalance", "load-step"], {"rounds": 2}, ["backlash", "imbalance", None], ""),
    # Nor is what was not to be looked for, whose special case, say, was.
    (["backlash", "imbalance", None], {"wanted": {"backlash"}}, ["backlash", None], "imbalance")])
def test_node_after_node_until_nothing_more_is_found(found, options, causes, not_requested):
    search = Steps(found, **options)
    path, said = search.path()
    assert [e.round(1).cause for e in path] == causes and said == not_requested
    assert [e.stage for e in path] == ["gain" if c else None for c in causes]
    assert search.budgets == [0.01 * 0.5 ** (k + 1) for k in range(len(path))]


def test_a_path_that_goes_on_from_a_cause_has_what_that_left_of_budget_and_rounds():
    search = Steps(["backlash", "imbalance", "load-step", "hardening-stiffness"])
    path, _ = search.path(replace(ROOT, causes=("backlash",)))
    assert [e.round(1).cause for e in path] == ["imbalance", "load-step", None]
    assert search.budgets == [0.01 * 0.5 ** (k + 1) for k in (1, 2, 3)]


@pytest.mark.parametrize("depth", [0, 1])
def test_the_search_restarts_from_a_base_that_ends_likelier_elsewhere(depth):
    """Under the same budget: it is the same question."""
    search = Steps(["backlash", "imbalance", None])
    search.better = {depth: -50.0}
    path, _ = search.path()
    assert [e.node.model.value for e in path][depth] == -50.0 and [e.round(1).cause for e in path] == [
        "backlash", "imbalance", None]
    assert (search.root.model.value == -50.0) == (depth == 0)
    assert depth == 0 or path[0].child is path[1].node
    assert search.budgets == [0.01 * 0.5 ** (k + 1) for k in sorted([0, 1, 2, depth])]


@pytest.mark.parametrize(("value", "worse", "better"), [
    (-3.9, False, False), (-4.1, False, True), (9.0, False, False), (-90.0, True, False)])
def test_a_cause_leads_a_base_out_of_its_local_optimum_where_that_is_likelier(monkeypatch, value, worse, better):
    """And free runs are no worse: noise may have taken the place of friction there."""
    removed, off = [], 1.2 if worse else 1.0  # its inertia over the true one

    def without(model, names, *_):
        removed.append(tuple(names))
        point = replace(ROOT.model.point, values=off * ROOT.model.point.values)
        return replace(ROOT.model, code="backlash", point=point, value=value)

    monkeypatch.setattr(searching, "refit_without", without)
    monkeypatch.setattr(searching, "fit", lambda model, _: model)
    search = Unfolded()
    child = replace(ROOT, causes=("backlash",), model=model_of("backlash", -90.0, (*ROOT.model.task.free, "gap")))
    found = search._improved_base(ROOT, Expansion(ROOT, (), Decision(None, (), 0.0), (), child))
    assert removed == [("gap",)] and (found is not None) == better
    assert not better or (found.model.value, found.model.code, found.trained) == (value, "base", (found.model,))
    assert search._improved_base(ROOT, Expansion(ROOT, (), Decision(None, (), 0.0), ())) is None


def test_nothing_is_looked_for_where_free_runs_of_the_base_leave_rounding_alone():
    assert Steps(["backlash"], root=true_model(noise=0.0)).path() == ([], "")


def test_laws_are_fitted_with_their_special_cases_requested_or_not():
    assert {c.code for c in Unfolded(["stribeck-load"]).causes} == {"stribeck-load", "coulomb-load"}


# Small records of one body that goes back and forth, with one law or two.
BODY = Machine(inertia=(0.02,), viscous=(0.01,), idle_torque=(0.05,), rated_torque=2.0)
FREE = ("motor.inertia", "motor.viscous", "motor.idle_torque")


def one_body_search(machine, codes, seed=3, size=6000, torque_noise=None):
    """A search for some causes in a record of one body that goes back and forth."""
    top = 30.0
    reference = trapezoids(top, 0.6, 0.3, size * STEP, STEP, seed)[:size]
    excite = multisine(np.linspace(1.0, 20.0, 15), 0.05, size * STEP, STEP, seed)[:size]
    noise = white_noise(size, 0.01, seed + 1) if torque_noise is None else torque_noise
    run = simulate_fast(machine, excite, STEP, at_rest(machine), PI(reference, 0.2, 0.4, limit=2.0), noise,
                        sensor_noise=white_noise(size, 0.02, seed + 2))
    record = experiment(run.command, run.measured)
    drive = one_body().with_values({"motor.inertia": 0.021, "motor.viscous": 0.009, "motor.idle_torque": 0.04})
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    split = split_of((record,), 1, drive, task.roles)
    return ForwardSelection(fit_from_start(task), split, codes, frozenset(codes), DiagnoseOptions())


FRICTION = ("coulomb-motor", "stribeck-motor", "quadratic-drag", "asymmetric-friction")


@pytest.mark.slow
@pytest.mark.parametrize(("codes", "seed", "size"), [
    (("coulomb-motor", "quadratic-drag"), 5, 2400), (FRICTION, 3, 6000)])
def test_two_laws_of_one_body_are_found_one_after_the_other(codes, seed, size):
    machine = replace(BODY, coulomb=(0.08,), effects=Effects(quadratic=(4e-4,)))
    search = one_body_search(machine, codes, seed, size)
    path, not_requested = search.path()
    passed = run_exchange_pass(search, path)
    assert not_requested == "" and sorted(passed.found.causes) == ["coulomb-motor", "quadratic-drag"]
    assert passed.found.between == ()
    values = passed.node.model.fitted.drive.values
    assert values["motor.coulomb"] == pytest.approx(0.08, rel=0.05)
    assert values["motor.drag"] == pytest.approx(4e-4, rel=0.1)
    assert passed.rounds[-1].cause is None


@pytest.mark.slow
@pytest.mark.parametrize("power", [2.0, 1.0])
def test_breakaway_friction_that_fades_by_another_power_is_one_cause(power):
    """By a power held at two the rest of an exponential was a drag beside it."""
    machine = replace(BODY, coulomb=(0.05,), effects=Effects(
        stribeck=(0.15,), stribeck_speed=(3.0,), stribeck_power=(power,)))
    search = one_body_search(machine, ("stribeck-motor", "quadratic-drag"), size=6000)
    path, _ = search.path()
    assert [e.round(1).cause for e in path] == ["stribeck-motor", None]
    model = path[0].child.model
    values = model.fitted.drive.values
    assert ("motor.stribeck_power" in model.task.free) == (power != 2.0)
    assert values["motor.stribeck"] == pytest.approx(0.15, rel=0.1)
    assert power == 2.0 or values["motor.stribeck_power"] == pytest.approx(power, abs=0.15)


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing():
    path, _ = one_body_search(BODY, FRICTION).path()
    assert [e.round(1).cause for e in path] == [None]


@pytest.mark.slow
def test_slow_noise_of_the_torque_is_nothing_that_is_missing():
    """The base of a record in which nothing is found is held against it under the noise that is likeliest."""
    slow = lfilter([0.006], [1.0, -0.995], np.random.default_rng(8).standard_normal(6000))
    search = one_body_search(BODY, ("quadratic-drag",), torque_noise=slow)
    result = search_causes(search, (), (), search.root.model.task.experiments)
    assert result.found.causes == () and result.left.total == 0.0
    assert result.model.noise.memory == pytest.approx(0.995, abs=0.003)
    assert run_residual_tests(search.root.model).total > 100.0  # under white noise it would be


def test_a_model_without_a_law_is_the_model_before_it():
    """Without its surplus breakaway friction is dry friction of the same size."""
    machine = replace(BODY, coulomb=(0.08,))
    search = one_body_search(machine, FRICTION, size=3000)
    path, _ = search.path()
    model, drive = path[0].child.model, search.root.model.task.drive
    values = {**model.fitted.drive.values, "motor.coulomb": 0.05, "motor.stribeck": 0.03,
              "motor.stribeck_speed": 1.0}
    names = ("motor.stribeck", "motor.stribeck_speed")
    task = replace(model.task, drive=replace(model.task.drive, values=values),
                   free=(*model.task.free, *names))
    more = replace(model, task=task, problem=task.problem(), point=replace(model.point, values=np.array(
        [values[n] for n in task.free])))
    less = refit_without(more, names, drive, search.masks)
    assert set(less.task.free) == {*FREE, "motor.coulomb"} and set(less.task.drive.values) == {
        *model.task.drive.values}
    assert less.value == pytest.approx(model.value, abs=0.5)
    none = refit_without(less, ("motor.coulomb",), drive, search.masks)
    assert none.task.free == search.root.model.task.free
    assert none.value == pytest.approx(search.root.model.value, abs=0.5)
