"""Which starts are fitted and which of their ends go on, and what is no cause however much it gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.search import candidate_fit as attempting
from drivetool.check.search.candidate_fit import (
    CandidateFit,
    _select_ends,
    attempt,
    screened_for_significance,
)
from drivetool.check.search.prepared_start import PreparedStart
from drivetool.drive import two_mass
from drivetool.drive.simulation import Trace
from drivetool.identify.estimate import Parameter
from drivetool.identify.problem import Point
from drivetool.identify.setup import Roles
from tests.check.models import model_of, model_over, task_of


def end(value, order=2.0, owner="motor"):
    return model_of("quadratic-drag", value, (f"{owner}.drag",), two_mass().with_values({"converter.order": order}))


@pytest.mark.parametrize(("behind", "order", "owner", "kept"), [
    (30.0, 1.0, "motor", False), (100.0, 2.0, "motor", True),
    (800.0, 2.0, "motor", False), (650.0, 1.0, "load", True), (800.0, 1.0, "load", False)])
def test_a_lag_of_another_order_and_a_law_of_another_body_are_given_up_later(behind, order, owner, kept):
    """Of a gain of 1000: of the same law the best end alone goes on, of another kind what has three tenths."""
    best, other = end(-1000.0, 1.0), end(-1000.0 + behind, order, owner)
    assert _select_ends([best, other], end(0.0), False) == [best, *([other] if kept else [])]


def test_of_a_multimodal_likelihood_the_best_three_ends_go_on():
    ends = [end(-1000.0 + 300.0 * k) for k in range(5)]
    assert _select_ends(ends, end(0.0), True) == ends[:3] and _select_ends([], end(0.0), False) == []


class Fits:
    """Stands in for fits: where each start ends, by its value, after a first fit and in the end."""

    def __init__(self, monkeypatch, ends):
        self.ends, self.made = ends, []
        monkeypatch.setattr(attempting, "fit", self)

    def __call__(self, model, _, max_iterations=None, goal=np.inf):
        self.made.append((model.problem, "first" if max_iterations == attempting.FIRST_FIT_ITERATIONS else "whole"))
        return replace(model, value=self.ends[model.problem][0 if max_iterations == attempting.FIRST_FIT_ITERATIONS
                                                             else 1])


def start(name, promise, code="quadratic-drag", owner="motor"):
    """A start by that name."""
    return PreparedStart(model_of(code, 0.0, (f"{owner}.drag",), problem=name), promise, {})


def screened(*starts, code="quadratic-drag"):
    return CandidateFit(CAUSES[code], prepared_starts=starts)


BASE = model_of("base", 0.0, ())


def test_of_each_kind_the_two_best_starts_are_fitted_and_the_best_end_to_convergence(monkeypatch):
    fits = Fits(monkeypatch, {"a": (-60.0, -90.0), "b": (-80.0, -100.0), "c": (-85.0, 0.0), "load": (-10.0, 0.0)})
    starts = (start("a", 50.0), start("b", 40.0), start("c", 30.0), start("load", 20.0, owner="load"))
    tried = attempt(screened(*starts), BASE, ())
    assert fits.made == [("a", "first"), ("b", "first"), ("load", "first"), ("b", "whole")]
    assert (tried.model.value, tried.absent) == (-100.0, None)


@pytest.mark.parametrize(("promise", "fitted"), [(11.0, True), (9.0, False)])
def test_a_start_with_a_tenth_of_the_best_expected_gain_is_worth_a_fit(monkeypatch, promise, fitted):
    fits = Fits(monkeypatch, {"a": (-60.0, -90.0), "other": (-10.0, 0.0)})
    attempt(screened(start("a", 100.0), start("other", promise, owner="load")), BASE, ())
    assert (("other", "first") in fits.made) == fitted


@pytest.mark.parametrize(("value", "fits_made"), [(-190.0, ["first"]), (-210.0, ["first", "whole"])])
def test_what_gains_less_than_half_of_the_likeliest_cause_goes_no_further(monkeypatch, value, fits_made):
    """It is still a result, of what it gained so far."""
    fits = Fits(monkeypatch, {"a": (value, value - 1.0), "b": (0.0, 0.0)})
    tried = attempt(screened(start("a", 50.0), start("b", 40.0)), BASE, (), goal=-400.0)
    assert [what for _, what in fits.made] == fits_made and {name for name, _ in fits.made} == {"a"}
    assert tried.model.value == value - len(fits_made) + 1


def test_an_end_of_an_earlier_fit_is_one_more_start(monkeypatch):
    fits = Fits(monkeypatch, {"a": (-60.0, -90.0), "earlier": (-95.0, -95.0)})
    earlier = start("earlier", 0.0).model
    assert attempt(screened(start("a", 50.0)), BASE, (), [earlier]).model.problem == "earlier"
    assert fits.made == [("a", "first"), ("earlier", "first"), ("earlier", "whole")]


def test_where_no_start_is_worth_a_fit_none_has_failed(monkeypatch):
    Fits(monkeypatch, {})
    tried = attempt(screened(start("a", 1.0)), BASE, ())
    assert (tried.model, tried.absent, tried.reason) == (None, None, "")


def test_a_fit_that_fails_is_a_result(monkeypatch):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("Singular matrix")

    Fits(monkeypatch, {})
    monkeypatch.setattr(attempting, "fit", fails)
    tried = attempt(screened(start("a", 50.0)), BASE, ())
    assert (tried.model, tried.absent, tried.reason) == (None, "failed", "its fit failed: Singular matrix")


@pytest.mark.parametrize(("deviations", "absent"), [(1.9, "no-gain"), (3.1, None)])
def test_one_size_of_a_cause_must_be_significant(monkeypatch, deviations, absent):
    """The Stribeck speed, or dry friction beside it, may be anything: what counts is the breakaway surplus."""
    lines = [Parameter(name="motor.stribeck", value=deviations, unit="Nm", start=0.0, std=1.0),
             Parameter(name="motor.coulomb", value=9.0, unit="Nm", start=0.0, std=1.0)]
    monkeypatch.setattr(attempting, "added_parameters", lambda *_: lines)
    tried = CandidateFit(CAUSES["stribeck-motor"], BASE, {"motor.stribeck": 1.0, "motor.coulomb": 1.0})
    assert screened_for_significance(tried, BASE).absent == absent
    lines[:] = [p.replace(std=None) for p in lines]
    assert screened_for_significance(tried, BASE).absent is None  # without a standard error it is not tested


@pytest.mark.parametrize(("role", "turns", "order", "none"), [
    ("motor_speed", 3.0, 0.2, True), ("motor_speed", 3.0, 0.5, False), ("motor_angle", 3.0, 0.2, True),
    ("motor_angle", 0.5, 7.0, False)])
def test_a_ripple_that_does_not_repeat_is_none(role, turns, order, none):
    angle = np.pi * turns * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 4001)))
    motion = angle if role == "motor_angle" else np.gradient(angle, 1e-3)
    motion = np.where(np.arange(4001) == 70, np.nan, motion)
    trace = Trace(np.zeros((4001, 1)), motion[:, None], 1e-3)
    task = task_of(("motor.ripple_order",), roles=Roles(("motor_torque",), (role,)))
    model = model_over(trace, task=task, point=Point(np.array([order]), ()))
    assert bool(CAUSES["torque-ripple"].implausible(model, BASE)) == none
