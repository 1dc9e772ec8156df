"""Marks of a parameter file: what no recording identifies is used as known by no command without a word."""

import inspect
from pathlib import Path

import numpy as np
import pytest
import yaml

from drivetool.cli import command_line
from drivetool.files.shapes import BarSection, MeasureSection
from drivetool.files.yaml import load_parameters
from drivetool.site.results import Entry, step_result_of
from drivetool.site.verdicts import evaluate_bars
from tests.places import RIG
from tests.simulator.records import write_parquet

STEP, N = 2e-3, 3000
READERS = [name for name, module in command_line.COMMANDS.items()
           if "params" in inspect.signature(module.command).parameters]
VALUES = {"motor.inertia": 0.02, "motor.viscous": 0.03, "motor.torque_constant": 2.0}
REASON = "it has no significant effect on the outputs"
NO_SET = ("validate", "diagnose")  # there a value is stated as known in the file alone
CODE = "unidentified-value"
# Command -> the value of the file that it holds, and its words; current.parquet is logged in A, coast.parquet is
# without torque.
HELD = {
    "steady": ("motor.inertia", "coast.parquet --method coast-down --hold motor.inertia"),
    "blackbox": ("motor.torque_constant", "current.parquet --drive one-body --structure oe"),
    "greybox": ("motor.inertia", "current.parquet --hold motor.inertia --criterion simulation"),
    "backlash": ("motor.inertia", f"{RIG}/gap.parquet -p two.yaml --hold motor.inertia --hold shaft.damping "
                                  "--criterion simulation"),
    "validate": ("motor.viscous", "current.parquet"),
    "compare": ("motor.torque_constant", "current.parquet again.parquet --drive one-body --structure oe"),
    "diagnose": ("motor.torque_constant", "current.parquet --candidates coulomb-motor"),
    "simulate": ("motor.viscous", "current.parquet"),
    "tune": ("motor.inertia", "--converter 300,0.7"),
}


def speed(torque, start=0.0):
    """(n,) of one body, exactly, with noise."""
    rate = VALUES["motor.viscous"] / VALUES["motor.inertia"]
    fall, found = np.exp(-rate * STEP), [start]
    for each in torque[:-1]:
        found.append(fall * found[-1] + (1.0 - fall) * each / VALUES["motor.viscous"])
    return np.array(found) + 1e-3 * np.random.default_rng(3).standard_normal(len(torque))


def parameters(path, unidentified=(), values=VALUES, drive="one-body", **sections):
    """A parameter file; some values have the mark."""
    entries = {n: {"value": v, "std": 1e-3 * v, "status": "fitted"} for n, v in values.items()}
    entries |= {n: {"value": values[n], "status": "not-identifiable", "reason": REASON} for n in unidentified}
    Path(path).write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": {"name": drive},
                                          "parameters": entries} | sections))


@pytest.fixture
def folder(here):
    for name, seed in (("current", 1), ("again", 2)):
        torque = np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, N // 50), 50)
        write_parquet(here / f"{name}.parquet", {
            "motor_torque": (torque / VALUES["motor.torque_constant"], "A"),
            "motor_speed": (speed(torque), "rad/s")}, STEP)
    truth = yaml.safe_load((RIG / "truth.yaml").read_text())["parameters"]
    parameters("two.yaml", values={n: entry["value"] for n, entry in truth.items()}, drive="two-mass")
    write_parquet(here / "coast.parquet", {"motor_speed": (speed(np.zeros(N), 60.0), "rad/s")}, STEP)
    return here


def run(call, command, *more):
    """(exit code, everything that it says) of a command of the set."""
    words = HELD[command][1]
    out = "sim.parquet" if command == "simulate" else "out.yaml"
    code, text, said = call(command, *words.split(), "-p", "file.yaml", "--out", out, *more)
    return code, text + said


def test_every_command_that_reads_parameters_is_here():
    assert sorted(HELD) == sorted(READERS)


def of_command(command):
    """(name of the value that it uses, arguments of `parameters`)."""
    name = HELD[command][0]
    return name, {"values": {name: 0.587}, "drive": "two-mass"} if command == "backlash" else {}


@pytest.mark.parametrize("command", READERS)
def test_a_value_that_no_recording_identifies_is_named_or_refused(folder, call, command):
    name, about = of_command(command)
    parameters("file.yaml", [name], **about)
    code, said = run(call, command)
    if command == "tune":
        assert code == 1 and "no recording identifies" in said and f"--set {name}=VALUE" in said
        assert REASON in said and "motor.viscous" in said  # why, and what is known
        return
    severity = "note" if command in ("compare", "diagnose") else "warning"  # which fit most values again
    assert code == 0 and said.count(CODE) == 1 and f"{severity} {CODE}: No recording identifies {name}:" in said


@pytest.mark.parametrize("command", READERS)
def test_a_value_that_is_stated_as_known_needs_no_word(folder, call, command):
    name, about = of_command(command)
    value = about.get("values", VALUES)[name]
    parameters("file.yaml", () if command in NO_SET else [name], **about)
    if command in NO_SET:  # as typed by hand
        content = yaml.safe_load(Path("file.yaml").read_text())
        content["parameters"][name] = value
        content["parameters"]["motor.inertia"] = {"value": VALUES["motor.inertia"], "status": "fitted"}
        Path("file.yaml").write_text(yaml.safe_dump(content))
    code, said = run(call, command, *([] if command in NO_SET else ["--set", f"{name}={value}"]))
    assert code == 0 and CODE not in said and "identifies" not in said


def test_a_value_that_is_fitted_again_is_a_start_and_needs_no_word(folder, call):
    parameters("file.yaml", ["motor.inertia"])
    code, _, said = call("greybox", "current.parquet", "-p", "file.yaml", "--out", "out.yaml")
    assert code == 0 and CODE not in said
    assert read("out.yaml")["motor.inertia"]["status"] == "fitted"


def read(path):
    return yaml.safe_load(Path(path).read_text())["parameters"]


@pytest.mark.parametrize("words, named", [
    ("greybox current.parquet --hold motor.inertia --criterion simulation", True),
    ("steady coast.parquet --method coast-down --set motor.viscous=0.03 --hold motor.viscous", False)])
def test_a_mark_outlives_the_steps_that_do_not_identify_it(folder, call, words, named):
    """Held or only copied, it is as unknown as before; the step that uses it says so."""
    name = "motor.inertia" if named else "converter.bandwidth"
    values = VALUES if named else {"motor.inertia": VALUES["motor.inertia"], name: 300.0}
    parameters("file.yaml", [name], values)
    code, _, said = call(*words.split(), "-p", "file.yaml", "--out", "next.yaml")
    assert code == 0 and (CODE in said) == named
    entry = read("next.yaml")[name]
    assert entry["status"] == "not-identifiable" and entry["reason"] == REASON
    assert entry["value"] == pytest.approx(values[name])


def test_a_later_file_decides(folder):
    parameters("one.yaml", ["motor.inertia", "motor.viscous"])
    parameters("later.yaml", values={"motor.inertia": 0.5})
    both = {"motor.inertia", "motor.viscous"}
    assert set(load_parameters(["one.yaml", "later.yaml"]).stated().unidentified) == {"motor.viscous"}
    assert set(load_parameters(["later.yaml", "one.yaml"]).stated().unidentified) == both
    parameters("sum.yaml", ["total.viscous"], {"total.viscous": 0.1}, "two-mass")
    parameters("parts.yaml", ["load.viscous"], {"motor.viscous": 0.1, "load.viscous": 0.2}, "two-mass")
    assert set(load_parameters(["sum.yaml", "parts.yaml"]).stated().unidentified) == {"load.viscous"}
    assert set(load_parameters(["parts.yaml", "sum.yaml"]).stated().unidentified) == {"total.viscous"}
    stated = load_parameters(["sum.yaml"]).stated()
    assert stated.with_values({"motor.viscous": 0.1}).unidentified == {}


LOOP = {"motor.inertia": 20.0, "load.inertia": 80.0, "shaft.stiffness": 224e3, "shaft.damping": 224.0,
        "motor.viscous": 6e-3, "load.viscous": 0.024, "converter.bandwidth": 433.0, "converter.dead_time": 2e-3}


@pytest.mark.parametrize("unidentified, stopped", [
    (["load.inertia"], True), (["shaft.stiffness"], True), (["shaft.damping"], True),
    (["converter.dead_time"], True), (["motor.inertia", "load.inertia"], True),
    (["load.viscous"], False), (["shaft.half_gap"], False)])
def test_tune_stops_where_the_design_depends_on_it(folder, call, unidentified, stopped):
    """A part is enough, also where the sum is known; what moves no margin is named alone."""
    parameters("file.yaml", unidentified, LOOP | {"shaft.half_gap": 5e-4} if "gap" in unidentified[0] else LOOP,
               "two-mass")
    code, _, said = call("tune", "-p", "file.yaml", "--out", "gains.yaml", "--draws", 20)
    assert code == int(stopped) and all(name in said for name in unidentified)
    if not stopped:
        severity = "warning" if "gap" in unidentified[0] else "note"  # its limit cycles are simulated
        assert f"{severity} {CODE}: No recording identifies {unidentified[0]}:" in said


def test_a_fit_that_explains_nothing_leaves_no_value_as_known(folder, call):
    noise = np.random.default_rng(5).standard_normal((2, N))
    write_parquet("noise.parquet", {"motor_torque": (noise[0], "Nm"),
                                    "motor_speed": (np.cumsum(noise[1]) * 0.05, "rad/s")}, STEP)
    code, _, said = call("greybox", "noise.parquet", "--drive", "one-body", "--set", "motor.inertia=0.02",
                         "--out", "fit.yaml")
    assert code == 3 and "explains-nothing" in said
    assert {entry["status"] for entry in read("fit.yaml").values()} <= {"held", "not-identifiable"}
    assert read("fit.yaml")["motor.inertia"]["status"] == "not-identifiable"
    code, _, said = call("tune", "-p", "fit.yaml", "--converter", "300,0.7", "--out", "gains.yaml")
    assert code == 1 and "known values of motor.inertia" in said


def test_show_hides_it_and_says_it_with_the_reason_on_request(folder, call):
    parameters("file.yaml", ["motor.inertia"])
    parameters("other.yaml")
    _, text, _ = call("show", "file.yaml")
    line, = (line for line in text.splitlines() if line.startswith("motor.inertia"))
    assert "0.02" not in line and "not identifiable" in line and f"motor.inertia: {REASON}" in text
    assert "show --all" in " ".join(text.split())
    _, text, _ = call("show", "--all", "file.yaml")
    line, = (line for line in text.splitlines() if line.startswith("motor.inertia"))
    assert "0.02" in line and f"motor.inertia: {REASON}" in text and "show --all" not in text
    for words, count in (((), 1), (("--all",), 2)):
        _, text, _ = call("show", "file.yaml", "other.yaml", *words)
        line, = (line for line in text.splitlines() if line.startswith("motor.inertia"))
        assert line.count("0.02") == count


def test_sides_are_compared_with_a_word(folder, call):
    values = {n: v for n, v in LOOP.items() if not n.startswith("converter")}
    parameters("a.yaml", ["shaft.stiffness"], values, "two-mass")
    parameters("b.yaml", (), values, "two-mass")
    code, text, said = call("compare", "--swap", "a.yaml", "b.yaml", "--out", "out.yaml")
    assert code == 0 and f"warning {CODE}: No recording identifies shaft.stiffness" in text + said


@pytest.mark.parametrize("coulomb, severity", [(0.0, "note"), (0.01, "warning")])
def test_an_effect_that_is_absent_is_worth_a_note_where_the_model_runs_alone(folder, call, coulomb, severity):
    """As after a recording in one direction, where the dry friction is part of the idle torque."""
    parameters("file.yaml", ["motor.coulomb"], VALUES | {"motor.coulomb": coulomb})
    code, _, said = call("simulate", "current.parquet", "-p", "file.yaml", "--out", "sim.parquet")
    assert code == 0 and f"{severity} {CODE}: No recording identifies motor.coulomb:" in said
    code, _, said = call("greybox", "current.parquet", "-p", "file.yaml", "--out", "out.yaml", "--criterion",
                         "simulation", "--hold", "motor.coulomb")
    assert code == 0 and (CODE in said) == bool(coulomb)


@pytest.mark.parametrize("status, missed", [("fitted", False), ("at-bound", False), ("not-identifiable", True)])
def test_a_bar_on_it_is_missed_and_so_is_one_on_a_figure_that_follows_from_it(status, missed):
    reason = "it depends on motor.inertia, shaft.stiffness, for which there is no interval"
    result = step_result_of(yaml.safe_dump({
        "parameters": {"shaft.stiffness": {"value": 1248.0, "unit": "Nm/rad", "status": status},
                       "load.viscous": {"value": 1.0, "unit": "Nm s/rad", "std": 0.1, "status": "fitted"}},
        "derived": {"resonance": {"value": 30.0, "unit": "Hz", "reason": reason},
                    "anti_resonance": {"value": 20.0, "unit": "Hz", "std": 0.1}}}))
    for figure, unit, depends in (("shaft.stiffness", "Nm/rad", True), ("derived.resonance", "Hz", True),
                                  ("derived.anti_resonance", "Hz", False), ("load.viscous", "Nm s/rad", False)):
        bar = BarSection(figure=figure, at_most=MeasureSection(2000.0, unit))
        case, = evaluate_bars([Entry("r", "m", "k", None, 1, "greybox", result)], [bar])[1:]
        assert case.passed != (missed and depends)
        assert ("no recording identifies it" in case.text) != case.passed
