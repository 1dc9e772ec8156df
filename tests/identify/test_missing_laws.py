"""Laws that an inverse fit lacks are fitted, and noise that the loop feeds back is no law."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.identify.loop import MACHINES, loop_record
from tests.study.missing_laws import kernel

AXIS = MACHINES[0]
DIRECTION = (0.1, 1.0, 0.0, 6.0)  # 0.1 Nm more at 6 rad/s forward
LAWS = {"gravity": (kernel.GRAVITY, (0.3, 0.4), "torque ripple of order 1"),
        "cogging": (kernel.COGGING, (0.03, 7.0, 0.5), "torque ripple of order 7"),
        "direction": (kernel.ASYMMETRY, DIRECTION, "direction-dependent friction")}


def without_reference(made):
    return replace(made, signals={n: made.signals[n] for n in ("motor_torque", "motor_angle")})


def fitted(axis, made):
    return greybox([made], axis.start, Options(criterion="inverse"))


@pytest.mark.slow
@pytest.mark.parametrize("with_reference", [True, False])
@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_found_and_the_inertia_is_right(name, with_reference):
    code, strength, words = LAWS[name]
    made = loop_record(AXIS, 21, 0.01, seconds=10.0, law=code, strength=strength)
    estimate = fitted(AXIS, made if with_reference else without_reference(made))
    assert words in {law.name for law in estimate.laws}
    inertia = next(p for p in estimate.parameters if p.name == "motor.inertia")
    assert abs(inertia.value - AXIS.values[0]) < min(4.0 * inertia.std, 0.01 * AXIS.values[0])
    assert not estimate.drive.known_torques and not any("law" in p.name for p in estimate.parameters)
    assert estimate.fit["torque_fit_percent_with_laws"] > estimate.fit["torque_fit_percent"] + 1.0
    said = next(f for f in estimate.findings if f.code == "model-error")
    assert words in said.text and "fitted in addition to the drive model" in estimate.explanation


def test_the_size_of_a_law_is_that_of_its_torque():
    made = loop_record(AXIS, 22, 0.01, seconds=10.0, law=kernel.GRAVITY, strength=(0.3, 0.4))
    law = next(x for x in fitted(AXIS, made).laws if x.name == "torque ripple of order 1")
    assert len(law.factors) == 2
    # Columns of size one, cosine and sine of a wave of 0.3 over the angles of the record.
    angle = made.signals["motor_angle"]
    wanted = 0.3 * np.array([np.cos(0.4), -np.sin(0.4)]) * [
        np.sqrt(np.mean(f(angle) ** 2)) for f in (np.cos, np.sin)]
    assert law.factors == pytest.approx(wanted, abs=5.0 * max(law.std) + 0.003)


@pytest.mark.slow
@pytest.mark.parametrize("with_reference", [True, False])
@pytest.mark.parametrize("place", range(len(MACHINES)))
def test_a_disturbance_in_the_loop_is_no_law(place, with_reference):
    """A tenth of the rated torque: it moves the body, and so goes with its motion."""
    made = loop_record(MACHINES[place], 900001, 0.1, seconds=10.0)
    estimate = fitted(MACHINES[place], made if with_reference else without_reference(made))
    assert estimate.laws == () and estimate.explanation == ""
    assert "torque_fit_percent_with_laws" not in estimate.fit


def test_friction_that_was_freed_is_no_law_too():
    """A law that is a parameter of the drive leaves nothing to be taken out."""
    made = loop_record(AXIS, 23, 0.01, seconds=10.0, law=kernel.ASYMMETRY, strength=DIRECTION)
    estimate = greybox([made], AXIS.start, Options(criterion="inverse", free=("motor.viscous_asymmetry",)))
    line = next(p for p in estimate.parameters if p.name == "motor.viscous_asymmetry")
    assert estimate.laws == () and abs(line.value - 0.05 / 6.0) < 4.0 * line.std
