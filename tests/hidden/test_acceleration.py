"""Cogging on records whose speed only rises and falls: constant torque up, then coasting. Its frequency sweeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from tests.hidden.case import make_case
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.start import DRIVES, plain_values
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import running
from tests.simulator.papers import BUS, BUS_NOISE, BUS_STEP, MASS, RADIUS, ROLLING, WHEELS
from tests.simulator.records import quantise, white_noise, write_parquet

OFF = 0.08  # largest error of a start value
BUS_UNITS = {"shaft.ratio": "1", "motor.inertia": "kg m^2", "wheels.inertia": "kg m^2", "wheels.carried_mass": "kg",
             "wheels.radius": "m", "shaft.stiffness": "Nm/rad", "shaft.damping": "Nm s/rad",
             "total.viscous": "Nm s/rad", "total.idle_torque": "Nm"}


def rig(seed):
    """(machine, sampling time, torque up, seconds of a half, first speed, noise, drive, values) of a rig."""
    case = make_case("none", seed, seed=1)
    one = case.rig
    return (one.machine, 1e-3, 0.5 * one.rated, 6.0, 0.3 * one.top,
            (case.noise.torque, case.noise.sensors["motor_speed"], 1e-9),
            {"name": DRIVES[2], "torque_unit": "Nm", "motion_unit": "rad"}, plain_values(one))


def bus():
    """The same of the bus; what is known of a vehicle is its ratio, its wheels and its friction."""
    ratio = BUS.ratio[0]
    values = {"shaft.ratio": ratio, "motor.inertia": BUS.inertia[0], "wheels.inertia": WHEELS,
              "wheels.carried_mass": MASS, "wheels.radius": RADIUS, "shaft.stiffness": BUS.stiffness[0],
              "shaft.damping": BUS.damping[0], "total.viscous": BUS.viscous[0] + BUS.viscous[1] / ratio**2,
              "total.idle_torque": ROLLING / ratio}
    return (BUS, BUS_STEP, 450.0, 12.0, 20.0, (*BUS_NOISE, 1e-2),
            {"name": "vehicle", "bodies": ["motor", "wheels"], "shafts": ["shaft"]}, values)


def said_of(folder, what, order, share, hertz=0.0, seed=1):
    """The answer to a record of a machine with cogging of a share of its torque, or a torque of one frequency."""
    machine, step, up, half, first, (torque_noise, speed_noise, resolution), drive, values = what
    size = round(half / step)
    torque = np.concatenate((np.full(size, up), np.zeros(size)))
    noise = torque_noise * white_noise(2 * size, 1.0, 2 * seed)
    if hertz:
        noise = noise + share * up * np.sin(2.0 * np.pi * hertz * step * np.arange(2 * size))
    else:
        machine = replace(machine, effects=replace(machine.effects, ripple=(share * up, order, 0.7)))
    run = simulate_fast(machine, torque, step, running(machine, first), None, noise)
    speed = quantise(run.speeds[:, 0] + white_noise(2 * size, speed_noise, 2 * seed + 1), resolution)
    record = folder / "up.parquet"
    write_parquet(record, {"motor_torque": (torque, "Nm"), "motor_speed": (speed, "rad/s")}, step)
    rng = np.random.default_rng([seed, 77])
    known = ("total.", "shaft.ratio", "wheels.inertia", "wheels.radius")
    start = {n: v if n.startswith(known) else v * (1.0 + OFF * rng.uniform(-1.0, 1.0)) for n, v in values.items()}
    sections = {n: {"value": float(f"{v:.6g}"), "unit": BUS_UNITS[n]} if "bodies" in drive else float(f"{v:.6g}")
                for n, v in start.items()}
    path = folder / "start.yaml"
    path.write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": drive, "parameters": sections}))
    return greybox_and_diagnose(folder, [record], path, (), ["--plot", "pictures"]), share * up


@pytest.mark.slow
@pytest.mark.parametrize(("make", "order"), [
    (lambda: rig(943), 6.0), pytest.param(lambda: rig(951), 12.0, marks=pytest.mark.long),
    pytest.param(bus, 6.0, marks=pytest.mark.long)], ids=["rig", "another rig", "bus"])
def test_cogging_is_named_with_its_order_where_its_frequency_sweeps(tmp_path, make, order):
    answer, amplitude = said_of(tmp_path, make(), order, 0.03)
    assert (answer.verdict, answer.causes) == ("named", ("torque-ripple",)), answer.stderr
    found = answer.parameters
    assert found["motor.ripple_order"]["value"] == pytest.approx(order, abs=0.01)
    size = np.hypot(*(found[f"motor.ripple_{part}"]["value"] for part in ("sine", "cosine")))
    assert size == pytest.approx(amplitude, rel=0.2)
    assert (tmp_path / "pictures" / "diagnose-up-diagnosis-order-map.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("make", "hertz", "share"), [
    (lambda: rig(943), 0.0, 0.0), pytest.param(lambda: rig(943), 25.0, 0.03, marks=pytest.mark.long),
    pytest.param(bus, 0.0, 0.0, marks=pytest.mark.long), (bus, 40.0, 0.03)],
    ids=["rig", "rig with a hum", "bus", "bus with a hum"])
def test_neither_noise_nor_a_hum_is_called_an_order(tmp_path, make, hertz, share):
    answer, _ = said_of(tmp_path, make(), 6.0, share, hertz)
    assert "torque-ripple" not in (*answer.causes, *answer.between), answer.stderr
    assert answer.verdict in ("nothing-found", "unexplained")
