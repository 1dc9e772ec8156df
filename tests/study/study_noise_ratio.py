"""Torque noise from none to strong: whether its ratio is found, and whether a right model is said to be right.

    DRIVETOOL_STUDY_RATIO=500 DRIVETOOL_STUDY_DIAGNOSED=100 \
        python -m pytest -m study -s tests/study/study_noise_ratio.py

A record of a linear two-mass drive or of one body with dry friction, in which the model is right, and another one
of the same machine that the fit has not seen. The ratio is that of what the torque noise moves the motor by within
a second, root mean square, to the sensor's noise.

DRIVETOOL_STUDY_RATIO      number of records that are fitted; DRIVETOOL_STUDY_SHIFT: other seeds
DRIVETOOL_STUDY_DIAGNOSED  number of records in which a cause is sought
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.fit import by_innovations, with_coloured_noise
from drivetool.identify.greybox import default_free
from drivetool.identify.noise import restricted_likelihood, unit_noise_ratio
from drivetool.identify.setup import Outcome, Task, reverses, roles_of
from drivetool.logs import Experiment
from tests.hidden.command import read
from tests.recover import drive_like, experiment, linear_record
from tests.simulator.machine import Machine, machine_by_seed
from tests.simulator.records import white_noise, write_parquet
from tests.simulator.simulate import simulate_linear
from tests.study.missing_laws.estimators import NAMES
from tests.study.missing_laws.excitation import EXCITATIONS
from tests.study.missing_laws.laws import Law
from tests.study.missing_laws.record import arrange, simulate
from tests.study.study_diagnose import run_inside

RATIOS = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0)
KINDS = ("two-mass", "one-body")
SAMPLES = 3000
FIRST_SEED = 140_000 + int(os.environ.get("DRIVETOOL_STUDY_SHIFT", "0"))
HELD_OUT_SEED_SHIFT = 500_000  # between the seeds of a record and of the one held out
SENSOR = 0.002  # std of the sensor over the speed that rated torque gives a two-mass drive in a quarter of a second
GRID = np.linspace(-9.0, 3.0, 61)  # decades of the ratio about the natural one
ALLOWED = 0.01  # of the records, on which a right model may fail: the level of the test of residual and torque
CORRELATED_CODE = "innovations-correlated"
MAX_LIKELIHOOD_LAG = 2.0  # log likelihood by which a value of the grid may be better


@dataclass(frozen=True)
class Case:
    """A machine with the strength of its torque noise."""

    kind: str
    ratio: float
    seed: int


@dataclass(frozen=True)
class Records:
    """What a fit sees and what it does not: the same machine twice.

    start  parameter -> value that the fit starts from
    """

    fitted: Experiment
    held: Experiment
    start: Mapping[str, float]


def cases(count: int) -> list[Case]:
    """So many, every ratio of either kind in turn."""
    kinds = [(kind, ratio) for ratio in RATIOS for kind in KINDS]
    return [Case(*kinds[i % len(kinds)], FIRST_SEED + i) for i in range(count)]


def simulated(machine: Machine, step: float) -> float:
    """Rms motion of the motor [rad/s] within a second by white torque noise of one, held over each sample."""
    free, draws = replace(machine, idle_torque=(), coulomb=()), 64
    noise = np.random.default_rng(1).standard_normal((draws, round(1.0 / step)))
    speeds = simulate_linear(free, np.zeros(noise.shape[1]), step, None, noise).speeds[..., 0]
    return float(np.sqrt(np.mean(speeds**2)))


def records_of(case: Case) -> Records:
    """The records of a case."""
    return two_masses(case) if case.kind == "two-mass" else one_mass(case)


def two_masses(case: Case) -> Records:
    """Upward steps and a multisine about the resonance."""
    machine, step = machine_by_seed(case.seed), 1e-3
    sensor = SENSOR * machine.rated_torque * 0.25 / sum(machine.inertia)
    torque = case.ratio * sensor / simulated(machine, step) / machine.rated_torque
    fitted, held = (linear_record(machine, case.seed + shift, SAMPLES * step, torque, SENSOR)
                    for shift in (0, HELD_OUT_SEED_SHIFT))
    names = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous",
             "load.idle_torque"]
    drive = drive_like(machine, names, 0.1, case.seed)
    return Records(fitted, held, {name: float(drive.values[name]) for name in names})


def one_mass(case: Case) -> Records:
    """Two of the eight excitations, in which the motor turns both ways: one way its frictions are one sum."""
    rng = np.random.default_rng([case.seed, 1])
    step = arrange("quiet", 0.0, 0, case.seed, 1.0)[0].step
    first = arrange("quiet", 0.0, 0, case.seed, SAMPLES * step)[0].machine
    sensor = first.rated_speed * 10.0 ** rng.uniform(-3.5, -2.5)
    torque = case.ratio * sensor / simulated(Machine((first.inertia,), (first.viscous,)), step)
    found = []
    for number in range(case.seed, case.seed + len(EXCITATIONS)):
        setup = arrange("quiet", 0.0, number, case.seed, SAMPLES * step)[0]
        noise, push = (white_noise(len(setup.noise), std, int(rng.integers(2**31))) for std in (sensor, torque))
        run = simulate(replace(setup, noise=noise, disturbance=push, quantum=0.0, is_angle=False), Law("none"))
        found.append(experiment(run.torque, run.measured, step=step))
    fitted, held = [e for e in found if reverses([e])][:2]
    off = 1.0 + rng.choice([-1.0, 1.0], 4) * rng.uniform(0.15, 0.5, 4)
    return Records(fitted, held, dict(zip(NAMES, (first.numbers() * off).tolist(), strict=True)))


def run_case(case: Case) -> dict:
    """Fit, judge, look along the ratio; what the talk of a failed command ends in."""
    records = records_of(case)
    drive = {"one-body": one_body, "two-mass": two_mass}[case.kind]().with_values(records.start)
    with tempfile.TemporaryDirectory() as room:
        fit = greybox(Path(room), case, records, "innovations")
        if fit.returncode not in (0, 3):
            return {"failed": fit.stderr[-300:]}
        judged = run_inside(Path(room), ["validate", "held.parquet", "--params", "fit.yaml", "--json"])
    answer, said = json.loads(fit.stdout), json.loads(judged.stdout)
    task = Task(drive, default_free(drive, [records.fitted]), roles_of([records.fitted], drive), (records.fitted,))
    return {"behind": lag_behind_best(with_coloured_noise(by_innovations(task, [{}]))), "code": judged.returncode,
            "noise": answer["noise"], "findings": [f["code"] for f in answer["findings"]],
            "said": [f["code"] for f in said["findings"]]}


def greybox(room: Path, case: Case, records: Records, criterion: str) -> CompletedProcess:
    """Write both records and fit the first: fit.yaml."""
    units = {"motor_torque": "Nm", "motor_speed": "rad/s"}
    for name, e in (("fitted", records.fitted), ("held", records.held)):
        write_parquet(room / f"{name}.parquet", {r: (e.signals[r], u) for r, u in units.items()}, e.step)
    words = ["greybox", "fitted.parquet", "--drive", case.kind, "--criterion", criterion, "--json", "--out",
             "fit.yaml", "--quiet", *(w for n, v in records.start.items() for w in ("--set", f"{n}={v!r}"))]
    return run_inside(room, words)


def diagnosed(case: Case) -> dict:
    """The verdict on a record in which nothing is hidden, judged by the other."""
    with tempfile.TemporaryDirectory() as place:
        room = Path(place)
        fit = greybox(room, case, records_of(case), "auto")
        if fit.returncode not in (0, 3):
            return {"verdict": "failed", "said": fit.stderr[-300:]}
        done = run_inside(room, ["diagnose", "fitted.parquet", "--params", "fit.yaml", "--holdout", "held.parquet",
                                 "--out", "extended.yaml", "--quiet"])
        if done.returncode not in (0, 3):
            return {"verdict": "failed", "said": done.stderr[-300:]}
        answer = read(room / "extended.yaml")
        return {"verdict": answer.verdict, "said": answer.causes}


def lag_behind_best(outcome: Outcome) -> float:
    """Restricted log likelihood by which a ratio of the grid is better than that of the fit, all else as it is.

    Ratios next to it do not count: where dry friction sticks and slips the likelihood is not smooth.
    """
    problem, point, found = outcome.problem, outcome.fit.point, outcome.fit.noise
    ratios = unit_noise_ratio(problem, point) * 10.0**GRID
    ratios = ratios[np.abs(np.log10(ratios / found.ratio)) > np.diff(GRID)[0]]
    least = min(restricted_likelihood(problem, point, replace(found, ratio=r))[0] for r in ratios)
    return restricted_likelihood(problem, point, found)[0] - least


@pytest.mark.study
def test_torque_noise_of_any_strength():
    """None stuck; of a right model all but one in a hundred pass on records held out."""
    wanted = cases(int(os.environ.get("DRIVETOOL_STUDY_RATIO", "500")))
    rows = [(case, run_case(case)) for case in wanted]
    failed = [(case, row["failed"]) for case, row in rows if "failed" in row]
    assert not failed, failed
    stuck = [(case, row["behind"]) for case, row in rows if row["behind"] > MAX_LIKELIHOOD_LAG]
    missed = [(case, row["code"], row["said"]) for case, row in rows if row["code"] != 0]
    print(f"\n{len(rows)} records from seed {FIRST_SEED}: {len(stuck)} ratios stuck, {len(missed)} not passed")
    print("kind, ratio: records, stuck, not passed, doubted by greybox")
    for kind, ratio in dict.fromkeys((case.kind, case.ratio) for case, _ in rows):
        these = [row for case, row in rows if (case.kind, case.ratio) == (kind, ratio)]
        print(f"  {kind} {ratio:g}: {len(these)}, {sum(r['behind'] > MAX_LIKELIHOOD_LAG for r in these)}, "
              f"{sum(r['code'] != 0 for r in these)}, {sum(CORRELATED_CODE in r['findings'] for r in these)}")
    assert not stuck, stuck
    assert len(missed) <= ALLOWED * len(rows), missed


@pytest.mark.study
def test_no_cause_is_named_where_nothing_is_hidden():
    """At most one false alarm in a hundred."""
    wanted = cases(int(os.environ.get("DRIVETOOL_STUDY_DIAGNOSED", "100")))
    alarms = []
    for case in wanted:
        row = diagnosed(case)
        print(case, row["verdict"], row["said"], flush=True)
        alarms += [] if row["verdict"] == "nothing-found" else [(case, row)]
    print(f"\n{len(wanted)} records from seed {FIRST_SEED}: {len(alarms)} not without a finding")
    assert len(alarms) <= ALLOWED * len(wanted), alarms
