"""Exchange pass: causes tested again with those found later are dropped, simplified, exchanged or kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model
from drivetool.check.fit.residual_tests import ResidualTests
from drivetool.check.heldout.scores import Fold, Score
from drivetool.check.outcome.diagnosis import CandidateResult, DiagnoseOptions
from drivetool.check.search import exchange_pass
from drivetool.check.search.decision import Decision, decide
from drivetool.check.search.exchange_pass import REASSESSED_REASON, run_exchange_pass
from drivetool.check.search.result import Base
from drivetool.check.search.search import Expansion, Node
from drivetool.drive import two_mass
from tests.check.models import task_of
from tests.diagnosed import gain

BASE = ("motor.inertia",)
SCATTERED, AGREED = np.array([30.0, -9.0, 40.0, -14.0]), np.array([110.0, 90.0, 100.0, 99.0])


def model_of(code, value, added, **values):
    """A fitted model with these names free, identified by its value."""
    drive = two_mass().with_values(values)
    task = task_of((*BASE, *(n for names in added.values() for n in names)), drive)
    return StandIn(code, task, None, None, None, value)


class StandIn(Model):
    """A model whose drive is at its estimate."""

    @property
    def fitted(self):
        return self.task


class Path:
    """The steps of a search, one by one."""

    def __init__(self):
        self.node, self.steps = Node((), model_of("base", 0.0, {}), ()), []

    def then(self, code, names, between=(), gains=AGREED, lines=(), sides=(), **values):
        """A cause found on top of the others.

        between  what tied with it; gains: per block; lines: of what else was tried; sides: models of what tied
        """
        before, added = self.node, {**self.node.added, code: tuple(names)}
        model = model_of(code, before.model.value - 500.0, added, **values)
        scores = [Score(m, gains, (), (), (model,)) for m in (model, *sides)]
        child = Node((*before.causes, code), model, (model, model), added, before.gained + float(gains.sum()))
        decision = Decision(scores[0], (code, *between), 20.0)
        lines = lines or tuple(CandidateResult(
            c, "possible" if between else "named", gain=float(gains.sum()), gain_std=44.0)
            for c in decision.between)
        self.steps.append(Expansion(before, tuple(scores), decision, lines, child, gain_to(0.5)))
        self.node = child
        return self


def gain_to(after):
    """The gain of free runs from an error of one."""
    return gain(1.0, after, bar=0.05)


class Search:
    """A search that tests again: the loss without a cause, and the gain of each with the others.

    worth  cause -> -log likelihood that is lost without its parameters, 500 if it is not said
    gains  cause -> per block, where it is tested again
    """

    def __init__(self, path, gains=None, worth=None, wanted=CAUSES):
        self.root = path.steps[0].node
        self.masks, self.split, self.options, self.wanted = (), None, DiagnoseOptions(), frozenset(wanted)
        self.gains, self.worth, self.tested = gains or {}, worth or {}, []

    def base(self, _):
        return Base(self.root.model, (Fold((), (), (), None, 0.0),) * 2)

    def lost(self, model, names, *_):
        kept = {n for n in model.task.free if n not in names}
        lost = sum(self.worth.get(n, 500.0 if n == names[0] else 0.0) for n in names)
        task = replace(model.task, free=tuple(n for n in model.task.free if n in kept))
        return replace(model, task=task, value=model.value + lost)

    def expand(self, rest, budget, among, ends):
        self.tested.append([c.code for c in among])
        assert [m.code for m in ends] == [ends[0].code] and ends[0].code in self.tested[-1]
        models = {c.code: model_of(c.code, rest.model.value - 500.0, {**rest.added, c.code: (f"{c.code}.size",)})
                  for c in among}
        scores = [Score(m, np.array(self.gains[c]), (sum(self.gains[c]) - 5.0,) * 2, (0.0, 0.0), (m, m),
                        sum(self.gains[c])) for c, m in models.items()]
        decision = decide(scores, budget)
        lines = tuple(CandidateResult(c, "named" if (c,) == decision.between else "worse") for c in models)
        found = Expansion(rest, tuple(scores), decision, lines)
        if decision.best is None:
            return found
        code = decision.best.model.code
        return replace(found, stage=gain_to(0.4), child=Node(
            (*rest.causes, code), decision.best.model, decision.best.trained,
            {**rest.added, code: (f"{code}.size",)}, rest.gained))


@pytest.fixture
def run_pass(monkeypatch):
    """Runs the exchange pass; left: residual gain of the last model, after: free-run error without the cause."""
    def run(path, gains=None, worth=None, wanted=CAUSES, left=0.0, after=1.0, kind=Search):
        search = kind(path, gains, worth, wanted)
        monkeypatch.setattr(exchange_pass, "refit_without", search.lost)
        monkeypatch.setattr(exchange_pass, "run_residual_tests", lambda _: ResidualTests(left, 0.0, 0.0))
        monkeypatch.setattr(exchange_pass, "score", lambda model, *_: Score(model, AGREED, (), (), (model,)))
        monkeypatch.setattr(exchange_pass, "gain_between", lambda *_: gain_to(after))
        return run_exchange_pass(search, path.steps), search

    return run


def friction_first(gains=SCATTERED):
    """Dry friction at the load, or at the motor, which blocks hardly separate, and then a gap."""
    return Path().then("coulomb-load", ["load.coulomb"], ("coulomb-motor",), gains).then(
        "backlash", ["shaft.half_gap"])


@pytest.mark.parametrize(("rival", "states", "rivals"), [
    ([8.0, 3.0, 5.0, 4.0], ["named", "worse"], ()),
    ([78.0, 66.0, 75.0, 76.0], ["possible", "possible"], ("coulomb-motor",))])
def test_a_tie_is_tested_again_with_the_causes_found_later(run_pass, rival, states, rivals):
    found, search = run_pass(friction_first(), {"coulomb-load": [75.0, 70.0, 80.0, 72.0], "coulomb-motor": rival})
    assert search.tested == [["coulomb-motor", "coulomb-load"]]
    assert found.found.rivals["coulomb-load"] == rivals and "coulomb-load" in found.found.sure
    assert [c.state for c in found.rounds[0].candidates] == states
    assert found.found.causes == ("coulomb-load", "backlash") and found.node.model.code == "backlash"


def test_a_rival_stays_where_the_refit_fails(run_pass):
    class Failing(Search):
        def lost(self, *_):
            raise np.linalg.LinAlgError

    found, search = run_pass(friction_first(), kind=Failing)
    assert found.found.rivals["coulomb-load"] == ("coulomb-motor",) and "coulomb-load" not in found.found.sure
    assert [c.state for c in found.rounds[0].candidates] == ["possible", "possible"] and search.tested == []


def test_nor_where_nothing_is_found_any_more(run_pass):
    found, _ = run_pass(friction_first(), {c: [1.0, -1.0, 1.0, -1.0] for c in ("coulomb-load", "coulomb-motor")})
    assert found.found.rivals["coulomb-load"] == ("coulomb-motor",) and "coulomb-load" not in found.found.sure


def test_a_cause_that_blocks_hardly_identify_is_identified_with_the_others(run_pass):
    path = Path().then("coulomb-load", ["load.coulomb"], gains=SCATTERED).then("backlash", ["shaft.half_gap"])
    found, search = run_pass(path, {"coulomb-load": [75.0, 70.0, 80.0, 72.0]})
    assert search.tested == [["coulomb-load"]] and found.found.sure == {"coulomb-load", "backlash"}


@pytest.mark.parametrize("left", [0.0, 30.0])
def test_a_cause_without_rival_that_blocks_confirm_is_not_tested_again(run_pass, left):
    path = friction_first(AGREED)
    path.steps[0] = replace(path.steps[0], decision=replace(path.steps[0].decision, between=("coulomb-load",)))
    path.steps[0] = replace(path.steps[0], lines=path.steps[0].lines[:1])
    assert run_pass(path, left=left)[1].tested == []


def hardening_first(gap=396.0):
    """A shaft that stiffens, a gap hardly or far behind it, and then something else."""
    lines = (CandidateResult("hardening-stiffness", "named", gain=399.0, gain_std=51.0),
             CandidateResult("backlash", "worse", gain=gap, gain_std=180.0),
             CandidateResult("imbalance", "no-gain"))
    return Path().then("hardening-stiffness", ["shaft.hardening"], lines=lines).then(
        "coulomb-load", ["load.coulomb"])


def test_a_look_alike_that_is_better_with_the_others_takes_its_place(run_pass):
    found, search = run_pass(hardening_first(), {"hardening-stiffness": [140.0, 150.0, 130.0, 145.0],
                                            "backlash": [310.0, 300.0, 320.0, 330.0]}, left=30.0)
    assert search.tested == [["backlash", "hardening-stiffness"]]
    assert found.found.causes == found.node.causes == ("backlash", "coulomb-load") and found.found.between == ()
    assert found.found.evidence["backlash"] > 100.0 and "hardening-stiffness" not in found.found.evidence
    assert found.found.added == found.node.added == {
        "backlash": ("backlash.size",), "coulomb-load": ("load.coulomb",)}
    assert [one.cause for one in found.rounds] == ["backlash", "coulomb-load"]
    assert {c.code: c.state for c in found.rounds[0].candidates} == {
        "backlash": "named", "hardening-stiffness": "worse", "imbalance": "no-gain"}
    assert [c.reason for c in found.rounds[0].candidates] == [REASSESSED_REASON, REASSESSED_REASON, ""]


@pytest.mark.parametrize(("gap", "left", "worth", "wanted"), [
    (396.0, 30.0, 135.0, CAUSES), (90.0, 30.0, 310.0, CAUSES), (396.0, 0.0, 310.0, CAUSES),
    (396.0, 30.0, 310.0, {"hardening-stiffness"})],
    ids=["no better", "far behind at first", "nothing left to explain", "not requested"])
def test_a_cause_stays_where_nothing_does_better(run_pass, gap, left, worth, wanted):
    gains = {"hardening-stiffness": [140.0, 150.0, 130.0, 145.0], "backlash": [worth] * 4}
    found, _ = run_pass(hardening_first(gap), gains, wanted=wanted, left=left)
    assert found.found.causes == ("hardening-stiffness", "coulomb-load")
    assert found.rounds[0].cause == "hardening-stiffness" and found.node.model.value == -1000.0


@pytest.mark.parametrize(("lost", "after", "kept"), [
    (1.0, 1.0, False),  # as likely without it
    (12.0, 1.0, False),  # chance gains as much by one of so many parameters
    (17.0, 1.0, True),
    (1.0, 1.3, True)])  # free runs become worse
def test_a_cause_made_redundant_by_later_ones_is_removed(run_pass, lost, after, kept):
    path = Path().then("torque-ripple", ["motor.ripple_sine"]).then("imbalance", ["load.imbalance_sine"])
    found, _ = run_pass(path, worth={"motor.ripple_sine": lost}, after=after)
    assert found.found.causes == (("torque-ripple",) if kept else ()) + ("imbalance",)
    assert set(found.found.evidence) == set(found.found.rivals) == set(found.found.causes)
    assert found.node.causes == found.found.causes and set(found.node.added) == set(found.found.causes)
    assert ("motor.ripple_sine" in found.node.model.task.free) == kept
    assert found.node.gained == 2.0 * AGREED.sum()  # the gain of both: nothing of it is lost


@pytest.mark.parametrize(("surplus", "wanted", "name"), [
    (3.0, CAUSES, "coulomb-motor"), (5.0, CAUSES, "stribeck-motor"),
    (3.0, {"stribeck-motor", "load-step"}, "stribeck-motor")], ids=["needless", "needed", "not requested"])
def test_a_law_whose_surplus_is_needless_is_called_by_its_special_case(run_pass, surplus, wanted, name):
    """In all that is said; dry friction is there beside the load step then, and rivals it no more."""
    lines = tuple(CandidateResult(c, s) for c, s in (("stribeck-motor", "named"), ("coulomb-motor", "worse")))
    path = Path().then("load-step", ["load.step_torque"], ("coulomb-motor",)).then(
        "stribeck-motor", ["motor.stribeck", "motor.stribeck_speed", "motor.coulomb"], ("quadratic-drag",),
        lines=lines).then("backlash", ["shaft.half_gap"])
    gains = {"load-step": [1.0, -1.0, 1.0, -1.0], "coulomb-motor": [1.0, -1.0, 1.0, -1.0],
             "quadratic-drag": [1.0, -1.0, 1.0, -1.0], "stribeck-motor": [1.0, -1.0, 1.0, -1.0]}
    worth = {"motor.coulomb": 500.0, "motor.stribeck": surplus, "motor.stribeck_speed": 0.0}
    found, _ = run_pass(path, gains, worth, wanted)
    simple = name == "coulomb-motor"
    assert found.found.causes == found.node.causes == ("load-step", name, "backlash")
    assert set(found.found.evidence) == set(found.found.causes) and found.rounds[1].cause == name
    assert found.found.added[name] == found.node.added[name] == (
        ("motor.coulomb",) if simple else ("motor.stribeck", "motor.stribeck_speed", "motor.coulomb"))
    assert found.found.rivals["load-step"] == (() if simple else ("coulomb-motor",))
    assert found.found.rivals[name] == ("quadratic-drag",)
    assert {c.code: c.state for c in found.rounds[1].candidates} == {
        "coulomb-motor": "named" if simple else "worse", "stribeck-motor": "worse" if simple else "named"}


DELAYS = ("converter-lag", "speed-filter", "dead-time")
NO_GAIN = [1.0, -1.0, 1.0, -1.0]


@pytest.mark.parametrize(("steps", "expected"), [
    ([("backlash", ())], {"backlash": ()}),
    ([("coulomb-load", ("coulomb-motor",))], {"coulomb-load": ("coulomb-motor",)}),
    # One, and then the other: both are there.
    ([("coulomb-load", ("coulomb-motor",)), ("coulomb-motor", ())], {"coulomb-load": (), "coulomb-motor": ()}),
    # Nothing was learnt about what was open before.
    ([("converter-lag", DELAYS[1:]), ("backlash", ("hardening-stiffness",))],
     {"converter-lag": DELAYS[1:], "backlash": ("hardening-stiffness",)})])
def test_what_stays_open_from_cause_to_cause(run_pass, steps, expected):
    path = Path()
    for code, rivals in steps:
        path.then(code, [f"{code}.size"], rivals)
    found, _ = run_pass(path, dict.fromkeys(CAUSES, NO_GAIN))
    assert found.found.rivals == expected


def test_a_delay_found_with_a_third_mass_was_not_its_rival(run_pass):
    """Which delay it is stays open; the third mass was no rival once a delay was in the model."""
    path = Path().then("third-mass", ["tip.inertia"], DELAYS).then(
        "converter-lag", ["converter.bandwidth"], (*DELAYS[1:], "asymmetric-friction")).then(
        "asymmetric-friction", ["motor.viscous_asymmetry"])
    gains = {"third-mass": [75.0, 70.0, 80.0, 72.0], "converter-lag": [75.0, 70.0, 80.0, 72.0],
             "speed-filter": [8.0, 3.0, 5.0, 4.0], "dead-time": [8.0, 3.0, 5.0, 4.0]}
    found, search = run_pass(path, gains)
    assert [set(codes) for codes in search.tested] == [{"third-mass", *DELAYS[1:]}, set(DELAYS)]
    assert found.found.rivals["third-mass"] == found.found.rivals["asymmetric-friction"] == ()


@pytest.mark.parametrize(("order", "still"), [(4.0, ("torque-ripple",)), (1.02, ())])
def test_a_tie_with_a_ripple_ends_with_a_ripple_of_that_order_only(run_pass, order, still):
    """A motor's ripple of order one, taken for imbalance of the load, was named so once one of order four came."""
    names = ["motor.ripple_sine", "motor.ripple_order"]
    tied = model_of("torque-ripple", -500.0, {"torque-ripple": names}, **{"motor.ripple_order": 1.01})
    path = Path().then("imbalance", ["load.imbalance_sine"], ("torque-ripple",), sides=[tied]).then(
        "torque-ripple", names, **{"motor.ripple_order": order})
    found, _ = run_pass(path)
    assert found.found.causes == ("imbalance", "torque-ripple")
    assert found.found.rivals["imbalance"] == still
    assert found.found.between == (("imbalance", *still) if still else ())


def test_causes_found_with_a_dropped_cause_are_tested_again(run_pass):
    """A load step was as good as imbalance beside the ripple; what rivals it alone is not known."""
    path = Path().then("torque-ripple", ["motor.ripple_sine"], ("imbalance",)).then(
        "imbalance", ["load.imbalance_sine"], ("load-step",))
    gains = {"imbalance": [75.0, 70.0, 80.0, 72.0], "load-step": [8.0, 3.0, 5.0, 4.0]}
    found, search = run_pass(path, gains, worth={"motor.ripple_sine": 1.0})
    assert found.found.causes == ("imbalance",)
    assert search.tested == [["imbalance", "load-step"]] and found.found.rivals["imbalance"] == ()
