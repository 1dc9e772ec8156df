"""The robot axis and the bus of the literature, from their fixture records: cross-tables, means, findings."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml

from drivetool.check.validation import ValidateOptions, validate
from drivetool.drive import two_mass
from drivetool.errors import BadOption, NotEnoughData
from drivetool.files.yaml import load_parameters
from drivetool.identify.frequency.estimator import SpectraOptions, spectra
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.several.comparison import CompareOptions, FittedStructure, compare, scatter_over_records
from drivetool.logs import Experiment
from drivetool.logs.door import open_experiment
from tests.places import FIXTURES

BUS = ("prbs1", "prbs2", "chirp1", "chirp2", "sines1", "sines2")


@cache
def record(room, name):
    return open_experiment(FIXTURES / room / f"{name}.parquet")


def drive(room):
    return load_parameters([FIXTURES / room / "drive.yaml"]).stated().start


def truth(room):
    content = yaml.safe_load((FIXTURES / room / "truth.yaml").read_text())
    return {name: float(entry["value"]) for name, entry in content["parameters"].items()}


@cache
def robot(kind, *structures):
    records = [record("robot", f"{name}_{kind}") for name in ("chirp", "low", "high")]
    return compare(records, drive("robot"), CompareOptions(structures))


def table(found, structure, names):
    return np.array([[found.cross[structure, a, b] for b in names] for a in names])


def figure(found, structure, name):
    return next(s for s in found.spread if (s.structure, s.name) == (structure, name))


def anti_resonance_differs(found):
    return any(f.code == "parameters-differ" and "the first anti-resonance" in f.text for f in found.findings)


@pytest.mark.slow
def test_on_the_linear_axis_all_structures_agree_with_each_other_and_the_truth():
    """OE and BJ, and the physical model with K = 0 and K != 0."""
    found = robot("linear", "oe", "bj", "physical", "physical-innovations")
    true = truth("robot")
    for name in ("motor.inertia", "gear.inertia", "arm.inertia", "shaft.stiffness", "shaft2.stiffness"):
        for structure in ("oe", "bj", "physical-innovations"):
            s = figure(found, structure, name)
            for value, std in zip(s.values, s.stds, strict=True):
                assert abs(value - true[name]) < 4.0 * std < 0.02 * true[name], (structure, name)
        # The simulation criterion states too small intervals under torque noise; the others' serve for it.
        for a, b in zip(figure(found, "physical", name).values, figure(found, "oe", name).values, strict=True):
            assert abs(a - b) < 0.01 * true[name]
    anti_resonances = np.array([figure(found, s, "notch 1").values for s in ("oe", "bj", "physical",
        "physical-innovations")])
    assert np.ptp(anti_resonances) < 0.1 and not anti_resonance_differs(found)
    names = [m.record for m in found.models[:3]]
    assert all(np.all(table(found, s, names) > 98.0) for s in ("oe", "bj", "physical", "physical-innovations"))
    assert {m.structure: m.noise_parameters for m in found.models} == {
        "oe": 0, "bj": 4, "physical": 0, "physical-innovations": 1}


@pytest.mark.slow
def test_on_the_axis_with_gap_and_friction_it_is_as_published():
    """Output error simulates best, and the low amplitude has the lower anti-resonance and fits nothing else."""
    found = robot("gap", "oe", "innovations")
    names = [m.record for m in found.models[:3]]
    chirp, low, high = range(3)
    oe, innovations = table(found, "oe", names), table(found, "innovations", names)
    assert np.all(np.diag(oe) >= oe.max(axis=0) - 1.0)  # nobody beats the fit on the record itself
    assert np.all(np.diag(oe) > np.diag(innovations)) and oe[low, low] > innovations[low, low] + 3.0
    for same in ((chirp, high), (high, chirp)):
        assert oe[same] > 85.0
    for other in ((chirp, low), (low, chirp), (high, low), (low, high)):
        assert oe[other] < 80.0
    anti_resonance = figure(found, "oe", "notch 1").values
    assert anti_resonance[low] < min(anti_resonance[chirp], anti_resonance[high]) - 3.0
    assert anti_resonance_differs(found) and found.outcome.startswith("oe ")


def test_the_reference_makes_the_indirect_estimate_in_closed_loop():
    s = spectra([record("robot", "chirp_linear")], SpectraOptions(length=1.0))
    assert s.mean.method == "indirect" and s.feedback.significant
    anti_resonance = min((p for p in s.peaks if p.kind == "anti-resonance"), key=lambda p: p.hz)
    assert anti_resonance.hz == pytest.approx(93.1 / 2 / np.pi, abs=1.0)
    alone = record("robot", "chirp_linear")
    alone = replace(alone, signals={k: v for k, v in alone.signals.items() if k != "reference_speed"})
    codes = {f.code for f in spectra([alone], SpectraOptions(length=1.0, method="welch")).findings}
    assert "torque-in-feedback" in codes


@pytest.mark.slow
def test_bus_means_over_six_experiments():
    """Means within two standard errors of the truth; the spread is what the fits state."""
    found = compare([record("bus", n) for n in BUS], drive("bus"), CompareOptions(("oe", "innovations")))
    true = truth("bus")
    for name in ("motor.inertia", "wheels.carried_mass", "shaft.stiffness"):
        s = figure(found, "innovations", name)
        stated = np.sqrt(np.sum(np.square(s.stds))) / len(s.stds)
        assert abs(s.mean - true[name]) < 2.0 * max(s.standard_error, stated), name
        assert 0.3 < s.std / np.sqrt(np.mean(np.square(s.stds))) < 2.5
        assert s.standard_error == pytest.approx(s.std / np.sqrt(6.0))
    for structure in ("oe", "innovations"):
        assert figure(found, structure, "resonance 1").mean / 2 / np.pi == pytest.approx(11.22, abs=0.05)
        assert figure(found, structure, "notch 1").mean / 2 / np.pi == pytest.approx(3.92, abs=0.05)
        assert np.all(table(found, structure, [m.record for m in found.models[:6]]) > 98.5)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["frequency", "innovations"])
def test_bus_fits_pass_the_residual_test_on_another_record(criterion):
    start = drive("bus").with_values({"motor.inertia": 4.0, "shaft.stiffness": 1.3e6, "shaft.damping": 3000.0,
                                      "wheels.carried_mass": 11000.0})
    fitted = [record("bus", "chirp1")]
    estimate = greybox(fitted, start, Options(criterion=criterion))
    known = estimate.drive
    if criterion == "frequency":  # a response says nothing about a constant torque, and little about friction
        known = greybox(fitted, known, Options(hold=(
            "motor.inertia", "wheels.carried_mass", "shaft.stiffness", "shaft.damping"))).drive
    assert known.values["wheels.carried_mass"] == pytest.approx(12350.0, rel=0.02)
    check = validate([record("bus", "prbs1")], [(criterion, known, {})], ValidateOptions()).checks[0]
    assert check.simulation_fit_percent > 98.0
    assert check.max_correlation < 0.15 and check.correlation_p > 1e-3 and check.passed


@pytest.mark.slow
def test_standstill_with_held_wheels_and_an_acceleration_test():
    """Shaft and motor from standstill, then mass and rolling resistance from constant torque."""
    still = drive("bus").with_values({
        "motor.inertia": 4.0, "shaft.stiffness": 1.3e6, "shaft.damping": 3000.0, "wheels.inertia": 1e12,
        "wheels.carried_mass": 0.0})
    shaft = greybox([record("bus", "held")], still, Options(hold=("wheels.inertia", "total.viscous",
        "total.idle_torque"),
                                                            )).drive
    for name in ("motor.inertia", "shaft.stiffness"):
        assert shaft.values[name] == pytest.approx(truth("bus")[name], rel=0.02)
    moving = shaft.with_values({"wheels.inertia": 22.1, "wheels.carried_mass": 9000.0})
    held = ("motor.inertia", "shaft.stiffness", "shaft.damping")
    estimate = greybox([record("bus", "acceleration")], moving, Options(hold=held))
    lines = {p.name: p for p in estimate.parameters}
    assert lines["wheels.carried_mass"].value == pytest.approx(12350.0, rel=0.02)
    assert lines["total.idle_torque"].value == pytest.approx(1089.0 / 8.79, rel=0.02)  # referred to the motor


def test_what_is_missing_from_a_record_leaves_the_mean_out():
    models = [FittedStructure("oe", "a", figures={"notch 1": (1.0, 0.1, "rad/s")}), FittedStructure("oe", "b"),
              FittedStructure("bj", "a", figures={"notch 1": (1.0, 0.1, "rad/s")}),
              FittedStructure("bj", "b", figures={"notch 1": (3.0, None, "rad/s")})]
    (only,) = scatter_over_records(models, ["a", "b"])
    assert (only.structure, only.mean, only.std, only.standard_error) == ("bj", 2.0, np.sqrt(2.0), 1.0)


def test_a_record_that_a_structure_cannot_be_fitted_to_is_named():
    """Ninety samples are too few for order 40, and the tables go on without it."""
    short = [replace(record("bus", n).between(0.0, 0.3), name=n) for n in ("prbs1", "chirp1")]
    found = compare(short, drive("bus"), CompareOptions(("oe",), order=40))
    assert [f.code for f in found.findings] == ["no-fit", "no-fit"]
    assert "oe on prbs1" in found.findings[0].text


def test_a_sensor_at_rest_in_one_record_is_compared_without_a_division_by_zero():
    """Its model never answers; warnings are errors here."""
    n = 600
    torque = np.sin(20.0 * np.arange(n) * 1e-3)
    records = [Experiment(name, name, 1e-3, 0.0, {"motor_torque": torque, "motor_speed": speed}, ((0, n),))
               for name, speed in (("still", np.full(n, 5.0)), ("moves", np.cumsum(torque) * 1.7e-4))]
    found = compare(records, two_mass(), CompareOptions(("oe",)))
    assert [(m.record, m.unstable) for m in found.models] == [("still", False), ("moves", True)]
    assert np.isnan(found.cross["oe", "still", "still"]) and found.cross["oe", "still", "moves"] < 50.0


def test_what_cannot_be_is_said():
    with pytest.raises(NotEnoughData, match="two recordings"):
        compare([record("bus", "prbs1")], drive("bus"), CompareOptions())
    with pytest.raises(BadOption, match="structure"):
        CompareOptions(("oe", "magic"))
