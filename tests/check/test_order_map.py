"""The order map: an upright ridge where a torque repeats with the angle, and hardly a cell where nothing does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.fit.model import fit_from_start
from drivetool.check.starts.scan import likely_orders
from drivetool.check.verdict.order_map import order_maps
from drivetool.drive import one_body
from drivetool.files.figures import svg
from drivetool.files.figures.plots import png
from drivetool.identify.setup import Task, roles_of
from drivetool.logs import Experiment

STEP, INERTIA, NOISE = 1e-3, 0.5, 0.002
FREE = ("motor.inertia", "motor.viscous")


def base_of(order=6.0, amplitude=0.4, hertz=0.0, size=12_000, up=10.0, motion="rad", turn=1.0):
    """The base of a record of a torque up, then coasting, from 5 rad/s; a wave over its angle, or of one frequency.

    turn  [m/rad] of a linear drive; orders are per radian there, too
    """
    rng = np.random.default_rng(7)
    speed, angle = np.empty(size), np.empty(size)
    v, x = 5.0, 0.0
    torque = np.where(np.arange(size) < size // 2, up, 0.0)
    torque_noise = rng.normal(0.0, 0.02, size)
    for k in range(size):
        speed[k], angle[k] = v, x
        wave = amplitude * np.sin(2.0 * np.pi * hertz * k * STEP if hertz else order * x + 0.7)
        rate = (torque[k] + torque_noise[k] + wave - 0.02 * v) / INERTIA
        v, x = v + rate * STEP, x + v * STEP + 0.5 * rate * STEP**2
    measured = turn * (speed + rng.normal(0.0, NOISE, size))
    units = {"motion_unit": motion, "torque_unit": "N" if motion == "m" else "Nm"}
    e = Experiment("up.parquet", "0" * 64, STEP, 0.0, {"motor_torque": torque, "motor_speed": measured},
                   ((0, size),), torque_is="command", **units)
    drive = one_body(units["torque_unit"], motion).with_values(
        {"motor.inertia": INERTIA / turn, "motor.viscous": 0.02 / turn})
    return fit_from_start(Task(drive, FREE, roles_of([e], drive), (e,)))


def ridge_of(picture):
    """(order of the largest amplitude over all speeds, share of speeds at which it is drawn, its median there)."""
    heat = picture.heat
    drawn = heat.values[np.isfinite(heat.values).any(axis=1)]
    best = int(np.argmax(np.nan_to_num(drawn).mean(axis=0)))
    return 0.5 * (heat.x[best] + heat.x[best + 1]), np.isfinite(drawn[:, best]).mean(), np.nanmedian(drawn[:, best])


def test_a_torque_over_the_angle_is_an_upright_ridge_of_its_amplitude():
    base = base_of()
    (picture,) = order_maps(base, {**base.fitted.drive.values, "motor.ripple_order": 6.0}, ("Nm", "rad"))
    order, share, amplitude = ridge_of(picture)
    assert order == pytest.approx(6.0, abs=0.1) and share > 0.9
    assert amplitude == pytest.approx(0.4, rel=0.15)
    assert list(picture.curves) == ["6"] and picture.heat.label == "amplitude [Nm]"
    assert picture.heat.values.shape == (len(picture.heat.y) - 1, len(picture.heat.x) - 1)
    assert svg(picture) == svg(picture) and png(picture) == png(picture)


@pytest.mark.parametrize(("amplitude", "hertz"), [(0.0, 0.0), (0.4, 40.0)])
def test_neither_noise_nor_a_fixed_frequency_is_an_upright_ridge(amplitude, hertz):
    base = base_of(amplitude=amplitude, hertz=hertz)
    (picture,) = order_maps(base, base.fitted.drive.values, ("Nm", "rad"))
    assert ridge_of(picture)[1] < 0.6 and not picture.curves
    if not hertz:  # one cell in a hundred, of those in which a speed was driven
        drawn = np.isfinite(picture.heat.values)
        assert drawn[drawn.any(axis=1)].mean() < 0.02


def test_a_fixed_frequency_is_a_curved_ridge():
    base = base_of(hertz=40.0, amplitude=0.8)
    (picture,) = order_maps(base, base.fitted.drive.values, ("Nm", "rad"))
    heat = picture.heat
    speed, order = (0.5 * (edges[1:] + edges[:-1]) for edges in (heat.y, heat.x))
    rows = np.isfinite(heat.values).any(axis=1)
    at = [int(np.argmin(np.abs(order * v - 2.0 * np.pi * 40.0))) for v in speed[rows]]
    seen = [np.isfinite(row[k - 1:k + 2]).any() for row, k in zip(heat.values[rows], at, strict=True)]
    assert np.mean(seen) > 0.9


def test_an_order_that_the_fast_half_of_a_record_cannot_show_is_found_in_the_slow_half():
    base = base_of(order=32.0, amplitude=0.8, size=6000, up=16.0)  # 450 Hz at 88 of 95 rad/s
    assert likely_orders(base)[0] == pytest.approx(32.0, abs=0.02)


def test_a_motor_that_hardly_turns_has_no_map():
    base = base_of(size=3000, up=0.5)
    assert order_maps(base, base.fitted.drive.values, ("Nm", "rad")) == ()


def test_a_carriage_has_periods_per_metre():
    base = base_of(motion="m", turn=0.01)
    (picture,) = order_maps(base, base.fitted.drive.values, ("N", "m"))
    order, share, _ = ridge_of(picture)
    assert order == pytest.approx(6.0 / 0.01 / (2.0 * np.pi), rel=0.02) and share > 0.9
    assert picture.x == "periods per metre [1/m]" and "force" in picture.title and "N" in picture.heat.label


def test_a_recording_in_two_pieces_has_one_map():
    base = base_of()
    trace, start = base.problem.traces[0], base.point.starts[0]
    twice = replace(base, problem=replace(base.problem, traces=(trace, trace)),
                    point=replace(base.point, starts=(start, start)))
    found = order_maps(twice, base.fitted.drive.values, ("Nm", "rad"))
    assert [p.title for p in found] == ["up.parquet: order map of the torque that the base lacks"]
