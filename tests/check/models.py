"""Models and ends of a search made by hand, for tests of the decisions that are taken on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from drivetool.check.fit.model import Model
from drivetool.check.fit.residual_tests import ResidualTests
from drivetool.check.heldout.scores import Fold
from drivetool.check.outcome import DiagnoseOptions, Gain
from drivetool.check.search.result import Base, SearchResult, SelectedCauses
from drivetool.check.search.search import ForwardSelection
from drivetool.drive import one_body, two_mass
from drivetool.identify.noise import Noise
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, roles_of
from tests.recover import STEP, experiment


def task_of(free=(), drive=None, roles=None, experiments=()) -> Task:
    """A drive, two masses unless it is said, to be fitted to some records or to none."""
    return Task(drive or two_mass(), tuple(free), roles, tuple(experiments))


def model_of(code="base", value=0.0, free=("motor.inertia",), drive=None, **parts) -> Model:
    """A model with these names free and this -log likelihood, fitted to nothing."""
    return replace(Model(code, task_of(free, drive), None, None, None, value), **parts)


@cache
def true_model(noise=0.02) -> Model:
    """One body at its true values over half a second of its motion; noise: std of its speed sensor [rad/s]."""
    torque = np.sin(40.0 * STEP * np.arange(500))
    speed = np.concatenate([[0.0], np.cumsum(torque[:-1])]) * STEP / 0.02
    record = experiment(torque, speed + noise * np.random.default_rng(1).standard_normal(500))
    drive = one_body().with_values({"motor.inertia": 0.02, "motor.viscous": 0.0, "motor.idle_torque": 0.0})
    task = task_of(("motor.inertia",), drive, roles_of([record], drive), [record])
    problem, point = task.problem(), Point(np.array([0.02]), (np.zeros(1),))
    return Model("base", task, problem, point, Noise(0.2, None, problem.scale), 0.0)


def model_over(*traces, **parts) -> Model:
    """That model over other stretches of record."""
    model = true_model()
    return replace(model, problem=replace(model.problem, traces=traces), **parts)


class Unfolded(ForwardSelection):
    """A search on top of one body at its true values, or of another model; a base is that of its only fold, too."""

    def __init__(self, wanted=(), possible=(), root=None, **given):
        options = DiagnoseOptions(**given)
        super().__init__(root or true_model(), None, tuple(wanted), frozenset(possible), options)

    def base(self, model):
        return Base(model, (Fold((), (), (), model, 0.0),))


@dataclass(frozen=True)
class Ended(SearchResult):
    """The end of a search whose free runs gained as much as is given."""

    gain: Gain | None = None

    def judged_gain(self) -> Gain:
        return self.gain


def ended(model=None, causes=(), left=0.0, time=0.0, first=None, **parts) -> Ended:
    """The end of a search over two masses that found these causes; left: of its residuals, time: between halves."""
    model = model or model_of()
    return Ended(**{
        "split": None, "options": DiagnoseOptions(), "faults": (), "notes": (), "train": (), "rounds": (),
        "first": Base(first or model, ()), "origin": Base(model, ()), "model": model, "whole": model, "trained": (),
        "found": SelectedCauses(tuple(causes)), "left": ResidualTests(left, 0.0, 0.0, time), **parts})
