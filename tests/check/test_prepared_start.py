"""The expected gain of a start: that of its fit for a small effect, and nothing for an absent law."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model, all_samples, fit_from_start, initial_noise, masked_loss
from drivetool.check.search.candidate_fit import screen
from drivetool.check.search.prepared_start import log_gain, prepare_start, reference_model
from drivetool.check.search.search import MIN_EXPECTED_GAIN
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, roles_of
from tests.recover import drive_like, reversing_record, tried
from tests.simulator.effects import Effects
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "total.viscous", "total.idle_torque", "shaft.stiffness", "shaft.damping")
MACHINE = machine_by_seed(20)
RATED = MACHINE.rated_torque
TOP = 0.15 * RATED / sum(MACHINE.inertia)  # rad/s, the fastest motion
SMALL = {
    "none": MACHINE,
    "quadratic-drag": replace(MACHINE, effects=Effects(quadratic=(0.0, 0.004 * RATED / TOP**2))),
    "coulomb-motor": replace(MACHINE, coulomb=(0.001 * RATED, 0.0)),
    "dead-time": replace(MACHINE, dead_time=3e-4),
    "speed-filter": replace(MACHINE, effects=Effects(filter_time=4e-4)),
    "backlash": replace(MACHINE, half_gap=(0.02 * 0.1 * RATED / MACHINE.stiffness[0],)),
}
AMPLITUDES = ("quadratic-drag", "coulomb-motor", "asymmetric-friction", "load-dependent-damping",
              "hardening-stiffness", "friction-drift", "load-step", "stribeck-motor")
FINITE = ("dead-time", "converter-lag", "speed-filter", "backlash")


@cache
def base_of(name: str) -> Model:
    """A base of a record of a machine with a small effect, that lacks it."""
    record, _ = reversing_record(SMALL[name], 20, 4.0)
    drive = drive_like(MACHINE, list(FREE))
    return fit_from_start(Task(drive, FREE, roles_of([record], drive), (record,)))


def displaced(model: Model, off: float) -> Model:
    """The model with its values off by that share, under the noise that is likeliest there."""
    masks = all_samples(model.problem)
    values = model.point.values * (1.0 + off * np.array([1.0, -1.0, 1.0, 0.1, -1.0, 1.0]))
    point = Point(values, model.point.starts)
    noise = initial_noise(model.problem, point, masks)
    return replace(model, point=point, noise=noise, value=masked_loss(model.problem, point, noise, masks))


def expected_gain_of(model: Model, code: str) -> float:
    return screen(CAUSES[code], [reference_model(model)], all_samples(model.problem)).expected_gain


@pytest.mark.slow
@pytest.mark.parametrize("code", [c for c in SMALL if c != "none"])
def test_the_expected_gain_of_a_small_effect_is_that_of_its_fit(code):
    """Amplitudes and values of finite size alike; the noise that falls beside the fit is not in a linear step."""
    base = base_of(code)
    gain = base.value - tried(code, base).model.value
    assert 10.0 < gain < 100.0
    assert 0.4 * gain < expected_gain_of(base, code) < 1.1 * gain


@pytest.mark.slow
@pytest.mark.parametrize("code", [*AMPLITUDES, *FINITE])
def test_an_absent_law_expects_less_gain_than_is_worth_a_fit(code):
    """A gap may begin under another noise than its stand, which brings some by itself."""
    assert expected_gain_of(base_of("none"), code) < (1.5 if code == "backlash" else 0.5) * MIN_EXPECTED_GAIN


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.02, 0.03])
def test_nor_does_it_on_a_stand_that_is_away_from_its_optimum(off):
    """What a step of the stand's own parameters gains is no gain of a cause."""
    base = base_of("none")
    stand = reference_model(displaced(base, off))
    assert reference_model(base).own_gain < 0.1 and stand.own_gain > 20.0
    assert stand.model.value > base.value + 20.0
    masks = all_samples(base.problem)
    for code in (*AMPLITUDES, *FINITE):
        assert screen(CAUSES[code], [stand], masks).expected_gain < 0.5 * MIN_EXPECTED_GAIN, code


@pytest.mark.parametrize("code", ["coulomb-motor", "dead-time"])
def test_a_present_law_expects_gain_from_there_too(code):
    assert expected_gain_of(displaced(base_of(code), 0.003), code) > MIN_EXPECTED_GAIN


@pytest.mark.parametrize("code", AMPLITUDES)
def test_amplitudes_begin_where_a_linear_step_leads_and_nothing_else_has_moved(code):
    base = base_of("none")
    stand, masks = reference_model(base), all_samples(base.problem)
    start = CAUSES[code].starts(base)[0]
    found = prepare_start(stand, CAUSES[code], start, masks)
    assert set(found.std) == set(start.amplitudes) and all(std > 0.0 for std in found.std.values())
    for name, value, low, high in zip(start.task.free, found.model.point.values, found.model.problem.low,
                                      found.model.problem.high, strict=True):
        assert low <= value <= high
        if name not in start.amplitudes:
            assert value == start.task.drive.value(name), name
    # With everything else moved by its step it begins elsewhere; the likelier of both is taken.
    ready = found.ready(masks)
    points = [masked_loss(ready.problem, p, ready.noise, masks) for p in (found.model.point, found.other)]
    assert masked_loss(ready.problem, ready.point, ready.noise, masks) == min(points)


@pytest.mark.parametrize(("share", "exact"), [(0.1, True), (0.9, True), (1.1, False)])
def test_a_step_gains_by_the_logarithm_of_the_cost_that_goes(share, exact):
    """Of n errors with a variance of their own: n / 2 log of what it was over what it is."""
    class Problem:
        count, unknowns = 1000, 10

    found = log_gain(share * 0.5 * 990.0, Problem())
    assert found == (pytest.approx(-0.5 * 990.0 * np.log(1.0 - share)) if exact else -np.inf)
