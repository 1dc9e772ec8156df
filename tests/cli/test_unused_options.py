"""An option that an estimator does not use is refused by its name, and so is a parameter that it cannot free."""

import importlib
import inspect
import pkgutil

import pytest
import yaml

from drivetool.cli import commands
from drivetool.errors import BadOption
from drivetool.identify.frequency import SpectraOptions
from drivetool.identify.setup import KnownStart, Options, refuse_unused
from drivetool.identify.setup.options import USED_OPTIONS
from tests.places import FIXTURES, RIG

STEPS = sorted({way.split()[0] for way in USED_OPTIONS})
OTHER = {"criterion": "simulation", "starts": 2, "segment": 0.5, "seed": 7, "structure": "oe", "order": 3,
         "noise_order": 1, "weighting": "coherence", "band": (1.0, 20.0), "method": "coast-down", "flux_decay": 0.1,
         "stages": ((2.0, 1.0), (1.0, 0.5)), "start": KnownStart(True)}
# A value that selects another fit of the step is no unused option.
WAYS = [(way, name) for way, used in USED_OPTIONS.items() for name, value in OTHER.items()
        if name not in used and f"{way} --{name} {value}" not in USED_OPTIONS]
USED = [(way, name) for way, used in USED_OPTIONS.items() for name in used]
NOT_FREE = {
    "steady": [("", "shaft.stiffness"), ("", "motor.inertia"), ("--method acceleration", "motor.drag"),
               ("--method coast-down", "motor.drag")],
    "blackbox": [("", "load.inertia"), ("--structure oe", "motor.viscous")],
    "greybox": [("", "motor.clamped"), ("--criterion frequency", "motor.coulomb"),
                ("--criterion inverse", "total.viscous")],
    "backlash": [("", "motor.torque_constant"), ("", "motor.clamped"), ("--criterion inverse", "total.viscous")],
}


def options_of(way, **more):
    selected = dict([way.split()[1:]]) if " " in way else {}
    return Options(**{name.removeprefix("--"): value for name, value in selected.items()} | more)


def test_every_estimator_command_states_the_options_that_it_uses():
    found = [m.name for m in pkgutil.iter_modules(commands.__path__) if "estimator_command(" in inspect.getsource(
        importlib.import_module(f"drivetool.cli.commands.{m.name}"))]
    assert sorted(found) == STEPS == sorted(NOT_FREE)


@pytest.mark.parametrize(("way", "name"), WAYS)
def test_an_option_that_is_not_used_is_refused_by_name(way, name):
    with pytest.raises(BadOption, match="uses") as caught:
        refuse_unused(way.split()[0], options_of(way, **{name: OTHER[name]}))
    # Two options that exclude each other: either may be named.
    assert f"--{name.replace('_', '-')}" in f"{caught.value.wanted} {caught.value.found}"


@pytest.mark.parametrize(("way", "name"), USED)
def test_an_option_that_is_used_is_not_refused(way, name):
    step = way.split()[0]
    refuse_unused(step, options_of(way))
    if name not in ("criterion", "structure", "method"):
        refuse_unused(step, options_of(way, **{name: OTHER[name]}))


@pytest.mark.parametrize("step", STEPS)
def test_the_command_line_refuses_it_before_it_reads(call, step, tmp_path):
    shown = inspect.signature(importlib.import_module(f"drivetool.cli.commands.{step}").command).parameters
    for name in ("criterion", "starts", "segment", "seed", "order", "noise_order", "weighting"):
        if name in shown and name not in USED_OPTIONS[step]:
            word = f"--{name.replace('_', '-')}"
            code, out, err = call(step, tmp_path, word, OTHER[name])
            assert (code, out) == (2, "") and word in err and "wanted options that" in err, (name, err)


@pytest.mark.parametrize(("step", "words", "name"), [(s, *case) for s, cases in NOT_FREE.items() for case in cases])
def test_a_parameter_that_cannot_be_free_is_refused_by_name(call, tmp_path, step, words, name):
    log = RIG / ({"steady": "steady", "backlash": "gap"}.get(step, "steps") + ".parquet")
    log = FIXTURES / "bus" / "acceleration.parquet" if "acceleration" in words else log
    truth = yaml.safe_load((RIG / "truth.yaml").read_text())["parameters"]
    (tmp_path / "start.yaml").write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "parameters": {
        n: v["value"] for n, v in truth.items()}}))
    code, out, err = call(step, log, "-p", tmp_path / "start.yaml", *words.split(), "--free", name)
    assert (code, out) == (2, "") and name in err and "error: wanted" in err.replace("\n", " "), err


def test_a_parameter_is_held_or_free_in_every_step(call):
    for step in STEPS:
        code, _, err = call(step, RIG / "steps.parquet", "--hold", "motor.viscous", "--free", "motor.viscous")
        assert code == 2 and "motor.viscous as both" in err


@pytest.mark.parametrize(("method", "words"), [
    ("periodic", {"length": 1.0}), ("periodic", {"estimator": "h2"}), ("periodic", {"window": "boxcar"}),
    ("periodic", {"overlap": 0.25}), ("welch", {"period": 1.0}), ("welch", {"skip": 2})])
def test_an_option_of_another_method_of_spectra_is_refused_by_name(method, words):
    with pytest.raises(BadOption, match=f"--{next(iter(words))}"):
        SpectraOptions(method, **words)
    SpectraOptions("auto", **words)


def test_one_option_says_where_it_belongs(call):
    code, _, err = call("blackbox", FIXTURES / "rig" / "steps.parquet", "--order", 3)
    assert code == 2 and "take blackbox --criterion frequency" in " ".join(err.split())
