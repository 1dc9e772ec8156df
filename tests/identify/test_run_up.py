"""Run-ups of an induction motor after its coast-down: the voltages of its supply fix the scale of the torques."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.errors import BadRecording
from drivetool.identify.coast_down.estimator import flux_decay
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.supply import as_stator_voltages
from drivetool.identify.steady.estimator import steady
from tests.coasting import Motor
from tests.induction import ELECTRICAL, Machine, run_up, switched

COAST_DOWN_OPTIONS = Options(method="coast-down")
TRUTH = {"motor.inertia": 8.7499e-5, "motor.viscous": 1.0791e-4, "motor.coulomb": 0.012998}
KNOWN = one_body().with_values(ELECTRICAL)


def fitted(*experiments, drive=KNOWN, options=COAST_DOWN_OPTIONS):
    """The estimate of recordings of a supply."""
    return steady(*as_stator_voltages(experiments, drive, off_too=True), options)


def values(estimate):
    """Name -> parameter."""
    return {p.name: p for p in estimate.parameters}


@pytest.mark.parametrize("phases", [False, True], ids=["voltage and frequency", "two phases"])
def test_a_run_up_identifies_inertia_and_friction(phases):
    estimate = fitted(switched(1, phases=phases))
    assert not estimate.findings
    for name, truth in TRUTH.items():
        p = values(estimate)[name]
        assert abs(p.value - truth) < 4.0 * p.std and p.std < 2e-5 * truth
    assert values(estimate)["motor.rotor_resistance"].reason == "taken as known"


@pytest.mark.slow
def test_the_no_load_speed_is_where_a_general_solver_ends():
    (found,) = (p for p in fitted(switched(10)).ratios if p.name == "no_load_speed")
    assert abs(found.value - run_up(Machine(), 1.5)[1, -1]) < 4.0 * found.std
    assert 0.0 < found.std < 1e-6 * found.value


@pytest.mark.slow
def test_two_pole_pairs_and_another_frequency():
    machine = Machine(voltage=150.0, frequency=60.0, pairs=2, motor=Motor(inertia=2e-4))
    estimate = fitted(switched(2, machine), drive=KNOWN.with_values({"motor.pole_pairs": 2.0}))
    assert values(estimate)["motor.inertia"].value == pytest.approx(2e-4, rel=1e-4)
    assert estimate.drive.value("motor.supply_frequency") == 60.0


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_voltage_that_is_wrong_by_one_per_cent_shows_as_two_in_the_inertia(factor):
    e = switched(3)
    e = replace(e, signals=dict(e.signals) | {"supply_voltage": factor * e.signals["supply_voltage"]})
    assert values(fitted(e))["motor.inertia"].value / 8.7499e-5 == pytest.approx(factor**2, abs=3e-3)


@pytest.mark.slow
def test_another_resistance_is_said_and_another_number_of_poles_refused():
    e = switched(4)
    found = fitted(e, drive=KNOWN.with_values({"motor.rotor_resistance": 44.0}))
    (said,) = found.findings
    assert said.code == "torque-contradicts-motion" and "electrical" in said.text
    with pytest.raises(BadRecording, match="pole pairs"):
        fitted(e, drive=KNOWN.with_values({"motor.pole_pairs": 2.0}))


@pytest.mark.slow
def test_the_flux_decay_is_waited_for_by_default():
    assert flux_decay(KNOWN) == pytest.approx(3.0 * 2.06 / 42.2)
    assert flux_decay(one_body()) == 0.0
    e = switched(5)
    spans = fitted(e).details["spans"]
    assert spans[1]["start"] - spans[0]["end"] == pytest.approx(3.0 * 2.06 / 42.2, abs=1e-4)
    stated_spans = fitted(e, options=replace(COAST_DOWN_OPTIONS, flux_decay=0.3)).details["spans"]
    assert stated_spans[1]["start"] - stated_spans[0]["end"] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.slow
def test_a_record_that_begins_under_supply_finds_its_fluxes():
    e = switched(6)
    first = 4000  # 0.15 s after switching on
    cut = replace(e, signals={k: v[first:] for k, v in e.signals.items()}, segments=((0, e.size - first),))
    for name, truth in TRUTH.items():
        p = values(fitted(cut))[name]
        assert abs(p.value - truth) < 4.0 * p.std


@pytest.mark.slow
def test_what_is_no_supply_is_refused():
    e = switched(7)
    angle, voltage = e.signals["motor_angle"], e.signals["supply_voltage"]
    for signals, wanted in (({"motor_voltage_a": voltage}, "motor_voltage_b"),
                            ({"supply_voltage": voltage}, "frequency"),
                            ({"supply_voltage": voltage, "motor_torque": voltage}, "either a torque or voltages")):
        with pytest.raises(BadRecording, match=wanted):
            fitted(replace(e, signals={"motor_angle": angle, **signals}))


@pytest.mark.slow
def test_a_drive_that_is_no_induction_motor_keeps_its_recordings():
    e = switched(8)
    assert as_stator_voltages((e,), one_body())[0] == (e,)


@pytest.mark.slow  # a filter over 18 states
def test_other_steps_take_the_run_up_and_say_what_they_leave_out():
    e = switched(9).between(0.0, 0.3)
    e = replace(e, signals=dict(e.signals) | {"supply_voltage": np.where(np.arange(e.size) < 5000,
                                                                         e.signals["supply_voltage"], 0.0)})
    (cut,), drive = as_stator_voltages((e,), KNOWN.with_values(TRUTH | {"motor.inertia": 8.5e-5,
                                                                        "motor.idle_torque": 0.0}))
    assert [f.code for f in cut.findings] == ["stretches-left-out"]
    estimate = greybox([cut], drive, Options(free=("motor.inertia",), hold=("motor.viscous", "motor.coulomb",
                                                                            "motor.idle_torque")))
    p = values(estimate)["motor.inertia"]
    assert abs(p.value - 8.7499e-5) < 4.0 * p.std and p.std < 0.01 * 8.7499e-5
