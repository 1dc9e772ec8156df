"""From distant starts to the right optimum, through the estimator that the command calls."""

from __future__ import annotations

import os
import time
from functools import cache

import numpy as np
import pytest

from drivetool.drive import Drive
from drivetool.identify.backlash import backlash
from drivetool.identify.estimate import covariance_of
from drivetool.identify.fit import by_innovations, by_simulation
from drivetool.identify.greybox import default_free, free_parameters, greybox
from drivetool.identify.setup import Options, Task, roles_of
from tests.bench.records import CASES, Case

AS_GOOD = 1.0  # log likelihood within which a fit has reached that of the one started at the truth
COST = 1.02  # the same for the cost of a simulation-error fit
WANTED = {0.15: 19 / 20, 0.4: 16 / 20}
EXACT_TORQUE = ("main", "even")  # elsewhere torque noise biases a simulation-error fit


def task_of(case: Case, drive: Drive) -> Task:
    """What greybox fits with the case's parameters freed and its other frictions held."""
    record = case.record()
    free = free_parameters(drive, default_free(drive, [record]), Options(free=case.free, hold=case.hold))
    return Task(drive, free, roles_of([record], drive), (record,))


def fitted(case: Case, drive: Drive, criterion: str):
    """The fit that greybox makes, without what it reports beside it."""
    task = task_of(case, drive)
    assert set(task.free) == set(case.free)
    return by_innovations(task, [{}]) if criterion == "innovations" else by_simulation(task, 2.0, [{}])


@cache
def goal(name: str, criterion: str) -> tuple[float, np.ndarray]:
    """(value of the fit started at the truth, predicted std there)."""
    case = CASES[name]
    outcome = fitted(case, case.start(), criterion)
    covariance, _, _ = covariance_of(outcome.problem, outcome.solution)
    return value_of(outcome), np.sqrt(np.diag(covariance))


def value_of(outcome) -> float:
    return outcome.solution.cost if outcome.fit is None else outcome.fit.value


def reached(name: str, criterion: str, off: float, seed: int) -> tuple[bool, str]:
    """(whether a start reaches the optimum, what to print)."""
    case, (best, std) = CASES[name], goal(name, criterion)
    outcome = fitted(case, case.start(off, seed), criterion)
    value = value_of(outcome)
    good = value < best + AS_GOOD if criterion == "innovations" else value < COST * best
    true = np.array([case.truth[n] for n in outcome.task.free])
    error = np.abs(outcome.solution.point.values - true)
    near = bool(np.all(error < np.maximum(0.05 * true, 3.0 * std)))
    return bool(good) and near, f"{value - best:.4g} above, worst {100 * np.max(error / true):.1f} %"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "criterion", "off"), [
    ("main", "simulation", 0.4), ("heavy", "innovations", 0.4),
    pytest.param("three", "innovations", 0.15, marks=pytest.mark.slow)])
def test_a_distant_start_reaches_the_optimum(name, criterion, off):
    good, words = reached(name, criterion, off, 2)
    assert good, words


@pytest.mark.slow
def test_the_estimate_says_how_its_starts_agreed():
    case = CASES["even"]
    record = case.record()
    estimate = greybox([record], case.start(0.4, 4), Options(free=case.free, hold=case.hold))
    assert estimate.starts.tried >= 2 and estimate.starts.agreed >= 2
    for p in estimate.parameters:
        if p.status == "fitted":
            assert abs(p.value - case.truth[p.name]) < max(0.05 * case.truth[p.name], 3.0 * p.std)
            # What agreed did not end at a larger distance than the interval is wide.
            assert estimate.starts.spread[p.name] < 4.0 * p.std


@pytest.mark.slow
def test_friction_on_one_body_alone_is_found_from_a_sum_shared_by_rule():
    """By rule nine tenths of the viscous friction are the load's, which has none: ways that do not look fail."""
    case = CASES["main"]
    estimate = greybox([case.record()], case.start(0.4, 3001), Options(free=("shaft.half_gap",)))
    assert estimate.starts.agreed >= 2 and estimate.starts.tried <= 4
    found = {p.name: p for p in estimate.parameters}
    for name in case.free:
        p, true = found[name], case.truth[name]
        assert p.std is not None and abs(p.value - true) < min(0.05 * abs(true), 4.0 * p.std), name
    assert found["load.viscous"].ci95[1] < 0.01 * case.truth["motor.viscous"]
    assert abs(found["motor.idle_torque"].value) < 4.0 * found["motor.idle_torque"].std


@pytest.mark.slow
def test_a_part_that_is_held_keeps_its_value_and_so_do_parts_that_backlash_is_given():
    case = CASES["even"]
    drive = case.start().with_values({"motor.viscous": 0.02})
    kept = {p.name: p for p in greybox([case.record()], drive, Options(hold=("motor.viscous",))).parameters}
    assert kept["motor.viscous"].value == 0.02 and kept["motor.viscous"].status == "held"
    assert kept["load.viscous"].status != "held"
    given = {p.name: p for p in backlash([case.record()], drive, Options(starts=1)).parameters}
    assert given["motor.viscous"].value == 0.02 and "total.viscous" not in given
    gap = given["shaft.half_gap"]
    assert abs(gap.value - case.truth["shaft.half_gap"]) < 3.0 * gap.std


@pytest.mark.study
@pytest.mark.parametrize("criterion", ["innovations", "simulation"])
@pytest.mark.parametrize("name", CASES)
def test_twenty_distant_starts(name, criterion):
    """19 of 20 at +-15 %, 16 of 20 at +-40 %; DRIVETOOL_STUDY_STARTS sets the count."""
    if criterion == "simulation" and name not in EXACT_TORQUE:
        pytest.skip("torque noise biases a simulation-error fit")
    count = int(os.environ.get("DRIVETOOL_STUDY_STARTS", "20"))
    shares = {}
    for off in WANTED:
        began = time.perf_counter()
        found = [reached(name, criterion, off, 1000 + k) for k in range(count)]
        shares[off] = sum(good for good, _ in found) / count
        print(f"\n{name}, {criterion}, +-{100 * off:.0f} %: {sum(g for g, _ in found)} of {count}, "
              f"{(time.perf_counter() - began) / count:.1f} s each",
              "; ".join(f"start {k}: {words}" for k, (g, words) in enumerate(found) if not g), flush=True)
    assert all(shares[off] >= wanted for off, wanted in WANTED.items()), shares
