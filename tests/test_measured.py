"""Real machines, found through the environment variable DRIVETOOL_RECORDS; absent means skipped."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.check import diagnose
from drivetool.check.outcome import OUTSIDE_CATALOGUE, DiagnoseOptions
from drivetool.drive import one_body, two_mass
from drivetool.identify.frequency import SpectraOptions, spectra
from drivetool.identify.greybox import default_free, greybox
from drivetool.identify.setup import Options
from drivetool.logs.channels import ChannelMap
from drivetool.logs.door import open_experiment
from tests.hidden.command import read, run

FOLDER = os.environ.get("DRIVETOOL_RECORDS", "")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not FOLDER, reason="DRIVETOOL_RECORDS is not set")]


BENCH = two_mass("A", "rad").with_values({
    "motor.inertia": 2e-3, "load.inertia": 2e-3, "shaft.stiffness": 2e-3 * (2 * np.pi * 50.0) ** 2,
    "shaft.damping": 0.05})


RATE, PERIOD = 2500, 2500  # of the bench [Hz], [samples]


def slope(x, order=0, most=300.0):
    """(n,) derivative of what is below a frequency [Hz], by a filter of 801 taps."""
    frequency, taps = np.fft.fftfreq(8192, 1.0 / RATE), np.arange(-400, 401)
    passed = 0.5 + 0.5 * np.cos(np.pi * np.clip((np.abs(frequency) - most) / 30.0, 0.0, 1.0))
    response = np.fft.ifft((2j * np.pi * frequency) ** order * passed).real
    return np.convolve(x, response[taps] * np.kaiser(len(taps), 6.0), "same")


def left_by(target, laws):
    """(what least squares over five periods leaves that repeats from period to period, factors of the laws)."""
    rows = np.column_stack([*(law[PERIOD:6 * PERIOD] for law in laws), np.ones(5 * PERIOD)])
    size = rows.std(axis=0) + (rows.std(axis=0) == 0.0)
    wanted = target[PERIOD:6 * PERIOD]
    factors = np.linalg.lstsq(rows / size, wanted, rcond=None)[0] / size
    return float((wanted - rows @ factors).reshape(5, PERIOD).mean(axis=0).std()), factors


def opened(name, **roles):
    content = {"schema": "drivetool/channel-map/1", "roles": roles}
    return open_experiment(Path(FOLDER) / name, ChannelMap.from_mapping(content))


def test_motor_bench_resonates_where_its_frequency_response_does():
    bench = opened("motorbench-a.parquet",
                   motor_torque={"channel": "iq", "unit": "A"},
                   motor_angle={"channel": "theta_m", "unit": "rad"},
                   load_angle={"channel": "theta_l", "unit": "rad"}).between(0.0, 3.0)
    values = greybox([bench], BENCH, Options()).drive.values
    jm, jl, ks = (values[n] for n in ("motor.inertia", "load.inertia", "shaft.stiffness"))
    assert np.sqrt(ks * (1 / jm + 1 / jl)) / 2 / np.pi == pytest.approx(76.3, abs=0.5)
    assert np.sqrt(ks / jl) / 2 / np.pi == pytest.approx(54.0, abs=0.5)
    assert jl / jm == pytest.approx(1.0, abs=0.03)


def test_emps_simulates_its_position_within_the_published_kind_of_error():
    axis = opened("emps.parquet", motor_torque={"channel": "force", "unit": "N"},
                  motor_angle={"channel": "q", "unit": "m"})
    start = one_body("N", "m").with_values({"motor.inertia": 80.0})
    estimate = greybox([axis], start, Options(criterion="simulation", segment=0.0))
    assert {p.name for p in estimate.parameters if p.status == "fitted"} == {
        "motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque"}
    # One free run over the whole record, start position and speed estimated.
    assert estimate.fit["rmse"] <= 2.7e-3
    assert estimate.drive.values["motor.inertia"] == pytest.approx(95.1, rel=0.05)


def test_the_default_fit_of_emps_agrees_with_the_published_parameters():
    # Janot, Gautier and Brunot, least squares on the inverse dynamics; an innovations fit has 331 N s/m and 6.7 N.
    axis = opened("emps.parquet", motor_torque={"channel": "force", "unit": "N"},
                  motor_angle={"channel": "q", "unit": "m"})
    drive = one_body("N", "m").with_values({"motor.inertia": 80.0})
    estimate = greybox([axis], drive, Options(free=("all",)))
    lines = {p.name: p for p in estimate.parameters}
    for name, published, share in (("motor.inertia", 95.1089, 0.02), ("motor.viscous", 203.5034, 0.05),
                                   ("motor.coulomb", 20.3935, 0.05), ("motor.idle_torque", -3.1648, 0.1)):
        line, most = lines[name], share * abs(published)
        assert abs(line.value - published) < most and line.ci95[1] - line.ci95[0] < 2.0 * most
    assert "direction-dependent friction" in [law.name for law in estimate.laws]


def test_inverse_dynamics_of_emps_are_the_published_ones():
    axis = opened("emps.parquet", motor_torque={"channel": "force", "unit": "N"},
                  motor_angle={"channel": "q", "unit": "m"}, reference_angle={"channel": "q_ref", "unit": "m"})
    drive = one_body("N", "m").with_values({"motor.inertia": 80.0})
    found = greybox([axis], drive, Options(criterion="inverse")).drive.values
    for name, published, most in (("motor.inertia", 95.1089, 0.33), ("motor.viscous", 203.5034, 3.4),
                                  ("motor.coulomb", 20.3935, 0.30), ("motor.idle_torque", -3.1648, 0.13)):
        assert found[name] == pytest.approx(published, abs=most)
    found = greybox([axis], drive, Options(criterion="inverse", free=("motor.viscous_asymmetry",))).drive.values
    for sign, viscous, coulomb in ((1.0, 166.7061, 20.1440), (-1.0, 240.4236, 20.6277)):
        assert found["motor.viscous"] + sign * found["motor.viscous_asymmetry"] == pytest.approx(viscous, abs=3.7)
        assert found["motor.coulomb"] + sign * found["motor.idle_torque"] == pytest.approx(coulomb, abs=0.33)


DAMPER = {"motor.inertia": 1.0, "load.inertia": 60.0, "load.coulomb": 9000.0, "shaft.stiffness": 1.2e6,
          "shaft.damping": 4000.0, "shaft.half_gap": 1.2e-3, "shaft.hardening": 2.0, "shaft.hardening_twist": 2e-3,
          "shaft.hardening_power": 1.0}


@pytest.mark.slow
def test_a_banded_damper_is_friction_behind_a_gap_and_a_hardening_spring():
    """Judged by the other record, one factor on all friction refitted; its owners' model leaves 0.22."""
    def fitted(name, drive, free, hold):
        record = opened(f"damper-{name}.parquet", motor_torque={"channel": "force", "unit": "N"},
                        motor_angle={"channel": "displacement", "unit": "m"})
        return greybox([record], drive, Options(criterion="inverse", free=free, hold=hold))

    start, mover = two_mass("N", "m").with_values(DAMPER), ("motor.inertia", "motor.viscous", "motor.coulomb")
    found = {k: fitted(k, start, ("shaft.half_gap", "shaft.hardening"), mover) for k in "ab"}
    lines = {k: {p.name: p for p in e.parameters} for k, e in found.items()}
    assert all(e.fit["torque_rmse_over_sd"] <= 0.16 for e in found.values())
    friction, gap = (([lines[k][n] for k in "ab"]) for n in ("load.coulomb", "shaft.half_gap"))
    assert friction[1].value - friction[0].value > 5.0 * np.hypot(friction[0].std, friction[1].std)
    assert abs(gap[1].value - gap[0].value) < 2.0 * np.hypot(gap[0].std, gap[1].std)
    for k, other in ("ab", "ba"):
        drive = found[k].drive
        names = (*default_free(drive, []), "shaft.half_gap", "motor.coulomb", "load.coulomb")
        judged = fitted(other, drive, ("friction.factor",), names)
        assert judged.fit["torque_rmse_over_sd"] <= 0.16  # required 0.22, hoped for 0.15


def test_another_record_identifies_the_missing_friction_and_gap_of_a_damper():
    """The band of the other is drawn tighter: one factor on all friction is its own."""
    records = [opened(f"damper-{k}.parquet", motor_torque={"channel": "force", "unit": "N"},
                      motor_angle={"channel": "displacement", "unit": "m"}) for k in "ab"]
    start_values = {"motor.inertia": 1.0, "motor.viscous": 0.0, "motor.coulomb": 0.0, "load.inertia": 60.0,
             "load.viscous": 30000.0, "shaft.stiffness": 1.2e6, "shaft.damping": 4000.0}
    base = greybox(records[:1], two_mass("N", "m").with_values(start_values),
                   Options(criterion="inverse", hold=("motor.inertia", "motor.viscous", "motor.coulomb")))
    free = [p.name for p in base.parameters if p.status != "held"]
    own = "friction.factor@b"
    drive = replace(base.drive, records={"b": records[1].sha256}).with_values({own: 1.0})
    options = DiagnoseOptions(("coulomb-load", "backlash", "hardening-stiffness", "quadratic-drag"), rounds=2,
                            criterion="inverse")
    found = diagnose(records[:1], drive, free, options, records[1:], start_values, (own,))
    # A spring that hardens and a gap behind a linear one make nearly the same force over the way.
    assert "coulomb-load" in found.causes
    assert {"backlash", "hardening-stiffness"} & {*found.causes, *found.between}
    assert "quadratic-drag" not in found.causes
    assert found.gain.held_out_rmse_after < 0.6 * found.gain.held_out_rmse_before
    assert found.gain.further_record_interval[0] > 0.0


@pytest.mark.parametrize("end", [4.0, pytest.param(20.0, marks=pytest.mark.long)])
def test_motor_bench_in_the_frequency_domain_agrees_with_the_time_domain(end):
    """Twenty periods of a multisine; both fits over the same seconds.

    In the whole record the motor's encoder slips at 7.06 and 14.20 s, which averaging over periods shrugs off.
    """
    bench = opened("motorbench-a.parquet",
                   motor_torque={"channel": "iq", "unit": "A"},
                   motor_angle={"channel": "theta_m", "unit": "rad"})
    seen = spectra([bench], SpectraOptions())
    assert seen.mean.method == "periodic" and seen.settings["period"] == pytest.approx(1.0)
    np.testing.assert_allclose(seen.mean.frequency, np.arange(11.0, 251.0))  # the lines its owners excited
    peaks = {p.kind: p.hz for p in seen.peaks}
    assert peaks["resonance"] == pytest.approx(76.3, abs=1.0) and peaks["anti-resonance"] == pytest.approx(54,
        abs=1.0)
    estimates = [greybox([bench.between(0.0, end)], BENCH, Options(criterion=c))
                 for c in ("frequency", "innovations")]
    found = [{p.name: p for p in e.parameters} for e in estimates]
    left = [f for f in estimates[1].findings if f.code == "outliers-left-out"]
    if end == 20.0:
        assert {7.06, 14.2} <= set(map(float, left[0].evidence["instants"].split()))
        assert left[0].evidence["count"] < 100
    for name in ("motor.inertia", "load.inertia", "shaft.stiffness"):
        a, b = (lines[name] for lines in found)
        assert abs(a.value - b.value) < 3.0 * np.hypot(a.std, b.std), name
        assert a.value == pytest.approx(b.value, rel=0.02), name
    jm, jl, ks = (found[0][n].value for n in ("motor.inertia", "load.inertia", "shaft.stiffness"))
    assert np.sqrt(ks * (1 / jm + 1 / jl)) / 2 / np.pi == pytest.approx(76.3, abs=0.5)
    assert np.sqrt(ks / jl) / 2 / np.pi == pytest.approx(54.0, abs=0.5)


def test_emps_lacks_friction_by_direction_and_a_ripple_of_its_screw(tmp_path):
    """What least squares on the differentiated position says too, without any simulation (README)."""
    (tmp_path / "map.yaml").write_text("schema: drivetool/channel-map/1\nroles:\n"
                                       "  motor_torque: {channel: force, unit: N}\n"
                                       "  motor_angle: {channel: q, unit: m}\n")
    (tmp_path / "start.yaml").write_text("schema: drivetool/parameters/1\ndrive: {bodies: [motor], shafts: []}\n"
                                         "parameters:\n  motor.inertia: {value: 80, unit: kg}\n")
    log = Path(FOLDER) / "emps.parquet"
    both = ["--map", "map.yaml"]
    done = run(tmp_path, ["greybox", log, *both, "--params", "start.yaml", "--out", "base.yaml"])
    assert done.returncode in (0, 3), done.stderr
    done = run(tmp_path, ["diagnose", log, *both, "--params", "base.yaml", "--out", "extended.yaml",
                          "--candidates", "asymmetric-friction,torque-ripple,quadratic-drag,stribeck-motor"])
    answer = read(tmp_path / "extended.yaml", done.stderr)
    assert answer.verdict == "undetermined" and answer.between == ("asymmetric-friction", "torque-ripple",
                                                                   OUTSIDE_CATALOGUE)
    found = {name.removeprefix("motor."): p["value"] for name, p in answer.parameters.items()}
    assert found["viscous_asymmetry"] == pytest.approx(-36.9, abs=3.0)  # published: +-18.4 about 203.5, halved
    orders = sorted(v for n, v in found.items() if n.endswith("_order"))
    # No second harmonic: what 0.125 m/s shows at 1.25 mm is 100 Hz, at standstill too, and nothing at other speeds.
    assert [2.0 * np.pi / order for order in orders] == [pytest.approx(2.50e-3, rel=5e-3)]
    facts = yaml.safe_load((tmp_path / "extended.yaml").read_text())["diagnosis"]["facts"]
    assert facts["after"] < 0.65 * facts["before"]  # both trained on the halves that they are not run over
    assert answer.gain["held_out_rmse_after"] < answer.gain["held_out_rmse_before"]
    assert "narrow-band-disturbance" in done.stderr and "445" in done.stderr and "99.61 Hz" in done.stderr


def test_what_the_motor_bench_lacks_shows_without_a_simulation():
    """The load's acceleration against the two angles: drag, a softer shaft, dry friction and damping, and no mass.

    Torque acts between a held and an interpolated one. Answers of `diagnose` that the README prints.
    """
    table = pq.read_table(Path(FOLDER) / "motorbench-a.parquet")
    motor, load, torque = (table[name].to_numpy().astype(float) for name in ("theta_m", "theta_l", "iq"))
    quick = {n: slope(x, 1, 600.0) for n, x in (("motor", motor), ("load", load), ("twist", motor - load))}
    twist = slope(motor - load, 0, 600.0)
    twist = twist - twist[PERIOD:6 * PERIOD].mean()
    plain = [slope(motor - load), slope(load, 1), slope(motor - load, 1)]
    laws = {"drag": np.abs(quick["load"]) * quick["load"], "cubic": twist**3, "dry": np.sign(quick["load"]),
            "lossy": np.abs(twist) * quick["twist"]}
    laws = {n: slope(law) for n, law in laws.items()}
    known, left = list(plain), [left_by(slope(load, 2), plain)[0]]
    for law in laws.values():
        known.append(law)
        left.append(left_by(slope(load, 2), known)[0])
    assert left == pytest.approx([71.6, 48.5, 39.9, 38.1, 35.8], abs=0.3)  # rad/s^2, of which chance is 2
    without_loss = known[:-1]
    assert left_by(slope(load, 2), [*without_loss, slope(motor, 2)])[0] > 0.998 * left[-2]  # a mass before the load
    factors = left_by(slope(load, 2), known)[1]
    stiffness = factors[0]  # over the load's inertia
    assert factors[6] / stiffness == pytest.approx(2.5e-4, rel=0.1)  # damping per torque [s/A]
    assert factors[4] / stiffness == pytest.approx(-1.33, rel=0.05)  # softer, per rad^2
    late = [slope(motor, 2), slope(motor - load), slope(motor, 1), slope(motor - load, 1), slope(torque, 1)]
    found, factors = left_by(slope(torque), late)
    assert found < 0.55 * left_by(slope(torque), late[:-1])[0]
    assert factors[-2] == pytest.approx(1.07e-4, rel=0.05)  # s; half a sample, 2e-4, if it were held
