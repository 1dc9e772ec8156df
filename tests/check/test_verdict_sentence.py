"""The verdict in words, and when a cause is suspect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.faults.record_faults import Fault
from drivetool.check.heldout.between_records import Change, records_differ_text
from drivetool.check.outcome.diagnosis import OUTSIDE_CATALOGUE, CandidateResult, Round, noise_hides_law
from drivetool.check.search.result import SelectedCauses
from drivetool.check.verdict.diagnosis_report import causes_in_base, correlated_errors_finding
from drivetool.check.verdict.sentence import experiment_of, sentence_of
from drivetool.check.verdict.size import sizes_of
from drivetool.drive.simulation import Trace
from drivetool.identify.estimate import Covariance, Parameter
from drivetool.identify.outcome import CORRELATED
from tests.check.models import model_of, model_over
from tests.diagnosed import diagnosis, gain as made_gain

ESTIMATE = diagnosis().estimate
NOISE = 0.02  # rad/s of the sensor


def gain(before, after):
    """Errors of free runs in units of the sensor's noise."""
    return made_gain(before * NOISE, after * NOISE, floor=NOISE)


@pytest.mark.parametrize(("before", "after", "share", "doubted"), [
    (27.0, 10.5, 0.10, True),
    (27.0, 10.5, 0.01, False),  # a torque may have that much noise
    (27.0, 4.0, 0.10, False),  # of the sensor's own size
    (60.0, 10.5, 0.10, False),  # little of what was there
])
def test_a_cause_is_suspect_where_implausible_noise_replaces_much(before, after, share, doubted):
    assert noise_hides_law(before, after, 1.0, share) is doubted


def test_the_suspicion_is_reported_with_its_size_and_the_deciding_experiment():
    between = ("hardening-stiffness", OUTSIDE_CATALOGUE)
    text = sentence_of("undetermined", ((), between, between[:1]), "", gain(27.0, 10.5), 0.08)
    assert "a shaft whose stiffness changes with load (hardening-stiffness) explains it best" in text
    assert "10 times the sensor's own noise" in text
    assert "8 % of its standard deviation" in text and OUTSIDE_CATALOGUE not in text
    assert "Hold the torque" in experiment_of(between, "undetermined")


def test_a_fault_of_the_record_is_no_law_that_the_model_lacks():
    codes = ("outliers", "backlash"), ("imbalance", "load-step"), ("backlash", "imbalance")
    text = sentence_of("undetermined", codes, "", gain(27.0, 10.5), 0.01)
    assert text.startswith("The record is at fault: single wrong values (outliers). In addition, the model lacks "
                           "backlash, and one further cause: ")
    text = sentence_of("undetermined", (("outliers",), *codes[1:]), "", gain(27.0, 10.5), 0.01)
    assert "In addition, the model lacks an effect: " in text


def test_part_of_an_answer_is_reported_as_such():
    between = ("asymmetric-friction", "torque-ripple", OUTSIDE_CATALOGUE)
    text = sentence_of("undetermined", (("outliers",), between, between[:2]), "", gain(27.0, 10.5), 0.01,
                       doubt="44 % of the explainable residual remains")
    assert text.startswith("The record is at fault: single wrong values (outliers). In addition, the model "
                           "lacks friction that depends on the direction (asymmetric-friction) and torque ripple "
                           "of the motor (torque-ripple), or an effect outside the catalogue")
    assert text.endswith(
        "to 0.21 rad/s, but 44 % of the explainable residual remains.") and OUTSIDE_CATALOGUE not in text
    assert "at other speeds and torques" in experiment_of(between, "undetermined", doubt="44 %")
    text = sentence_of("undetermined", ((), ("backlash", "coulomb-load", OUTSIDE_CATALOGUE), ("backlash",)), "",
                       gain(27.0, 10.5), 0.01, doubt="44 % is left")
    assert "lacks backlash (or dry friction at the load (coulomb-load) in place of one of them), or" in text


def test_a_cause_that_was_not_requested_is_reported():
    text = sentence_of("unexplained", ((), (), ()), "coulomb-load", gain(27.0, 27.0), 0.01)
    assert text.endswith("candidates explains; dry friction at the load (coulomb-load), which was not requested, "
                         "explains it.")
    named = sentence_of("named", (("backlash",), (), ("backlash",)), "", gain(27.0, 7.0), 0.01)
    assert "lacks backlash" in named and "7 times the sensor's own noise" in named
    assert "torque noise of 1 % of the torque's standard deviation" in named


def test_causes_of_the_base_are_reported_where_nothing_else_is_found():
    text = sentence_of("nothing-found", ((), (), ()), "", gain(1.0, 1.0), 0.01, in_base=("coulomb-motor",))
    assert text.endswith("The base model already contains dry friction at the motor (coulomb-motor).")


@pytest.mark.parametrize(("size", "had"), [(0.01, ["coulomb-motor"]), (1e-4, [])])
def test_the_base_has_a_cause_if_its_size_is_significant(size, had):
    def line(name, value, std):
        return Parameter(name=name, value=value, unit="Nm", start=value, std=std, ci95=None, status="fitted")

    estimate = replace(ESTIMATE, parameters=(line("motor.coulomb", size, 1e-4), line("load.coulomb", 0.2, 1e-3)))
    tried = [CandidateResult(code, "in-the-model") for code in ("coulomb-motor", "torque-offset")]
    assert causes_in_base([Round(1, candidates=tuple(tried))], estimate) == had


def test_a_channel_is_to_be_mended_not_recorded_again():
    assert "Correct the channel" in experiment_of((), "named", laws=False)
    assert "fresh record" in experiment_of((), "named")


@pytest.mark.parametrize(("shafts", "logged", "ends"), [
    (True, ("motor_speed",), "Log the load speed or the shaft torque too."),
    (True, ("motor_speed", "load_angle"), "Log the shaft torque too."),
    (True, ("motor_speed", "load_speed", "shaft_torque"), "in the report."),
    (False, ("motor_speed",), "in the report.")])
def test_only_missing_sensors_are_requested(shafts, logged, ends):
    assert experiment_of((), "unexplained", shafts, logged).endswith(ends)


@pytest.mark.parametrize(("met", "said"), [
    (0.7, "half of the record is too short"), (7.0, "attributes it to torque noise")])
def test_an_error_of_free_runs_is_put_down_to_noise_or_to_half_a_record(met, said):
    codes = (("imbalance",), (), ("imbalance",))
    assert said in sentence_of("named", codes, "", gain(27.0, 7.0), 0.01, met * NOISE)


@pytest.mark.parametrize(("causes", "found", "begins"), [
    (("outliers",), (), "The record is at fault, not the simulation: single wrong values (outliers)."),
    (("wrong-sign", "backlash"), ("backlash",), "The record is at fault: a channel with the wrong sign "
     "(wrong-sign). In addition, the model lacks backlash. Without it the simulated speed has an rms error of "),
    (("load-step",), ("load-step",), "The model lacks a load that set in or ended during the record (load-step). "
     "Without it the simulated speed has an rms error of 0.54 rad/s on held-out data, with it of 0.04 rad/s")])
def test_a_fault_of_the_record_is_not_one_of_the_simulation(causes, found, begins):
    text = sentence_of("named", (causes, (), found), "", gain(27.0, 2.0), 0.01)
    assert text.startswith(begins) and ("free runs" in text) == bool(found)


@pytest.mark.parametrize(("faults", "severity", "text"), [
    ((), "warning", "No cause of the catalogue explains"),
    (("quantisation",), "note", "quantisation explains this")])
def test_no_diagnosis_sends_the_user_to_a_diagnosis(faults, severity, text):
    finding = correlated_errors_finding([Fault(code, CORRELATED) for code in faults])
    assert finding.severity == severity and text in f"{finding.text} {finding.action}"
    assert "diagnose" not in finding.action


def line(name, value, unit, std=None):
    ends = None if std is None else (value - 1.96 * std, value + 1.96 * std)
    return Parameter(name=name, value=value, unit=unit, std=std, ci95=ends)


@pytest.mark.parametrize(("code", "lines", "words"), [
    ("coulomb-load", [line("load.coulomb", 0.4, "Nm", 0.01)],
     "load.coulomb 0.4 Nm (0.38 to 0.42, 95 %), 4 % of the largest torque"),
    ("coulomb-load", [line("load.coulomb", 0.4, "Nm")], "load.coulomb 0.4 Nm, 4 % of the largest torque"),
    ("backlash", [line("shaft.half_gap", 0.075071, "rad", 1e-5), line("load.coulomb", 1.0, "Nm")],
     "shaft.half_gap 0.075071 rad (0.075051 to 0.075091, 95 %)"),
    # An amplitude, whatever its phase; of its std the part along it.
    ("torque-ripple", [line("motor.ripple_sine", 0.3, "Nm", 0.1), line("motor.ripple_cosine", -0.4, "Nm", 0.2)],
     "motor.ripple 0.5 Nm (0.165 to 0.835, 95 %), 5 % of the largest torque"),
    # One that the fit did not settle has no interval, whatever its covariance says.
    ("torque-ripple", [line("motor.ripple_sine", 0.3, "Nm", 0.1), line("motor.ripple_cosine", -0.4, "Nm")],
     "motor.ripple 0.5 Nm, 5 % of the largest torque"),
    ("speed-filter", [line("sensor.bandwidth", 200.0, "1/s", 10.0)],
     "the time constant of sensor.bandwidth 0.005 s (0.00455 to 0.00554, 95 %)")])
def test_the_size_of_a_cause_in_words(code, lines, words):
    names = tuple(p.name for p in lines)
    std = [0.0 if p.ci95 is None else (p.ci95[1] - p.value) / 1.96 for p in lines]
    known = Covariance(names, np.diag(std) ** 2)
    estimate = replace(ESTIMATE, parameters=tuple(lines), covariance=known)
    base = model_over(Trace(np.array([[10.0], [-9.0]]), np.zeros((2, 1)), 1e-3))
    freed = tuple(n for n in names if CAUSES[code].has(n))
    sizes = sizes_of(SelectedCauses((code,), added={code: freed}), estimate, base)
    assert sizes == {code: words}
    assert words in sentence_of("named", ((code,), (), (code,)), "", gain(27.0, 2.0), 0.01, sizes=sizes)


@pytest.mark.parametrize(("before", "after", "words"), [
    (3.9432, 3.9439, "3.9439 instead of 3.9432"), (1.0, 2.0, "2 instead of 1"),
    (0.01234, 0.01236, "0.01236 instead")])
def test_values_of_two_records_have_as_many_digits_as_they_differ_in(before, after, words):
    change = Change({"load.coulomb": (before, after)}, 30.0, True, ("a.parquet",))
    assert words in records_differ_text(change, model_of())
