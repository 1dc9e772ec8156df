"""Names that `diagnose` gives on machines and laws of another simulator than that of the hidden-effect tests.

    DRIVETOOL_STUDY_PER_LAW=2 DRIVETOOL_STUDY_PER_RIGHT=6 python -m pytest -m study -s tests/study/study_names.py
    python -m tests.study.study_names       # the tables of what has been run so far

The machines, excitations, noises and laws are those of tests/study/two_masses. Start values are off by some 15 %
and have two digits, as a person writes them. Every other record is judged by one of another excitation and start
state. A further one, which no command sees before and whose motion is of the kind of those that judge, says what
the extended drive gains.

DRIVETOOL_STUDY_PER_LAW, _PER_RIGHT, _SIZES, _SHIFT, _WORKERS, _RESULTS  as in the study of missing laws
"""

from __future__ import annotations

import resource
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.hidden.command import Answer, greybox_and_diagnose, run
from tests.study.shared import options, rows
from tests.study.shared.command import write
from tests.study.shared.options import number, words
from tests.study.shared.rows import Job, Layout
from tests.study.study_diagnose import fresh_error, upper_limit
from tests.study.two_masses import kernel
from tests.study.two_masses.estimators import start_values
from tests.study.two_masses.laws import LAWS, Placed
from tests.study.two_masses.record import (
    GAP,
    RIGHT,
    STEP,
    Record,
    Setup,
    arrange,
    draw,
    moving,
    observed,
    prepare,
    simulate,
)

PER_LAW, PER_RIGHT = 2, 6
OTHER = 3  # kinds of excitation further on is another one
SIZES = ("M", "L")
# The names of the catalogue that are accepted for a law, and no others. A friction by direction is dry friction
# and a constant torque as far as it does not depend on the speed; what is added to friction of the load is dry
# friction on average. Cranks, eccentric sensors and noise on the log are in no catalogue: there no name is right.
ACCEPTED_NAMES: Mapping[str, set[str]] = {
    "motor.asymmetry": {"asymmetric-friction", "coulomb-motor"},
    "load.asymmetry": {"asymmetric-friction", "coulomb-load"},
    "motor.stribeck": {"stribeck-motor"}, "load.stribeck": {"stribeck-load", "coulomb-load"},
    "motor.drag": {"quadratic-drag"}, "load.drag": {"quadratic-drag"},
    "motor.warm-up": {"friction-drift"}, "load.warm-up": {"friction-drift", "coulomb-load"},
    "motor.load-steps": {"load-step"}, "load.load-steps": {"load-step"},
    "motor.cogging": {"torque-ripple"}, "load.cogging": {"torque-ripple", "imbalance"},
    "motor.gravity": {"torque-ripple", "imbalance"}, "load.gravity": {"torque-ripple", "imbalance"},
    "load.dry": {"coulomb-load"}, "shaft.gap": {"backlash"}, "load.third-mass": {"third-mass"},
    "motor.crank": set(), "load.crank": set(), "motor.eccentricity": set(), "motor.log-noise": set()}
LOGGERS = {"quantisation"}  # the sensors of this simulator have steps: to say so is right everywhere
FIRST_SEED = 880_000 + number("SHIFT", 0)
LAYOUT = Layout(LAWS, SIZES, RIGHT, FIRST_SEED)
CODE = ("drivetool/logs", "drivetool/drive", "drivetool/identify", "drivetool/check", "tests/study/missing_laws",
        "tests/study/two_masses")
GRADES = ("right", "open", "unexplained", "missed", "wrong", "false-alarm", "failed")


def grade_of_law(situation: str, answer: Answer, accepted_names: Mapping[str, set[str]] = ACCEPTED_NAMES,
          right: Sequence[str] = RIGHT) -> str:
    """One of GRADES.

    accepted_names  per law; right: situations in which nothing is missing
    open: neither certain nor excluded; where nothing is missing any answer but nothing is a false alarm
    """
    if answer.verdict == "failed":
        return "failed"
    accepted = accepted_names.get(situation.removeprefix(GAP), set())
    named, between = set(answer.causes) - LOGGERS, set(answer.between) - LOGGERS
    nothing = answer.verdict == "nothing-found" or (answer.verdict == "named" and not named)
    if situation in right:
        return "right" if nothing else "false-alarm"
    if named - accepted:
        return "wrong"
    if nothing:
        return "missed"
    if answer.verdict == "unexplained":
        return "unexplained" if accepted else "right"
    if answer.verdict == "undetermined":
        return "open" if between & (accepted | {"unlisted"}) or named else "wrong"
    return "right"


def fresh_record(setup: Setup, law: Placed, situation: str, count: int, seed: int) -> Record:
    """Another record of the same machine and law: excitation, start state and noise differ."""
    rng = np.random.default_rng([seed, 433494437])
    plain = situation.removeprefix(GAP)
    fresh = prepare(plain, setup.machine, count, len(setup.noise), rng)
    # What is logged, and how well, is the machine's own.
    same = {"noise": rng.permutation(setup.noise), "quantum": setup.quantum, "is_angle": setup.is_angle,
            "second": setup.second, "second_noise": rng.permutation(setup.second_noise),
            "load": setup.load, "log_noise": rng.permutation(setup.log_noise)}
    fresh = moving(Setup(**{**fresh.__dict__, **same}), lambda trial: simulate(trial, law).states[:, kernel.VM])
    return _logged(fresh, law, situation)


def _logged(setup: Setup, law: Placed, situation: str) -> Record:
    """What a logger writes of a run."""
    run = simulate(setup, law)
    channels = {"motor_torque": run.torque, "motor_angle" if setup.is_angle else "motor_speed": run.measured}
    if setup.second == "load_speed":
        channels["load_speed"] = run.states[:-1, kernel.VL] + setup.second_noise
    elif setup.second == "shaft_torque":
        channels["shaft_torque"] = observed(setup, law, run)[0] + setup.second_noise
    return Record(setup.machine, "", False, channels, situation.startswith(GAP), None)


def run_job(job: Job) -> list[dict]:
    """The row of one record."""
    record = draw(job.situation, job.size, job.number, job.seed)
    setup, law = arrange(job.situation, job.size, job.number, job.seed)
    judged = job.number % 2 == 1
    held, fresh = (fresh_record(setup, law, job.situation, job.number + kind, job.seed + k)
                   for kind, k in ((OTHER, 3), (OTHER * judged, 5)))
    with tempfile.TemporaryDirectory() as room:
        folder = Path(room)
        for name, each in (("record", record), ("held", held), ("fresh", fresh)):
            write(STEP, each.channels, folder / f"{name}.parquet")
        free = ["--free", "shaft.half_gap"] if record.gap else []
        found = answered(folder, start_file(start_values(record, job.seed), folder), free, judged)
    grade = grade_of_law(job.situation, found.pop("answer"))
    about = {"excitation": record.excitation, "sensors": list(record.channels), "judged": judged,
             "share": record.truth.share, "grade": grade, **found}
    return job.rows(about, lambda _: {})


def answered(folder: Path, start: Path, free: Sequence[str], judged: bool) -> dict:
    """What the tool says of record.parquet in a folder, and what that is worth on fresh.parquet; answer: its own.

    judged  whether held.parquet judges, or halves of the record
    """
    began = _spent()
    answer = greybox_and_diagnose(folder, [folder / "record.parquet"], start, free,
                                  ["--holdout", "held.parquet"] if judged else [])
    seconds = _spent() - began
    segment = answer.gain.get("segment") or 0.0
    errors = {name: fresh_error(folder, Path("fresh.parquet"), f"{name}.yaml", segment, run)
              for name in ("base", "extended")}
    return {
        "answer": answer, "verdict": answer.verdict, "causes": list(answer.causes), "between": list(answer.between),
        "gain": answer.gain, "fresh": errors, "rule": answer.rule, "facts": answer.facts,
        "gains": [[c["round"], c["code"], c["state"], c.get("gain"), c.get("gain_std"), c.get("evidence")]
                  for c in answer.candidates if c.get("gain") is not None],
        "talk": answer.stderr[-300:] if answer.verdict == "failed" else "", "seconds": round(seconds, 1)}


def _spent() -> float:
    """Processor time of the commands so far [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def start_file(off: Mapping[str, float], folder: Path, drive: str = "two-mass") -> Path:
    """start.yaml by hand: values that are off, in two digits."""
    values = {name: float(f"{value:.2g}") for name, value in off.items()}
    path = folder / "start.yaml"
    path.write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": {"name": drive},
                                    "parameters": values}, sort_keys=False))
    return path


def idle(_: tuple[str, ...]) -> None:
    """Nothing to warm up: commands run in processes of their own."""


def results() -> Path:
    """Where the rows of the tool as it is now are."""
    return options.results("study_names", CODE)


def table(found: Sequence[Mapping], right: Sequence[str] = RIGHT) -> str:
    """Per law and size the grades and what was named wrongly; then shares with their limits.

    right  situations in which nothing is missing
    """
    lines = [f"{'law':<22}" + "".join(f"{g:>13}" for g in GRADES) + "  wrong names"]
    for law in dict.fromkeys((row["law"], row["size"]) for row in found):
        mine = [row for row in found if (row["law"], row["size"]) == law]
        count = Counter(row["grade"] for row in mine)
        wrong = Counter("+".join((*row["causes"], *row["between"])) or row["verdict"] for row in mine
                        if row["grade"] in ("wrong", "false-alarm"))
        lines.append(f"{' '.join(law):<22}" + "".join(f"{count[g]:>13}" for g in GRADES) + "  "
                     + ", ".join(f"{name} {n}" for name, n in wrong.most_common(3)))
    laws = [row for row in found if row["law"] not in right]
    nulls = [row for row in found if row["law"] in right]
    for words_, hits, of in (
            ("wrong names", sum(r["grade"] == "wrong" for r in laws), len(laws)),
            ("false alarms", sum(r["grade"] == "false-alarm" for r in nulls), len(nulls)),
            ("failed", sum(r["grade"] == "failed" for r in found), len(found))):
        lines.append(f"{words_}: {hits} of {of}, at most {100.0 * upper_limit(hits, of):.1f} % (95 %)")
    held = [h for row in found for h in gain_covered(row)]
    if held:
        lines.append(f"gain on a fresh record inside its interval: {sum(held)} of {len(held)}")
    return "\n".join(lines)


def gain_covered(row: Mapping) -> list[bool]:
    """Whether the interval of the gain holds that on a fresh record; empty where there is none."""
    ends, fresh = row["gain"].get("rmse_gain_ci95"), row["fresh"]
    if not ends or None in ends or not (fresh.get("base") and fresh.get("extended")):
        return []
    return [ends[0] <= fresh["base"] - fresh["extended"] <= ends[1]]


@pytest.mark.study
def test_names_on_another_simulator():
    """Every record is answered; the table is printed."""
    wanted = LAYOUT.jobs(number("PER_LAW", PER_LAW), number("PER_RIGHT", PER_RIGHT), ("diagnose",),
                         words("SIZES", SIZES))
    found = rows.run(wanted, results(), run_job, idle, number("WORKERS", 2))
    print(f"\nseeds from {FIRST_SEED}\n\n" + table(found))
    failed = [row["key"] for row in found if row["grade"] == "failed"]
    assert len(failed) <= 0.01 * len(found), failed


if __name__ == "__main__":
    print(table(rows.rows(results())))
