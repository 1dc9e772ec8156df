"""The command line at its boundary: words in, bytes, talk and exit code out."""

import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
import types
import warnings
from dataclasses import make_dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
import yaml

import drivetool
from drivetool.cli import command_line
from drivetool.cli.output import exit_codes
from drivetool.errors import NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, Parameter, PlotData
from tests.places import ROOT

HAND = "schema: drivetool/parameters/1\nparameters: {motor.inertia: 0.4, load.inertia: 5.6}\n"


def estimator(experiments, drive, options):
    """Stands in for every estimator; the seed selects the outcome."""
    if options.seed == 4:
        raise NotEnoughData("a gap that opens", "none", "Reverse the torque.")
    if options.seed == 5:
        raise ValueError("two\nlines")
    if options.seed == 6:
        raise KeyboardInterrupt
    if options.seed == 7:
        warnings.warn("overflow in something", RuntimeWarning, stacklevel=1)
        logging.getLogger("some.library").warning("no glyph for something")
    severity = {2: "warning", 3: "failure"}.get(options.seed, "note")
    drive = drive.with_values({"motor.inertia": 2 * (drive.value("motor.inertia") or 0.5)})
    exhibits = tuple(PlotData("record", "Fit", "time [s]", "motor speed [rad/s]", {
        "measured": (e.time, e.signals["motor_speed"])}) for e in experiments)
    return Estimate(
        "greybox", drive,
        (Parameter(name="motor.inertia", value=drive.values["motor.inertia"], unit="kg m^2", start=0.5, std=0.01),),
        "converged", {"simulation_fit_percent": 90.0, "n": 500},
        findings=(Finding(severity, "no-fit", "Stub."),), exhibits=exhibits,
        data=tuple((e.name, e.sha256) for e in experiments))


@pytest.fixture(autouse=True)
def stub(monkeypatch):
    """A stand-in for the estimators, in this process."""
    for step in ("steady", "blackbox", "greybox", "backlash"):
        module = types.SimpleNamespace(**{step: estimator})
        monkeypatch.setitem(sys.modules, f"drivetool.identify.{step}", module)


@pytest.fixture
def folder(here):
    """A working folder with a recording and a parameter file."""
    t = np.arange(500) * 1e-3
    names = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
    columns = [t, np.sign(np.sin(20 * t)), np.cos(20 * t)]
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in names.items()]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), "steps.parquet")
    (here / "hand.yaml").write_text(HAND)
    return here


def process(*words, stdin=None, module="drivetool.cli.main"):
    """Run a command in a process of its own."""
    return subprocess.run([sys.executable, "-m", module, *map(str, words)], input=stdin,
                          capture_output=True, text=True, timeout=120)


def test_help_lists_the_commands_and_version_is_printed():
    done = process("--help")
    assert done.returncode == 0 and not done.stderr
    for command in command_line.COMMANDS:
        assert f"\n  {command} " in done.stdout
    assert process("--version").stdout == f"drivetool {drivetool.__version__}\n"


def test_help_imports_nothing_heavy():
    code = "import sys, drivetool.cli.main; print(*sorted(m for m in sys.modules if '.' not in m))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.split()
    assert not {"numpy", "scipy", "pyarrow", "matplotlib", "numba", "yaml", "msgspec", "mcap"} & set(loaded)


# Slow to load, or what loads the kernel.
HEAVY = {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.ndimage", "scipy.sparse",
         "control", "matplotlib", "jinja2", "llvmlite", "numba", "pyarrow"}
# What a command may load of these, with the exit code of its words.
LOADS = {
    "--version": (0, set()),
    "findings not-identifiable": (0, set()),
    "effects": (0, set()),
    "show hand.yaml": (0, set()),
    "inspect steps.parquet": (0, {"pyarrow"}),
    "convert steps.parquet --out other.parquet": (0, {"pyarrow"}),
    "trend site.parquet": (0, {"pyarrow", "scipy.optimize", "scipy.sparse"}),
    "greybox missing.parquet --params hand.yaml": (1, {"pyarrow"}),
    "greybox steps.parquet --params missing.yaml": (1, set()),
    "greybox steps.parquet --params hand.yaml --set motor.wrong=1": (2, {"pyarrow"}),
}


@pytest.mark.parametrize("words", LOADS)
def test_a_command_loads_only_what_it_needs(folder, words):
    """Those that fit nothing neither compile nor load what fits: it takes longer than they do."""
    shutil.copy(ROOT / "fixtures" / "site" / "summary.parquet", folder / "site.parquet")
    code, allowed = LOADS[words]
    script = ("import atexit, sys; atexit.register(lambda: print('loaded', *sys.modules, file=sys.stderr)); "
              f"sys.argv = ['drivetool', *{words.split()!r}]; from drivetool.cli.main import run; run()")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=folder)
    loaded = set(done.stderr.rpartition("loaded ")[2].split()) & set(HEAVY)
    assert (done.returncode, loaded - allowed) == (code, set()), done.stderr[:500]


@pytest.mark.parametrize("command", command_line.COMMANDS)
def test_every_command_has_an_example_that_parses(call, command):
    example = command_line.COMMANDS[command].EXAMPLE
    name, step, *words = shlex.split(example)
    assert (name, step) == ("drivetool", command) and words
    app = typer.main.get_command(command_line.app)
    parsed = app.commands[command].make_context(step, words)  # parses, runs nothing
    assert not parsed.args and parsed.params
    assert call(command, "--help")[1].endswith(f"\n    {example}\n") and len(example) <= 76


@pytest.mark.parametrize("words, wanted", [
    ("drivetool gre", ["greybox"]), ("drivetool greybox --criterion f", ["frequency"]), ("drivetool xyz", [])])
def test_a_shell_completes_words(words, wanted):
    env = {**os.environ, "_DRIVETOOL_COMPLETE": "complete_bash", "COMP_WORDS": words,
           "COMP_CWORD": str(words.count(" "))}
    done = subprocess.run([sys.executable, "-m", "drivetool.cli.main"], capture_output=True, text=True, env=env)
    assert done.stdout.split() == wanted and done.stderr == ""


@pytest.mark.parametrize("command", command_line.COMMANDS)
def test_every_command_has_help(call, command):
    code, out, err = call(command, "--help")
    assert code == 0 and not err and out.startswith(f"Usage: drivetool {command}")


def test_result_on_a_pipe_is_the_file_alone(folder, call):
    words = "greybox", "steps.parquet", "--params", "hand.yaml", "--set", "load.inertia=6e4 g m^2"
    code, out, err = call(*words)
    assert code == 0
    content = yaml.safe_load(out)
    assert content["parameters"]["motor.inertia"]["value"] == 0.8
    assert content["parameters"]["load.inertia"]["value"] == 60.0
    assert content["options"]["set"] == ["load.inertia=6e4 g m^2"]
    assert content["options"]["criterion"] == "auto"
    assert [entry["file"] for entry in content["inputs"]] == ["hand.yaml"]
    assert [entry["file"] for entry in content["data"]] == ["steps.parquet"]
    assert "note no-fit: Stub." in err and "drivetool greybox: converged" in err
    assert str(folder) not in out
    assert call(*words)[1] == out


def test_out_and_json_and_pictures(folder, call):
    code, out, err = call("greybox", "steps.parquet", "--out", "g.yaml", "--plot", "pictures/all")
    assert (code, out) == (0, "") and "wrote g.yaml" in err
    assert os.listdir("pictures/all") == ["greybox-steps-record.png"]
    assert call("greybox", "steps.parquet", "--out", "new/one/g.yaml")[0] == 0
    assert (folder / "new" / "one" / "g.yaml").read_bytes() == (folder / "g.yaml").read_bytes()
    code, out, err = call("greybox", "steps.parquet", "--json", "--quiet")
    assert (code, err) == (0, "")
    assert json.loads(out) == yaml.safe_load((folder / "g.yaml").read_text())
    assert call("greybox", "steps.parquet", "-o", "-", "-q")[1] == (folder / "g.yaml").read_text()


def test_table_on_a_terminal(folder, call):
    code, out, _ = call("greybox", "steps.parquet", "--out", "g.yaml", terminal=True)
    assert code == 0 and "motor.inertia" in out and "schema:" not in out
    written = call("greybox", "steps.parquet", "--out", "-", terminal=True)[1]
    assert yaml.safe_load(written)["step"] == "greybox"


def test_two_recordings_and_two_files_merge(folder, call):
    pq.write_table(pq.read_table(folder / "steps.parquet").slice(1), folder / "b.parquet", compression="gzip")
    (folder / "late.yaml").write_text("schema: drivetool/parameters/1\nparameters: {motor.inertia: 3}")
    _, out, _ = call("greybox", "steps.parquet", "b.parquet", "-p", "hand.yaml", "-p", "late.yaml")
    content = yaml.safe_load(out)
    assert content["parameters"]["motor.inertia"]["value"] == 6.0 and len(content["data"]) == 2


def test_drive_by_name_and_by_file(folder, call):
    def bodies(*words):
        return yaml.safe_load(call("greybox", "steps.parquet", *words)[1])["drive"]["bodies"]

    assert bodies() == ["motor", "load"]
    assert bodies("--drive", "one-body") == ["motor"]
    (folder / "rig.yaml").write_text("schema: drivetool/parameters/1\ndrive: {bodies: [motor, gear, load]}\n")
    assert bodies("--params", "rig.yaml") == ["motor", "gear", "load"]
    assert bodies("--drive", "rig.yaml", "--params", "hand.yaml") == ["motor", "gear", "load"]
    assert bodies("--drive", "two-mass", "--params", "rig.yaml") == ["motor", "load"]


@pytest.mark.filterwarnings("default:overflow in something")
@pytest.mark.parametrize("seed, flags, code, words", [
    (1, [], 0, "converged"), (2, [], 0, "warning no-fit"), (2, ["--strict"], 3, "warning no-fit"),
    (3, [], 3, "failure no-fit"), (4, [], 1, "greybox: error: wanted a gap that opens; found none. Reverse"),
    (5, [], 1, "unexpected ValueError: two lines (run again with --debug"), (6, [], 130, "interrupted"),
    (7, [], 0, "converged"),
])
def test_exit_codes(folder, call, seed, flags, code, words):
    found, _, err = call("greybox", "steps.parquet", "--seed", seed, "--out", "g.yaml", "--plot", "p", *flags)
    assert found == code and words in err and "Traceback" not in err
    assert (folder / "g.yaml").exists() == (code in (0, 3))
    if seed == 4:
        assert os.listdir("p") == ["greybox-steps-recording.png"]
    assert not list(folder.glob(".*.tmp"))


def test_traceback_only_with_debug(folder, call):
    code, _, err = call("greybox", "steps.parquet", "--seed", 5, "--debug")
    assert code == 1 and "Traceback" in err


# words, exit code, words of the message
WRONG = {
    "no command": ([], 2, "Usage"),
    "unknown command": (["greybok"], 2, "greybok"),
    "unknown option": (["greybox", "steps.parquet", "--fast"], 2, "--fast"),
    "no log": (["greybox"], 2, "LOG"),
    "not a number": (["greybox", "steps.parquet", "--seed", "x"], 2, "--seed"),
    "criterion": (["greybox", "steps.parquet", "--criterion", "best"], 2, "best"),
    "no model": (["validate", "steps.parquet"], 2, "--params"),
    "missing log": (["greybox", "none.parquet"], 1, "no file none.parquet"),
    "missing folder": (["inspect", "nosuchdir"], 1, "found no file nosuchdir. Check the path."),
    "suffix": (["greybox", "hand.yaml"], 1, "known suffix"),
    "missing file": (["greybox", "steps.parquet", "-p", "none.yaml"], 1, "No such file"),
    "typo": (["greybox", "steps.parquet", "-p", "typo.yaml"], 1, "Did you mean 'motor.inertia'?"),
    "map": (["greybox", "steps.parquet", "-m", "none.yaml"], 1, "No such file"),
    "drive": (["greybox", "steps.parquet", "--drive", "tow-mass"], 2, "Did you mean 'two-mass'?"),
    "drive file": (["greybox", "steps.parquet", "--drive", "hand.yaml"], 2, "drive section"),
    "hold": (["greybox", "steps.parquet", "--hold", "motor.inertai"], 2, "Did you mean 'motor.inertia'?"),
    "set": (["greybox", "steps.parquet", "--set", "motor.inertia"], 2, "NAME=VALUE"),
    "set nothing": (["greybox", "steps.parquet", "--set", "motor.inertia="], 2, "NAME=VALUE"),
    "set text": (["greybox", "steps.parquet", "--set", "motor.inertia=x"], 2, "(in kg m^2)"),
    "set nan": (["greybox", "steps.parquet", "--set", "motor.inertia=nan"], 2,
                "wanted a finite number for motor.inertia after --set; found 'nan'."),
    "set bounds": (["greybox", "steps.parquet", "--set", "motor.inertia=-1"], 2, "between"),
    "folder": (["greybox", "steps.parquet", "--out", "hand.yaml/g.yaml"], 2, "hand.yaml, which is no folder"),
    "out is folder": (["greybox", "steps.parquet", "--out", "."], 2, "found the folder '.'. Add a file name."),
    "plot": (["greybox", "steps.parquet", "--plot", "hand.yaml"], 2, "hand.yaml, which is no folder"),
    "folder of a failure": (["greybox", "none.parquet", "--out", "new/g.yaml"], 1, "no file none.parquet"),
    "out is log": (["greybox", "steps.parquet", "--out", "./steps.parquet"], 2, "inputs are never changed"),
    "out is params": (["greybox", "steps.parquet", "-p", "hand.yaml", "-o", "hand.yaml"], 2, "never changed"),
    "show": (["show", "none.yaml"], 1, "show: error: wanted to read none.yaml"),
    "show log": (["show", "steps.parquet"], 1, "show: error:"),
}


@pytest.mark.parametrize("words, code, message", WRONG.values(), ids=WRONG)
def test_wrong_words_give_one_clear_sentence(folder, call, words, code, message):
    (folder / "typo.yaml").write_text("schema: drivetool/parameters/1\nparameters: {motor.inertai: 1}")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    found, out, err = call(*words)
    assert found == code and message in out + err and "Traceback" not in err
    if "error: wanted" in err:
        assert out == "" and err.count("\n") == 1 and err.startswith(f"drivetool {words[0]}: error: ")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_validate_checks_each_file_as_a_model(folder, call, monkeypatch):
    from drivetool.check.validation import CheckSection, result as validation

    seen = {}

    def validate(experiments, models, options):
        seen["models"], seen["options"] = models, options
        passed = options.min_fit is None
        checks = tuple(CheckSection(
            name, e.name, "motor_speed", "rad/s", 93.0, 99.0, 0.1, 0.01, 0.99, 500, 0.1, 0.05, 3.0, 0.4, 0.2,
            passed)
            for name, _, _ in models for e in experiments)
        return validation.Validation(checks, "met" if passed else "missed")

    if not hasattr(validation, "ValidateOptions"):
        fields = ["min_fit", "max_correlation", "seed"]
        monkeypatch.setattr(validation, "ValidateOptions", make_dataclass("O", fields), raising=False)
    monkeypatch.setattr("drivetool.check.validation.validate", validate)
    (folder / "b.yaml").write_text(HAND + "noise: {torque_std: 1.5}\n")
    words = ["validate", "steps.parquet", "-p", "hand.yaml", "-p", "b.yaml", "-o", "v.yaml"]
    assert call(*words)[0] == 0
    assert [(name, dict(noise)) for name, _, noise in seen["models"]] == [
        ("hand.yaml", {}), ("b.yaml", {"torque_std": 1.5})]
    assert seen["models"][0][1].values == {"motor.inertia": 0.4, "load.inertia": 5.6}
    assert seen["options"].max_correlation == 0.15
    code, _, err = call(*words, "--min-fit", 95)
    assert code == 3 and "validate: missed" in err
    assert yaml.safe_load((folder / "v.yaml").read_text())["passed"] is False
    code, out, _ = call("show", "v.yaml")
    assert code == 0 and "missed" in out and "93" in out
    code, out, err = call("show", "hand.yaml", "v.yaml")
    assert (code, out) == (2, "") and "found drivetool/validation/1 in v.yaml" in err
    code, out, err = call("show", "hand.yaml", "b.yaml")
    assert (code, err) == (0, "") and {"hand", "b"} <= set(out.split())
    assert [line.split() for line in out.splitlines()][2:] == [
        [f"{name}.inertia", value, "-", value, "-", "kg", "m^2", "-"] for name, value in (
            ("motor", "0.4"), ("load", "5.6"))]


STUBBED = """
import sys, types
sys.path.insert(0, {root!r})
from drivetool.cli.main import run
from tests.cli import test_boundary
from tests.places import ROOT
for step in ("steady", "blackbox", "greybox", "backlash"):
    sys.modules["drivetool.identify." + step] = types.SimpleNamespace(**{{step: test_boundary.estimator}})
run()
"""


def test_steps_chain_through_a_pipe(folder):
    code = STUBBED.format(root=str(ROOT))
    first = [sys.executable, "-c", code, "blackbox", "steps.parquet", "--params", "hand.yaml"]
    second = [sys.executable, "-c", code, "greybox", "steps.parquet", "--params", "-", "--quiet"]
    one = subprocess.run(first, capture_output=True, check=True)
    two = subprocess.run(second, input=one.stdout, capture_output=True, check=True)
    assert yaml.safe_load(two.stdout)["parameters"]["motor.inertia"]["value"] == pytest.approx(1.6)
    assert two.stderr == b""
    last = subprocess.run([sys.executable, "-m", "drivetool.cli.main", "show", "-"], input=two.stdout,
                          capture_output=True, check=True)
    assert b"motor.inertia" in last.stdout and b"\x1b" not in last.stdout


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", *(
    pytest.param(encoding, marks=pytest.mark.long) for encoding in ("latin-1", "utf-8"))])
def test_names_are_written_as_they_are_whatever_the_encoding_of_standard_output(folder, encoding):
    name = "Größe 試験.parquet"
    (folder / "steps.parquet").rename(folder / name)
    code, env = STUBBED.format(root=str(ROOT)), {**os.environ, "PYTHONIOENCODING": encoding}

    def run(*words, stdin=b""):
        return subprocess.run([sys.executable, "-c", code, *words], input=stdin, capture_output=True, env=env)

    piped, made = run("greybox", name, "--quiet"), run("greybox", name, "--out", "größe.yaml")
    assert piped.returncode == made.returncode == 0 and piped.stdout.decode("utf-8").count(name) == 1
    assert piped.stdout == (folder / "größe.yaml").read_bytes()
    assert "größe.yaml".encode(encoding, "backslashreplace") in made.stderr
    assert json.loads(run("greybox", name, "--json", "--quiet").stdout) == yaml.safe_load(piped.stdout)
    summary = run("show", "-", stdin=piped.stdout)
    assert summary.returncode == 0 and b"motor.inertia" in summary.stdout and summary.stderr == b""


def test_warnings_of_libraries_are_printed_with_debug_alone(folder):
    code = [sys.executable, "-W", "always", "-c", STUBBED.format(root=str(ROOT))]
    words = [*code, "greybox", "steps.parquet", "--seed", "7", "--out", "g.yaml"]
    plain, debug = (subprocess.run([*words, *more], capture_output=True, text=True) for more in ([], ["--debug"]))
    assert plain.returncode == debug.returncode == 0
    assert plain.stderr == "note no-fit: Stub.\ndrivetool greybox: converged\ndrivetool greybox: wrote g.yaml\n"
    assert "RuntimeWarning: overflow in something" in debug.stderr and "no glyph for something" in debug.stderr


def test_process_boundary(folder):
    failed = process("greybox", "none.parquet")
    assert failed.returncode == 1 and failed.stdout == "" and failed.stderr.count("\n") == 1
    assert process("greybox").returncode == 2
    assert process(stdin="", module="drivetool.cli.demo").returncode == 2


@pytest.mark.parametrize("severities, passed, strict, code", [
    ([], True, False, 0), (["note", "warning"], True, False, 0), (["warning"], True, True, 3),
    (["failure"], True, False, 3), ([], False, False, 3), (["note"], True, True, 0),
])
def test_exit_codes_are_decided_in_one_place(severities, passed, strict, code):
    assert exit_codes.exit_code(severities, passed, strict) == code


KEPT_ELSEWHERE = """
import contextlib, typer
from drivetool.cli.output.exit_codes import guarded
from drivetool.drive.compile.code_folder import folder

with contextlib.suppress(typer.Exit):
    guarded("greybox", lambda: len({folder(), folder()}) - 1)
"""


def test_where_no_cache_can_be_written_one_line_says_where_the_kernel_is_kept(tmp_path):
    taken, temporary = tmp_path / "taken", tmp_path / "temporary"
    taken.write_text("a file where a folder is wanted")
    temporary.mkdir(0o700)
    done = subprocess.run([sys.executable, "-c", KEPT_ELSEWHERE], capture_output=True, text=True, env={
        **os.environ, "NUMBA_CACHE_DIR": str(taken), "XDG_CACHE_HOME": str(taken), "TMPDIR": str(temporary)})
    line, = done.stderr.splitlines()
    assert line.startswith("drivetool greybox: warning: the compiled kernel is kept in ")
    assert f" {temporary.resolve()}/drivetool-" in line and "Set NUMBA_CACHE_DIR or XDG_CACHE_HOME" in line
    assert done.returncode == 0 and not done.stdout
