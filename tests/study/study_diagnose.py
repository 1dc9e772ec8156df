"""Hidden-effect study: diagnose over fresh machines and seeds; hours, and it can be interrupted.

    DRIVETOOL_STUDY_ROUNDS=effect=3,pair=3,mixed=1,removed=1,limit=1,none=42 make study
    python -m tests.study.study_diagnose            # the tables of what has been run so far

A round is one case of every effect, each on a machine of its own (of limits: all of them on one, with four
sizes; of pairs, both; ten mixed ones; as many records without effects as there are effects). Every case is a
line of build/study_diagnose-<hash>.jsonl; those that are there are not run again. The hash is that of the code
that fits and judges: another tool starts another file, unless DRIVETOOL_STUDY_RESULTS says which to go on with.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta

from tests.hidden import CODES, KINDS, greybox_options, make_case, write_start
from tests.hidden.command import GRADES, Answer, CommandRunner, grade, greybox_and_diagnose, run
from tests.hidden.visibility import separation, visible
from tests.study.shared.options import results as results_file
from tests.study.shared.rows import resumed, rows

# Seeds that no other test uses; DRIVETOOL_STUDY_SHIFT draws others.
SHIFT = int(os.environ.get("DRIVETOOL_STUDY_SHIFT", "0"))
FIRST_SEED, FIRST_NULL, FIRST_MIXED = 50_000 + SHIFT, 60_000 + SHIFT, 80_000 + SHIFT
MIXED = 10  # of them a round
# Parts of the study, and rounds of each.
ROUNDS = {"effect": 20, "pair": 20, "mixed": 20, "removed": 20, "limit": 2, "none": 42}
# Visible: half the square is 50 units of log likelihood on the whole record, so that each of eight
# held-out folds has more than the log of a hundred that a discovery must show.
VISIBLE = 10.0
PAIRS = (("backlash", "coulomb-load"), ("third-mass", "torque-ripple"))
SENSORS = (("motor_speed",), ("motor_speed",), ("motor_angle",), ("motor_speed", "load_speed"),
           ("motor_speed", "shaft_torque"), ("motor_angle", "load_angle"))
# Visibilities at which the limit of detection is looked for; 6 is where effects should begin to be found.
AIMED_VISIBILITIES = (3.5, 5.0, 7.0, 10.0)
# Rivals that `separation` can fit: what the machine does, not what its logger does.
LAWS = set(CODES.values()) - {"quantisation", "torque-offset", "outliers", "wrong-sign", "wrong-scale"}
# A fresh record has them again, or others: what was found on this one does not hold for that one.
OF_THE_RECORD = {"wrong-sign", "wrong-scale", "outliers", "load-step"}
COLUMNS = ("right", "open", *GRADES[1:])


@dataclass(frozen=True)
class Plan:
    """One case to run.

    key      of its line
    options  arguments of `make_case`
    removed  causes left out of the catalogue
    aim      visibility that its one effect is given; 0: its size is that of the options, or the usual one
    """

    part: str
    key: str
    effects: tuple[str, ...]
    options: Mapping[str, object]
    removed: tuple[str, ...] = ()
    aim: float = 0.0


def varied(seed: int) -> dict[str, object]:
    """Kind of record, sensors, noise and machine, drawn by the seed; half of all are the plain kind."""
    rng = np.random.default_rng([seed, 86028121])
    options = {"machine_seed": seed, "seed": seed}
    if rng.uniform() < 0.5:
        return options
    bodies, linear = int(rng.choice([1, 2, 2, 2, 3])), bool(rng.uniform() < 0.25)
    sensors = SENSORS[int(rng.integers(len(SENSORS)))]
    if bodies == 1:
        sensors = tuple(role for role in sensors if role.startswith("motor"))
    return options | {"bodies": bodies, "linear": linear, "sensors": sensors,
                      "record": str(rng.choice(["reversing", "reversing", "closed-loop", "one-directional"])),
                      "noise": str(rng.choice(["nominal", "nominal", "loud"]))}


def mixed(seed: int) -> Plan:
    """One or two effects of any kind and size, on records of any length."""
    rng = np.random.default_rng([seed, 424242])
    while True:
        kinds = [str(code) for code in rng.choice(list(KINDS), int(rng.integers(1, 3)), replace=False)]
        if len({CODES[code].replace("sign", "scale") for code in kinds}) == len(kinds):
            break
    options = varied(seed)
    bodies = max(int(options.get("bodies", 2)), *(KINDS[code].bodies for code in kinds))
    size = {code: KINDS[code].usual * (1.0 if code.startswith("wrong-sign") else 2.0 ** rng.uniform(-0.5, 1.5))
            for code in kinds}
    options |= {"bodies": bodies, "size": size, "duration": float(rng.choice([8.0, 12.0, 20.0])),
                "records": int(rng.choice([1, 1, 1, 1, 2]))}
    if "imbalance" in kinds:
        options["linear"] = False
    return Plan("mixed", f"mixed/{'+'.join(kinds)}/{seed}", tuple(kinds), options)


def rounds_wanted(text: str) -> dict[str, int]:
    """Rounds per part, of words like `effect=3,none=42`; parts that are not named are not run."""
    found = {part: int(number) for part, _, number in (word.partition("=") for word in text.split(","))}
    if unknown := set(found) - set(ROUNDS):
        raise ValueError(f"parts of the study are {', '.join(ROUNDS)}, not {', '.join(sorted(unknown))}")
    return found


def plans(rounds: Mapping[str, int] = ROUNDS) -> list[Plan]:
    """Everything the study wants, in the order in which it is run: a bit of every part first.

    rounds  per part
    """
    found = []
    for i in range(max(rounds.values())):
        wanted = {part for part, number in rounds.items() if i < number}
        for seed, (code, kind) in enumerate(KINDS.items(), FIRST_SEED + i * len(KINDS)):
            options = varied(seed)
            options["bodies"] = max(int(options.get("bodies", 2)), kind.bodies)
            if code == "imbalance":  # a weight off the axis needs an axis that turns
                options["linear"] = False
            # Limits on the plain kind of record and one machine a round, where they can be compared.
            plain = {"machine_seed": FIRST_SEED + i, "seed": FIRST_SEED + i, "bodies": max(2, kind.bodies)}
            aims = () if code.startswith("wrong-sign") else AIMED_VISIBILITIES
            found += [plan for plan in (
                Plan("effect", f"effect/{code}/{i}", (code,), options),
                Plan("removed", f"removed/{code}/{i}", (code,), options, (CODES[code],)),
                *(Plan("limit", f"limit/{code}/{aim:g}/{i}", (code,), plain, (), aim) for aim in aims),
            ) if plan.part in wanted]
        if "pair" in wanted:
            options = {"machine_seed": FIRST_SEED + i, "seed": FIRST_SEED + i}
            found += [Plan("pair", f"pair/{'+'.join(pair)}/{i}", pair, options) for pair in PAIRS]
        if "mixed" in wanted:
            found += [mixed(FIRST_MIXED + MIXED * i + j) for j in range(MIXED)]
        if "none" in wanted:
            found += [Plan("none", f"none/{j}", (), varied(FIRST_NULL + j))
                      for j in range(i * len(KINDS), (i + 1) * len(KINDS))]
    return found


def with_aimed_size(plan: Plan) -> Mapping[str, object]:
    """The options of a plan, with the size that makes its effect as visible as it aims for.

    Visibility is nearly in proportion to the size, so two corrections are enough.
    """
    code, options = plan.effects[0], dict(plan.options)
    size = KINDS[code].usual
    for _ in range(3):
        options["size"] = float(f"{size:.6g}")
        number = visible(make_case(plan.effects, **options)).number
        if abs(number - plan.aim) < 0.1 * plan.aim:
            break
        size *= plan.aim / max(number, 0.01 * plan.aim)
    return options


def run_inside(folder: Path, words: Sequence[object]) -> subprocess.CompletedProcess:
    """The same command in this process, which it must have for itself: it moves to `folder`.

    Saves the start of an interpreter per command. Only for records without a label that it could see.
    """
    from drivetool.cli.command_line import app

    command, out, err = [str(word) for word in words], StringIO(), StringIO()
    with chdir(folder), redirect_stdout(out), redirect_stderr(err):
        try:
            code = app(command, standalone_mode=True) or 0
        except SystemExit as end:
            code = end.code
    return subprocess.CompletedProcess(command, code or 0, out.getvalue(), err.getvalue())


def run_plan(plan: Plan, diagnosing: Callable[..., Answer] = greybox_and_diagnose) -> dict:
    """Make the case, run the commands on it, open the label.

    Where nothing is hidden there is no label to keep from the commands, and they run in this process.
    """
    began, runner = time.monotonic(), run
    if plan.part == "none" and diagnosing is greybox_and_diagnose:
        runner, diagnosing = run_inside, partial(greybox_and_diagnose, runner=run_inside)
    case = make_case(plan.effects, **(with_aimed_size(plan) if plan.aim else plan.options))
    with tempfile.TemporaryDirectory() as room:
        logs, held = case.write_records(Path(room))
        start = write_start(case, Path(room))
        catalogue = sorted(set(CODES.values()) - set(plan.removed))
        more = ["--candidates", ",".join(catalogue)] if plan.removed else []
        answer = diagnosing(Path(room), logs, start, greybox_options(case), more)
        fresh = {name: fresh_error(Path(room), held[0], f"{name}.yaml", answer.gain.get("segment") or 0.0,
                                     runner)
                 for name in ("base", "extended")}
    # Only now is there a label: nothing of it was on the disk while the commands ran.
    label = case.label(visibility=plan.part != "removed")
    given, separations = grade(expected_causes(label, answer), answer, bool(plan.removed)), {}
    if given == "undetermined" and len(plan.effects) == 1 and plan.part != "limit":  # seen, rightly or not
        separations = {rival: separation(case, rival).number for rival in answer.between
                 if rival in LAWS and rival not in label["causes"]}
        given = "open" if separations and min(separations.values()) < VISIBLE else given
    return {
        "key": plan.key, "part": plan.part, "kinds": list(plan.effects), "truth": label["causes"],
        "visibility": label.get("visibility", {}).get("all"), "sizes": [e["size"] for e in label["effects"]],
        "grade": given, "separations": separations, "verdict": answer.verdict,
        "causes": list(answer.causes), "between": list(answer.between), "gain": answer.gain, "fresh": fresh,
        "rule": answer.rule, "facts": answer.facts, "to_name": expected_causes(label, answer),
        "removed": list(plan.removed),
        "gains": [[c["round"], c["code"], c["state"], c.get("gain"), c.get("gain_std"), c.get("evidence")]
                  for c in answer.candidates if c.get("gain") is not None],
        # Of the first round: there the base has none of it yet.
        "smallest": {c["code"]: {n: v["value"] for n, v in (c.get("smallest") or {}).items()}
                     for c in sorted(answer.candidates, key=lambda c: -c["round"])},
        "values": {n: v for e in label["effects"] for n, v in tool_values(e["truth"], label["plain"], {}).items()},
        "intervals": intervals(label, answer), "talk": answer.stderr[-300:] if answer.verdict == "failed" else "",
        "arguments": label["arguments"], "seconds": round(time.monotonic() - began, 1)}


def expected_causes(label: Mapping, answer: Answer) -> list[str]:
    """The hidden causes that must be named: of several those that show, and those that were found all the same."""
    each = label.get("visibility", {}).get("each") or []
    visible_causes = {cause for cause, number in zip(label["causes"], each, strict=False) if number >= VISIBLE}
    found = {*answer.causes, *answer.between}
    return [c for c in label["causes"] if c in visible_causes | found] if visible_causes else label["causes"]


def fresh_error(room: Path, log: Path, params: str, segment: float, running: CommandRunner) -> float | None:
    """Error of free runs on a record of the same machine that nobody has seen, by `validate`.

    segment  [s] length of the runs, that of the error which the diagnosis states
    """
    if not (room / params).exists():
        return None
    done = running(room, ["validate", log.name, "--params", params, "--segment", f"{segment:g}", "--json"])
    try:
        return json.loads(done.stdout)["checks"][0]["rmse"]
    except (ValueError, KeyError, IndexError):
        return None


def intervals(label: Mapping, answer: Answer) -> dict[str, bool]:
    """Parameter of a hidden effect -> whether the stated interval holds the truth."""
    found = {}
    fitted = {name: line.get("value") for name, line in answer.parameters.items()}
    for effect in label["effects"]:
        for name, value in tool_values(effect["truth"], label.get("plain", {}), fitted).items():
            ends = (answer.parameters.get(name) or {}).get("ci95")
            if ends and None not in ends:
                found[name] = bool(ends[0] <= value <= ends[1])
    return found


SAME = {"quadratic_drag": "drag", "load_step": "step_torque", "load_step_time": "step_time"}


def tool_values(truth: Mapping[str, float], plain: Mapping[str, float],
                fitted: Mapping[str, float]) -> dict[str, float]:
    """True values by the names and in the parameters that the tool has for the same laws."""
    found = {}
    for name, value in truth.items():
        owner, _, what = name.rpartition(".")
        if what == "breakaway":
            found[f"{owner}.stribeck"] = value - truth[f"{owner}.coulomb"]
        elif what == "coulomb" and f"{owner}.coulomb_back" in truth:
            found[name] = 0.5 * (value + truth[f"{owner}.coulomb_back"])  # the difference is an idle torque
        elif what == "filter_time":
            found["sensor.bandwidth"] = 1.0 / value if value > 0.0 else np.inf
        elif what == "damping_torque":
            found[f"{owner}.load_damping"] = plain.get(f"{owner}.damping", np.nan) / value
        elif what == "viscous_back":
            found[f"{owner}.viscous_asymmetry"] = 0.5 * (truth[f"{owner}.viscous"] - value)
        elif what == "hardening_twist":
            twist, power = fitted.get(name), truth[f"{owner}.hardening_power"]
            if twist is not None:
                found[f"{owner}.hardening"] = (twist / value) ** power
        elif what in ("ripple_amplitude", "imbalance"):
            law = what.partition("_")[0]
            size, phase = (value if law == "ripple" else -value), truth[f"{owner}.{law}_phase"]  # one opposes
            found |= {f"{owner}.{law}_sine": size * np.cos(phase), f"{owner}.{law}_cosine": size * np.sin(phase)}
        elif name == "friction.drift":  # of both parts of all bodies
            found |= {f"friction.drift_{part}": value for part in ("coulomb", "viscous")}
        elif what == "drift_time":
            found |= {f"{o}.drift_time": value for o in ("motor", "friction")}
        elif name.startswith("body"):
            found[f"tip.{what}"] = value
        elif what not in ("viscous", "coulomb_back"):
            found[f"{owner}.{SAME.get(what, what)}"] = value
    return found


# Resuming


def results() -> Path:
    """Where the rows of the tool as it is now are."""
    packages = ("logs", "drive", "identify", "check")
    return results_file("study_diagnose", [f"drivetool/{room}" for room in packages])


def study(wanted: Iterable[Plan], path: Path, workers: int = 2,
          diagnosing: Callable[..., Answer] = greybox_and_diagnose) -> list[dict]:
    """Run what is not there yet, a line per case as soon as it is done; all the wanted rows."""
    there, wanted = resumed(path), list(wanted)
    missing = [plan for plan in wanted if plan.key not in there]
    # Null records run inside their worker, which therefore is a process; a stand-in can stay a thread.
    with (ProcessPoolExecutor(workers, get_context("spawn")) if diagnosing is greybox_and_diagnose else
          ThreadPoolExecutor(workers)) as pool:
        for row in pool.map(_run_or_failed, missing, repeat(diagnosing)):
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
    keys = {plan.key for plan in wanted}
    return [row for row in rows(path) if row["key"] in keys]


def _run_or_failed(plan: Plan, diagnosing: Callable[..., Answer]) -> dict:
    """A case that breaks is a row too, and counts as failed; the others go on."""
    try:
        return run_plan(plan, diagnosing)
    except Exception as error:
        return {"key": plan.key, "part": plan.part, "kinds": list(plan.effects), "truth": [], "sizes": [],
                "visibility": VISIBLE, "grade": "failed", "separations": {}, "verdict": "failed", "causes": [],
                "between": [], "gain": {}, "fresh": {}, "smallest": {}, "intervals": {},
                "talk": repr(error)[-300:], "arguments": {}, "seconds": 0.0}


# Tables


def upper_limit(hits: int, of: int) -> float:
    """Upper end of the one-sided 95 % Clopper-Pearson interval of a share."""
    return 1.0 if hits >= of else float(beta.ppf(0.95, hits + 1, of - hits))


def confusion(found: Sequence[Mapping]) -> str:
    """Effects against grades, and what the wrong names were; visible cases only.

    open: undetermined, and rightly, since a rival that it names imitates the effect on this record.
    """
    lines = [f"{'effect':<24}" + "".join(f"{g:>13}" for g in COLUMNS) + f"{'not visible':>13}  wrong names"]
    for kind in dict.fromkeys("+".join(row["kinds"]) for row in found):
        rows_of_kind = [row for row in found if "+".join(row["kinds"]) == kind]
        visible_rows = [row for row in rows_of_kind if (row["visibility"] or 0.0) >= VISIBLE]
        count = Counter(row["grade"] for row in visible_rows)
        wrong = Counter("+".join(row["causes"]) for row in visible_rows if row["grade"] == "wrong")
        hidden = len(rows_of_kind) - len(visible_rows)
        lines.append(f"{kind:<24}" + "".join(f"{count[g]:>13}" for g in COLUMNS) + f"{hidden:>13}"
                     + "  " + ", ".join(f"{name} {n}" for name, n in wrong.most_common(3)))
    return "\n".join(lines)


def limits(found: Sequence[Mapping]) -> str:
    """Per effect: the visibility from which it is found, and the smallest size stated over that at this limit."""
    lines = [f"{'effect':<24}{'found from visibility':>24}{'stated over true limit':>26}"]
    for kind in dict.fromkeys(row["kinds"][0] for row in found):
        rows_of_kind = [row for row in found if row["kinds"] == [kind] and row["visibility"] and row["sizes"]]
        seen = [row["grade"] not in ("missed", "failed") for row in rows_of_kind]
        number = np.array([row["visibility"] for row in rows_of_kind])
        threshold = _detection_threshold(number, np.array(seen)) if rows_of_kind else None
        # Sizes are in proportion to visibility: the one at the limit is size * half / visibility.
        ratio = [size(name, least) / (size(name, amplitude(row["values"], name)) * threshold / row["visibility"])
                 for row in rows_of_kind if threshold
                 for name, least in (row["smallest"].get(*row["truth"][:1]) or {}).items()
                 if row["values"].get(name)]
        limit = f"over {number.max(initial=0.0):.1f}" if threshold is None else f"{threshold:.1f}"
        lines.append(f"{kind:<24}{limit:>24}"
                     f"{f'{np.median(ratio):.2f}' if ratio else '-':>26}")
    return "\n".join(lines)


def gain_covered(row: Mapping) -> list[bool]:
    """Whether the interval of the gain holds that on a fresh record; empty where there is none to hold."""
    ends, fresh = row["gain"].get("rmse_gain_ci95"), row["fresh"]
    if not ends or OF_THE_RECORD & set(row["causes"]) or not (fresh.get("base") and fresh.get("extended")):
        return []
    return [ends[0] <= fresh["base"] - fresh["extended"] <= ends[1]]


def size(name: str, value: float) -> float:
    """Of a lag or a filter its time, not its bandwidth."""
    return 1.0 / value if name.endswith(".bandwidth") else value


def amplitude(values: Mapping[str, float], name: str) -> float:
    """Size of a value; of a sine or a cosine that of the wave, whose phase says nothing about how well it shows."""
    return float(np.hypot(*(values.get(name.replace("cosine", "sine").replace("sine", part), 0.0)
                            for part in ("sine", "cosine")))) if name.endswith("sine") else abs(values[name])


def _detection_threshold(number: np.ndarray, seen: np.ndarray) -> float | None:
    """The threshold that makes the fewest errors between not seen below and seen above."""
    edges = np.sort(number)
    if not seen.any():
        return None
    wrong = [np.sum(seen & (number < edge)) + np.sum(~seen & (number >= edge)) for edge in edges]
    return float(edges[int(np.argmin(wrong))])


def summary(found: Sequence[Mapping]) -> str:
    """All tables, as the README has them."""
    parts = {part: [row for row in found if row["part"] == part]
             for part in ("effect", "pair", "mixed", "removed", "limit", "none")}
    alarms, nulls = sum(row["grade"] == "false-alarm" for row in parts["none"]), len(parts["none"])
    text = [confusion(parts["effect"] + parts["pair"])]
    grades = Counter(row["grade"] for row in parts["effect"] + parts["pair"]
                    if (row["visibility"] or 0.0) >= VISIBLE)
    if grades:
        good = grades["right"] + grades["open"]
        text.append(f"visible: {grades.total()}; named right or rightly open {good} "
                    f"({100 * good / grades.total():.1f} %), wrong {grades['wrong']}")
    seen = Counter(row["grade"] for row in parts["mixed"] if (row["visibility"] or 0.0) >= VISIBLE)
    if seen:
        text.append(f"one or two effects drawn from all, {seen.total()} visible: "
                    + ", ".join(f"{seen[grade]} {grade}" for grade in COLUMNS if seen[grade]))
    if nulls:
        text.append(f"false alarms: {alarms} of {nulls} null records, {100 * alarms / nulls:.2f} %, "
                    f"at most {100 * upper_limit(alarms, nulls):.2f} % (95 %)")
    if parts["removed"]:
        wrong = sum(row["grade"] == "wrong" for row in parts["removed"])
        text.append(f"true cause not in the catalogue: named {wrong} of {len(parts['removed'])}")
    hits = [held for row in found if row["grade"] == "right" and row["part"] != "removed"  # else the law is another
            for held in row["intervals"].values()]
    if hits:
        text.append(f"95 % intervals of the found effects hold: {sum(hits)} of {len(hits)}")
    fresh = [row["fresh"]["extended"] / row["gain"]["held_out_rmse_after"] for row in found
             if row["fresh"].get("extended") and row["gain"].get("held_out_rmse_after")]
    if fresh:
        low, middle, high = np.quantile(fresh, [0.05, 0.5, 0.95])
        text.append(f"error on fresh data over stated: median {middle:.3f}, 5 to 95 %: {low:.3f} to {high:.3f}")
    held = [held for row in found if row["part"] not in ("none", "removed") for held in gain_covered(row)]
    if held:
        text.append(f"95 % interval of the gain holds that on a fresh record: {sum(held)} of {len(held)}")
    if parts["limit"]:
        text.append(limits(parts["limit"]))
    return "\n\n".join(text)


@pytest.mark.study
def test_hidden_effects_over_fresh_seeds():
    """At least 95 % of visible effects named, at most 1 % wrong names and 1 % false alarms."""
    words = os.environ.get("DRIVETOOL_STUDY_ROUNDS")
    wanted = plans(rounds_wanted(words) if words else ROUNDS)
    found = study(wanted, results(), int(os.environ.get("DRIVETOOL_STUDY_WORKERS", "2")))
    print("\n" + summary(found))
    count = Counter(row["grade"] for row in found
                    if row["part"] in ("effect", "pair") and (row["visibility"] or 0.0) >= VISIBLE)
    total = sum(count.values())
    assert count["right"] + count["open"] >= 0.95 * total and count["wrong"] <= 0.01 * total, count
    null = Counter(row["grade"] for row in found if row["part"] == "none")
    assert null["false-alarm"] <= 0.01 * sum(null.values()), null


if __name__ == "__main__":
    print(summary(rows(results())))
