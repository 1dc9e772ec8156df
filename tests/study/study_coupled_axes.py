"""Coupled axes: what `greybox` says of a joint whose neighbour moves, and of a body whose inertia varies.

    python -m pytest -m study -s tests/study/study_coupled_axes.py

DRIVETOOL_STUDY_RECORDS  of each kind; DRIVETOOL_STUDY_SHIFT: other seeds
"""

from __future__ import annotations

import pytest

from tests.study.coupled_axes import arm, varying
from tests.study.missing_laws.estimators import NAMES
from tests.study.shared.command import greybox
from tests.study.shared.figures import share
from tests.study.shared.options import number

# Seeds that no other test uses.
FIRST_SEED = 860_000 + number("SHIFT", 0)
RECORDS = number("RECORDS", 20)
MIN_REFUSED = 0.95  # share of the coupled records that must be refused
MAX_ERROR = 3.0  # half-widths that an inertia may be off its mean
MAX_SILENT_WIDTH = 0.03  # of an interval over the inertia; a narrower one without a finding is a miss


def fitted(step: float, record: arm.JointRecord | varying.VaryingRecord) -> dict:
    """The default fit, from an inertia 30 % too small."""
    start = {"motor.inertia": 0.7 * record.inertia, "motor.viscous": 0.0, "motor.coulomb": 0.0}
    return greybox(step, {"motor_torque": record.torque, record.role: record.measured}, start, NAMES,
                   ["--drive", "one-body"])


def misses(found: dict, truth: float) -> bool:
    """Whether an inertia is far off, or its interval is narrow and nothing is said."""
    if found["ci95"][0] is None:
        return False
    low, high = found["ci95"][0]
    far = abs(found["value"][0] - truth) > MAX_ERROR * 0.5 * (high - low)
    return far or (high - low < MAX_SILENT_WIDTH * truth and "model-error" not in found["findings"])


@pytest.mark.study
def test_a_joint_whose_neighbour_moves_is_refused():
    """The true share of refusals may be the required one; no record gets an interval that is far off."""
    refused, wrong = 0, []
    for i in range(RECORDS):
        record = arm.draw(i, FIRST_SEED + i)
        found = fitted(arm.STEP, record)
        refused += "explains-nothing" in found["findings"]
        wrong += [i] if misses(found, record.inertia) else []
        print(i, record.excitation, record.role, f"{record.coupled:.2f}", found["ci95"][0], found["findings"])
    print(f"{refused} of {RECORDS} refused")
    assert share(refused, RECORDS)[2] >= MIN_REFUSED
    assert not wrong


@pytest.mark.study
def test_a_varying_inertia_is_identified_by_its_mean():
    """No inertia is far off its mean, and none is stated narrowly without a word."""
    wrong = []
    for i in range(RECORDS):
        record = varying.draw(i, FIRST_SEED + 100 + i)
        found = fitted(varying.STEP, record)
        # Of a part of a period the mean is that over the angles visited.
        truth = record.inertia if record.turns * record.order >= 1.0 else record.around
        wrong += [i] if misses(found, truth) else []
        print(i, record.excitation, record.order, f"{record.turns:.1f}", found["value"][0] / record.inertia,
              found["ci95"][0], found["findings"])
    assert not wrong
