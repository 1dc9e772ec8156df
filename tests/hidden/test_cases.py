"""The hidden-effect cases: what is in the files, what is only in the label, and how visible it is."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from tests.hidden import CODES, KINDS, greybox_options, make_case, plain_values, write_start
from tests.hidden.case import noise_of
from tests.hidden.command import Answer, grade, greybox_and_diagnose, read, run
from tests.hidden.profiles import STEP, profile
from tests.hidden.rigs import resonances, rig_by_seed
from tests.hidden.visibility import separation, visible
from tests.hidden.whiten import Whitener, outputs
from tests.simulator.fast import simulate_fast
from tests.simulator.simulate import simulate_linear
from tests.study import study_diagnose

SHORT = {"duration": 3.0}
GROWING = sorted(set(KINDS) - {"wrong-sign", "wrong-sign-shaft", "torque-offset"})


# Machines and experiments


def test_rigs_are_what_they_are_said_to_be():
    rigs = [rig_by_seed(seed) for seed in range(200)]
    motor, load = np.array([rig.machine.inertia for rig in rigs]).T
    hertz = np.array([rig.resonance for rig in rigs])
    reduced = motor * load / (motor + load)
    stiffness, damping = (np.array([getattr(rig.machine, f)[0] for rig in rigs]) for f in ("stiffness", "damping"))
    zeta = damping / 2.0 / np.sqrt(stiffness * reduced)
    for values, low, high in ((load / motor, 0.1, 10.0), (hertz, 5.0, 60.0), (zeta, 0.01, 0.1)):
        assert low <= values.min() < 1.2 * low and 0.83 * high < values.max() <= high * (1 + 1e-9)
    three = rig_by_seed(7, 3)
    assert resonances(three.machine)[0] == pytest.approx(rigs[7].resonance)
    assert three.machine.inertia[0] == rigs[7].machine.inertia[0]
    axis = rig_by_seed(7, 2, True, {-1: 0.03})
    assert axis.units == ("N", "m") and axis.machine.coulomb == (0.0, 0.03 * axis.rated)


@pytest.mark.parametrize("seed", [1, 6])
def test_less_careful_experiments_are_what_they_are_called(seed):
    rig = rig_by_seed(seed)
    plans = {kind: profile(kind, rig, seed) for kind in ("moves", "cruise", "chirp", "binary", "steps")}
    runs = {kind: simulate_fast(rig.machine, plan.torque, STEP, plan.start, plan.controller)
            for kind, plan in plans.items()}
    speeds = {kind: run.speeds[:, 0] for kind, run in runs.items()}
    for kind, found in runs.items():
        assert len(found.command) == 12000 and np.abs(found.command).max() < 2.0 * rig.rated, kind
        assert np.ptp(speeds[kind]) > 0.3 * rig.top, kind
    assert speeds["moves"].min() < 0.0 < speeds["moves"].max() and speeds["cruise"].min() > 0.0
    assert np.mean(np.abs(speeds["moves"]) < 0.05 * rig.top) > 0.15
    assert np.all(plans["moves"].torque == 0.0) and plans["chirp"].controller is None
    assert speeds["steps"].min() < 0.0 < speeds["steps"].max()


@pytest.mark.parametrize("seed", [1, 6])
def test_experiments_do_what_they_are_for(seed):
    rig = rig_by_seed(seed)
    runs = {}
    for kind in ("reversing", "one-directional", "closed-loop"):
        plan = profile(kind, rig, seed)
        assert len(plan.torque) == 12000
        runs[kind] = simulate_fast(rig.machine, plan.torque, STEP, plan.start, plan.controller)
        assert np.abs(runs[kind].command).max() < 2.0 * rig.rated
    turns = np.count_nonzero(np.diff(np.sign(runs["reversing"].speeds[:, 1])))
    assert turns >= 8 and np.abs(runs["reversing"].speeds[:, 0]).max() < 2.0 * rig.top
    assert runs["one-directional"].speeds.min() > 0.0
    assert np.ptp(runs["closed-loop"].speeds[:, 0]) > 0.3 * rig.top
    # Shaft torque of both signs, and at several levels.
    torque = runs["reversing"].shaft_torques[:, 0]
    assert torque.min() < 0.0 < torque.max()


# Files and labels


@pytest.mark.slow
def test_files_are_the_same_bytes_again_and_say_nothing_of_the_cause(tmp_path):
    made = []
    for name in ("a", "b"):
        case = make_case("backlash", 3, sensors=("motor_speed", "load_angle"), size=0.08, **SHORT)
        logs, held = case.write(tmp_path / name, tmp_path / f"label-{name}")
        start = write_start(case, tmp_path / name)
        made.append([path.read_bytes() for path in (*logs, *held, start, tmp_path / f"label-{name}/label.json")])
        assert sorted(p.name for p in (tmp_path / name).iterdir()) == [
            "holdout.parquet", "record1.parquet", "start.yaml"]
    assert made[0] == made[1] and made[0][0] != made[0][1]
    assert not any(word in each for each in made[0][:3] for word in (b"backlash", b"half_gap", b"0.08"))
    label = json.loads(made[0][3])
    assert label["causes"] == ["backlash"] and label["effects"][0]["size"] == 0.08
    gap = 0.08 * case.rig.rated / case.rig.machine.stiffness[0]
    assert label["effects"][0]["truth"] == {"shaft.half_gap": pytest.approx(gap)}
    table = pq.read_table(logs[0])
    assert table.column_names == ["time", "motor_torque", "motor_speed", "load_angle"]
    assert [f.metadata[b"unit"] for f in table.schema] == [b"s", b"Nm", b"rad/s", b"rad"]
    other = make_case("backlash", 3, size=0.08, seed=1, **SHORT)
    assert np.abs(other.records[0].run.command - case.records[0].run.command).max() > 1.0


def test_start_values_are_off_by_up_to_fifteen_per_cent(tmp_path):
    case = make_case("stribeck-load", 4, **SHORT)
    content = yaml.safe_load(write_start(case, tmp_path).read_text())
    true = plain_values(case.rig)
    assert content["parameters"].keys() == true.keys() and "load.coulomb" in true
    off = np.array([content["parameters"][name] / value - 1.0 for name, value in true.items()])
    assert np.abs(off).max() <= 0.151 and np.abs(off).max() > 0.05 and off.min() < 0.0 < off.max()
    assert greybox_options(case) == [] and greybox_options(make_case("none", 4, **SHORT)) != []


def test_noise_is_nominal_on_the_rig_of_200_nm():
    case = make_case("none", 1, sensors=("motor_speed", "shaft_torque"), **SHORT)
    machine = replace(case.rig.machine, inertia=(0.587, 5.179), rated_torque=200.0)
    noise = noise_of(replace(case.rig, machine=machine), ("motor_speed",), "nominal")
    assert noise.torque == pytest.approx(0.3) and noise.sensors["motor_speed"] == pytest.approx(0.02)
    loud = noise_of(replace(case.rig, machine=machine), ("motor_speed",), "loud", 2.0)
    assert loud.torque == pytest.approx(3.0) and loud.coloured == pytest.approx(6.0)
    assert loud.sensors["motor_speed"] == pytest.approx(0.1)
    record = case.records[0]
    for role, std in case.noise.sensors.items():
        assert np.std(record.noise[role]) == pytest.approx(std, rel=0.05)
    np.testing.assert_allclose(record.logged["shaft_torque"] - record.noise["shaft_torque"],
                               record.run.shaft_torques[:, 0], atol=1e-12)


def test_loggers_distort_as_specified():
    def error(code, role, **more):
        case = make_case(code, 5, **SHORT, **more)
        record = case.records[0]
        clean = {"motor_speed": record.run.speeds[:, 0], "shaft_torque": record.run.shaft_torques[:, 0],
                 "motor_torque": record.run.command}[role]
        return case, record.logged[role], clean + record.noise.get(role, 0.0)

    case, logged, seen = error("torque-offset", "motor_torque")
    np.testing.assert_allclose(np.abs(logged - seen), 0.02 * case.rig.rated)
    case, logged, seen = error("wrong-sign", "motor_speed")
    np.testing.assert_allclose(logged, -seen)
    assert "motor_angle" in case.records[0].logged
    _, logged, seen = error("wrong-scale-shaft", "shaft_torque")
    assert abs(logged @ seen / (seen @ seen) - 1.0) == pytest.approx(0.05)
    case, logged, seen = error("quantisation", "motor_speed")
    step = case.hidden[0].truth["motor_speed.resolution"]
    np.testing.assert_allclose(logged / step, np.rint(logged / step), atol=1e-6)
    assert np.abs(logged - seen).max() <= 0.5 * step * (1 + 1e-9)
    case, logged, seen = error("outliers", "motor_speed")
    assert np.count_nonzero(logged != seen) == case.hidden[0].truth["motor_speed.spikes"]


@pytest.mark.parametrize(("words", "message"), [
    ({"effects": "backlsh"}, "effect: wanted one of backlash, .*found 'backlsh'"),
    ({"effects": "backlash", "bodies": 1}, "backlash: wanted 2 bodies, found 1"),
    ({"effects": "none", "record": "sideways"}, "record: wanted one of reversing"),
    ({"effects": "none", "noise": "silent"}, "noise: wanted one of nominal"),
    ({"effects": "none", "bodies": 1, "sensors": ("load_speed",)}, "one body: wanted sensors of the motor")])
def test_wrong_words_are_refused(words, message):
    with pytest.raises(ValueError, match=message):
        make_case(machine_seed=1, **words, **SHORT)


# Visibility


@pytest.mark.slow
def test_whitened_noise_is_white_and_of_unit_size():
    case = make_case("none", 2, sensors=("motor_speed", "load_angle"), noise="loud", coloured=2.0, duration=6.0)
    rig, roles = case.rig, tuple(case.noise.sensors)
    white = Whitener(rig.machine, roles, case.noise, dict.fromkeys(roles, 0.0))
    record = case.records[0]
    quiet = simulate_linear(rig.machine, record.run.command, STEP, profile_start(case))
    still = {"motor_speed": quiet.speeds[:, 0], "load_angle": quiet.angles[:, 1]}
    deviation = np.column_stack([record.logged[role] - still[role] for role in roles])
    # Untreated, torque noise has piled up to many times the sensor noise.
    assert np.abs(deviation[-1000:] / list(case.noise.sensors.values())).max() > 8.0
    errors = white(deviation[:, :, None])[:, :, 0]
    assert np.std(errors[20:], axis=0) == pytest.approx(1.0, abs=0.035)
    for lag in (1, 2, 10):
        assert np.abs(np.mean(errors[lag:] * errors[:-lag], axis=0)).max() < 0.045
    assert outputs(rig.machine, roles).shape == (2, 4)


def profile_start(case):
    """Where record 1 of a case of the plain machine began."""
    from tests.simulator.machine import running

    return running(case.rig.machine, float(case.records[0].run.speeds[0, 0]))


@pytest.mark.slow
@pytest.mark.parametrize("code", GROWING)
def test_visibility_grows_with_size_from_nothing(code):
    bodies = KINDS[code].bodies
    usual = KINDS[code].usual
    numbers = [visible(make_case(code, 6, size=share * usual, bodies=bodies, duration=2.0)).number
               for share in (0.0, 0.1, 1.0)]
    assert numbers[0] == 0.0
    assert 1.5 * numbers[1] < numbers[2] and numbers[1] > 0.0


@pytest.mark.slow
def test_what_the_plain_parameters_can_imitate_is_not_visible():
    for sensors in (("motor_speed",), ("motor_speed", "shaft_torque")):
        offset = visible(make_case("torque-offset", 2, sensors=sensors, **SHORT))
        assert offset.converged and offset.number < 1e-3 < 1.0 < offset.before
    # Start states are fitted too: what is known of them does not matter.
    case = make_case("torque-offset", 2, **SHORT)
    run = case.records[0].run
    moved = replace(run, speeds=run.speeds + 0.05 * case.rig.top * (np.arange(len(run.time)) == 0)[:, None])
    other = visible(case, (), (replace(case.records[0], run=moved),))
    assert other.number < 1e-3 and other.before > 10.0
    # A tiny stiff third mass is nearly a heavier load, unless the load is looked at.
    masked_case, visible_case = (visible(make_case("third-mass", 2, size=0.05, sensors=sensors, **SHORT))
                     for sensors in (("motor_speed",), ("motor_speed", "load_speed")))
    assert masked_case.number < 0.1 * masked_case.before and masked_case.number < visible_case.number
    # Of a friction that depends on the direction, one direction shows an ordinary one.
    forward = visible(make_case("asymmetric-friction", 2, record="one-directional", noise="loud", **SHORT))
    assert forward.number < 0.01 < 10.0 < forward.before


@pytest.mark.slow
def test_more_data_shows_more_and_pairs_are_distinguished():
    case = make_case("quadratic-drag", 2, size=0.005, records=2, **SHORT)
    alone = [visible(case, (), (record,)).number for record in case.records]
    both = visible(case).number
    assert both >= 0.99 * np.hypot(*alone) and both > max(alone)
    pair = make_case(["third-mass", "quadratic-drag"], 2, size={"quadratic-drag": 0.0}, **SHORT)
    assert [h.code for h in pair.hidden] == ["third-mass", "quadratic-drag"]
    assert visible(pair, pair.hidden[1:]).number == pytest.approx(visible(
        make_case("third-mass", 2, **SHORT)).number, rel=0.02)


@pytest.mark.slow
def test_separation_from_itself_is_nothing_and_from_a_twin_little():
    case = make_case("dead-time", 2, bodies=1, **SHORT)
    seen = visible(case).number
    assert separation(case, "dead-time", (0.7,)).number < 0.02 * seen
    drag = make_case("quadratic-drag", 2, bodies=1, **SHORT)
    assert separation(drag, "dead-time", (1.0,)).number > 0.5 * visible(drag).number
    turning = make_case("imbalance", 2, bodies=1, **SHORT)
    assert separation(turning, "torque-ripple", (1.0,)).number < 0.02 * visible(turning).number


# At the process boundary


@pytest.mark.slow
def test_a_null_case_is_fitted_by_the_tool(tmp_path):
    case = make_case("none", 2, sensors=("motor_speed", "load_speed"), duration=4.0)
    logs, _ = case.write_records(tmp_path)
    start = write_start(case, tmp_path)
    done = run(tmp_path, ["greybox", logs[0].name, "--params", start.name, "--out", "base.yaml",
                          *greybox_options(case)])
    assert done.returncode == 0, done.stderr
    fitted, true = yaml.safe_load((tmp_path / "base.yaml").read_text())["parameters"], plain_values(case.rig)
    for name in ("motor.inertia", "load.inertia", "shaft.stiffness", "total.idle_torque"):
        assert fitted[name]["value"] == pytest.approx(true[name], abs=4.5 * fitted[name]["std"]), name


def said(verdict, *causes, between=()):
    return Answer(verdict, causes, tuple(between))


@pytest.mark.parametrize(("truth", "answer", "expected", "removed"), [
    ([], said("nothing-found"), "right", "right"),
    ([], said("named", "backlash"), "false-alarm", "false-alarm"),
    ([], said("unexplained"), "false-alarm", "false-alarm"),
    (["backlash"], said("named", "backlash"), "right", "wrong"),
    (["backlash"], said("named", "dead-time"), "wrong", "wrong"),
    (["backlash"], said("named", "backlash", "dead-time"), "wrong", "wrong"),
    (["backlash"], said("undetermined", between=("backlash", "dead-time")), "undetermined", "right"),
    (["backlash"], said("undetermined", between=("hardening-stiffness", "dead-time")), "wrong", "right"),
    (["backlash"], said("nothing-found"), "missed", "missed"),
    (["backlash"], said("unexplained", "dead-time"), "wrong", "right"),
    (["backlash"], said("unexplained"), "unexplained", "right"),
    (["backlash", "dead-time"], said("named", "dead-time", "backlash"), "right", "wrong"),
    (["backlash", "dead-time"], said("named", "dead-time"), "partial", "wrong"),
    (["backlash"], said("failed"), "failed", "failed")])
def test_grades(truth, answer, expected, removed):
    assert grade(truth, answer) == expected and grade(truth, answer, True) == removed


@pytest.mark.slow
def test_an_answer_is_read_from_the_file_and_a_failure_is_an_answer(tmp_path):
    (tmp_path / "x.yaml").write_text(yaml.safe_dump({
        "schema": "drivetool/parameters/1", "parameters": {"shaft.half_gap": {"value": 1.0, "ci95": [0.9, 1.1]}},
        "diagnosis": {"verdict": "named", "causes": ["backlash"], "gain": {"held_out_rmse_after": 0.1},
                      "candidates": [{"code": "backlash", "round": 1, "smallest": {}}]}}))
    answer = read(tmp_path / "x.yaml")
    assert answer.verdict == "named" and answer.causes == ("backlash",) and answer.between == ()
    held = study_diagnose.intervals({"effects": [{"truth": {"shaft.half_gap": 1.05, "other": 1.0}}]}, answer)
    assert held == {"shaft.half_gap": True}
    (tmp_path / "x.yaml").write_text("schema: drivetool/parameters/1\n")
    assert read(tmp_path / "x.yaml").verdict == "failed"
    (tmp_path / "start.yaml").write_text("schema: drivetool/parameters/1\n")
    answer = greybox_and_diagnose(tmp_path, [tmp_path / "missing.parquet"], tmp_path / "start.yaml")
    assert answer.verdict == "failed" and "missing.parquet" in answer.stderr


@pytest.mark.slow
def test_study_goes_on_where_it_stopped(tmp_path, monkeypatch):
    short = {**SHORT, "bodies": 1}
    plans = [study_diagnose.Plan("effect", f"effect/{code}/0", (code,), {"machine_seed": 2, **short})
             for code in ("quadratic-drag", "coulomb-motor")]
    plans += [study_diagnose.Plan("none", f"none/{i}", (), {"machine_seed": i, **short}) for i in range(3)]
    folder_contents = []

    def diagnosing(folder, logs, start, options, more):
        folder_contents.append(sorted(p.name for p in folder.iterdir()))
        verdict = "named" if len(folder_contents) == 1 else "nothing-found"
        return Answer(verdict, ("quadratic-drag",) * (verdict == "named"), (), {"rmse_gain_ci95": [0.3, 0.5]},
                      ({"code": "quadratic-drag", "round": 1, "smallest": {"motor.drag": {"value": 1e-3}}},))

    monkeypatch.setattr(study_diagnose, "fresh_error", lambda *words: {"base": 0.5, "extended": 0.1}[words[2][:-5]])
    path = tmp_path / "build" / "rows.jsonl"
    first = study_diagnose.study(plans[:2], path, 1, diagnosing)
    assert [row["grade"] for row in first] == ["right", "missed"] and first[0]["visibility"] > 10.0
    assert folder_contents[0] == ["holdout.parquet", "record1.parquet", "start.yaml"]
    path.write_text(path.read_text()[:-40])  # Interrupted while writing: the second is run again.
    found = study_diagnose.study(plans, path, 1, diagnosing)
    assert len(folder_contents) == 2 + 1 + 3 and len(found) == 5
    assert len(study_diagnose.study(plans, path, 1, diagnosing)) == 5 and len(folder_contents) == 6
    text = study_diagnose.summary(found)
    assert "false alarms: 0 of 3 null records, 0.00 %, at most 63.16 % (95 %)" in text
    assert "quadratic-drag" in text and "named right or rightly open 1 (50.0 %), wrong 0" in text
    assert "95 % interval of the gain holds that on a fresh record: 2 of 2" in text


@pytest.mark.slow
def test_a_limit_is_looked_for_at_the_visibility_it_aims_for():
    plan = study_diagnose.Plan("limit", "limit/quadratic-drag/7/0", ("quadratic-drag",),
                               {**SHORT, "bodies": 1, "machine_seed": 2}, (), 7.0)
    case = make_case(plan.effects, **study_diagnose.with_aimed_size(plan))
    assert visible(case).number == pytest.approx(7.0, rel=0.1)


def test_study_plans_cover_everything_with_keys_of_their_own():
    plans = study_diagnose.plans({"effect": 2, "removed": 2, "mixed": 2, "limit": 1, "none": 42})
    keys = [plan.key for plan in plans]
    assert len(set(keys)) == len(keys) and sum(plan.part == "none" for plan in plans) >= 1000
    for part in ("effect", "removed"):
        mine = [plan for plan in plans if plan.part == part]
        assert {plan.effects[0] for plan in mine} == set(KINDS)
        assert len({plan.options["machine_seed"] for plan in mine}) == 2 * len(KINDS)
    assert {plan.removed for plan in plans if plan.part == "removed"} == {(code,) for code in CODES.values()}
    assert len({plan.options["machine_seed"] for plan in plans if plan.part == "limit"}) == 1
    drawn = [plan for plan in plans if plan.part == "mixed"]
    assert {len(plan.effects) for plan in drawn} == {1, 2} and len(drawn) == 2 * study_diagnose.MIXED
    for plan in drawn:
        assert len({CODES[code] for code in plan.effects}) == len(plan.effects)
        make_case(plan.effects, **{**plan.options, "duration": 2.0})
    assert study_diagnose.rounds_wanted("effect=3,none=42") == {"effect": 3, "none": 42}
    with pytest.raises(ValueError, match="not nulls"):
        study_diagnose.rounds_wanted("nulls=3")
    assert study_diagnose.upper_limit(0, 1000) == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    assert study_diagnose.upper_limit(10, 1000) == pytest.approx(0.01691, abs=2e-5)
