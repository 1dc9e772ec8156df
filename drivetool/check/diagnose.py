"""Diagnose: where the simulation departs from the machine, which cause explains it, and what that gains.

Round by round every cause of the catalogue is fitted on top of what was found, and judged by the
log likelihood of samples it was not fitted to. Found is what beats the best that the base can do
there; named is what no other cause comes close to; and what noise cannot explain in the end is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.check.candidates import CANDIDATES
from drivetool.check.decide import LEFT, Decision, decide
from drivetool.check.diagnosis import DiagnoseOptions, Diagnosis, Gain, Round
from drivetool.check.folds import blocks_of
from drivetool.check.forecast import forecast, gain_of, unexplained_percent
from drivetool.check.heldout import Score, both, folds_of, score
from drivetool.check.hypothesis import TRIFLE, Tried, attempt
from drivetool.check.model import Masks, Model, everything, fit, spread
from drivetool.check.preflight import Fault, preflight
from drivetool.check.remainder import Remainder, remainder
from drivetool.check.samples import fitted_samples, samples_of
from drivetool.check.story import results_of, tell
from drivetool.drive.chain import Drive
from drivetool.errors import BadOption, BadParameters, NotEnoughData, nearest
from drivetool.identify.engine import Task
from drivetool.identify.noise import Noise, filtered, fit_ratio
from drivetool.identify.setup import first_point, roles_of
from drivetool.logs.experiment import Experiment

WORKERS = 2
JUDGED = 8  # causes that are judged on held-out samples, the likeliest first
SHORTEST = 2.0  # s of record below which nothing can be held out
RECORD_FAULTS = ("outliers", "quantisation", "wrong-sign", "wrong-scale")
CODES = tuple(c.code for c in CANDIDATES) + RECORD_FAULTS


def diagnose(experiments: Sequence[Experiment], drive: Drive, noise: Mapping[str, float],
             free: Sequence[str], options: DiagnoseOptions, holdout: Sequence[Experiment] = ()) -> Diagnosis:
    """Find what the simulation of a drive gets wrong.

    experiments  records with motor torque and any sensors; holdout: records that only judge, or
                 none: then each half of the blocks of the records judges what the other trained
    drive        the base, fitted; noise as its parameter file has it
    free         names of its parameters that are fitted again, with and without a cause
    raises       BadParameters: a value is missing; NotEnoughData: too short to hold anything out;
                 BadOption: a cause that is not in the catalogue
    source       Wasserman, Ramdas, Balakrishnan 2020 for the evidence; Ljung 1999 for the one-step
                 errors
    """
    wanted = chosen(options)
    drive.require(drive.missing(), "a diagnosis")
    if not free:
        raise BadParameters("a base with fitted parameters", "none that was fitted",
                            "Run greybox on a record of this drive first.")
    mended, faults = preflight((*experiments, *holdout), wanted)
    train, test = mended[:len(experiments)], mended[len(experiments):]
    task = Task(drive, tuple(n for n in drive.quantities if n in free), roles_of(mended, drive), train + test)
    traces = task.problem().traces
    if sum(t.step * t.size for t in traces) < SHORTEST:
        raise NotEnoughData(f"at least {SHORTEST:g} s of record", "less", "Record longer, or give several logs.")
    samples = samples_of(traces, train, test)
    search = Search(base_model(task, fitted_samples(samples)), wanted, options, samples, faults)
    return tell(search.run(), drive, options)


def chosen(options: DiagnoseOptions) -> tuple[str, ...]:
    """Codes of the causes to try."""
    for code in options.candidates:
        if code not in CODES:
            raise BadOption("causes of the catalogue after --candidates", f"'{code}'", nearest(code, CODES))
    return options.candidates or CODES


def base_model(task: Task, masks: Masks) -> Model:
    """The base refitted until it moves no more: one that has not converged makes every cause a discovery."""
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    return fit("base", task, problem, point, noise, masks, rounds=10)


class Search:
    """The rounds of a diagnosis; `run` goes through them."""

    def __init__(self, base: Model, wanted: Sequence[str], options: DiagnoseOptions,
                 samples: Sequence, faults: Sequence[Fault]):
        self.first, self.options, self.samples, self.faults = base, options, samples, list(faults)
        self.candidates = [c for c in CANDIDATES if c.code in wanted]
        self.masks = fitted_samples(samples)
        self.model, self.folds = base, folds_of(both(base, self.masks), samples)
        self.first_folds = self.folds
        self.causes: list[str] = []
        self.between: tuple[str, ...] = ()
        self.evidence: dict[str, float] = {}
        self.rounds: list[Round] = []
        self.gained, self.left = 0.0, Remainder(0.0, 0.0, 0.0)
        self.trained = tuple(f.trained for f in self.folds)

    def run(self) -> Search:
        """All rounds, until nothing more is found."""
        budget = self.options.error_budget
        for number in range(self.options.rounds + 1):
            budget *= 0.5
            tried = self._attempt()
            tried, scores = self._judge(tried)
            decision = decide(scores, budget)
            last = number == self.options.rounds
            stage = None if decision.best is None or last else self._adopt(decision)
            self.rounds.append(Round(self.causes[-1] if stage else None, results_of(
                tried, scores, decision, self.rounds_std(tried)), stage))
            if stage is None or self.between:
                break
        self.left = remainder(self.model)
        return self

    def _attempt(self) -> list[Tried]:
        with ThreadPoolExecutor(WORKERS) as pool:
            return list(pool.map(lambda c: attempt(c, self.model, self.masks), self.candidates))

    def _judge(self, tried: Sequence[Tried]) -> tuple[list[Tried], list[Score]]:
        """Held-out scores of the likeliest causes. A base that one of them improves is refitted first."""
        likely = sorted((t for t in tried if t.model is not None and t.model.value < self.model.value - TRIFLE),
                        key=lambda t: t.model.value)[:JUDGED]

        def one(t: Tried) -> Score | None:
            try:
                return score(t.model, self.folds)
            except (np.linalg.LinAlgError, FloatingPointError):
                return None

        with ThreadPoolExecutor(WORKERS) as pool:
            scores = list(pool.map(one, likely))
        return list(tried), [s for s in scores if s is not None]

    def _adopt(self, decision: Decision) -> Gain:
        """Make the winner the base of the next round."""
        best, code = decision.best, decision.best.model.code
        stage = self.gain_between(self.trained, best.trained)
        self.between = decision.between if len(decision.between) > 1 else ()
        self.causes.append(code)
        self.evidence[code] = decision.evidence
        self.gained += best.gain
        self.model, self.trained = best.model, best.trained
        if not self.between:
            self.folds = folds_of(both(self.model, self.masks), self.samples)
        return stage

    def gain_between(self, before: Sequence[Model], after: Sequence[Model]) -> Gain:
        """The gain in free runs over held-out blocks."""
        role = self.first.task.roles.outputs[0]
        motion = self.first.task.drive.motion_unit
        unit = motion if role.endswith("angle") else f"{motion}/s"
        traces = self.first.problem.traces
        i, a, b = blocks_of(traces)[0]
        return gain_of(forecast(before, self.folds), forecast(after, self.folds), unit,
                       (b - a) * traces[i].step, sensor_std(self.model),
                       unexplained_percent(self.gained, remainder(after[0])))

    def rounds_std(self, tried: Sequence[Tried]) -> dict[str, dict[str, float]]:
        """Smallest visible sizes by cause."""
        return {t.candidate.code: t.smallest for t in tried}

    def total_gain(self) -> Gain:
        """From the first base to the last model."""
        gain = self.gain_between(tuple(f.trained for f in self.first_folds), self.trained)
        return replace(gain, unexplained_percent=unexplained_percent(self.gained, self.left))

    @property
    def confident(self) -> bool:
        """Whether little enough is left over for a name to be trusted."""
        return self.left.total <= max(LEFT * self.gained, 10.0)


def sensor_std(model: Model) -> float:
    """Std of the first sensor's white noise, as the model has it."""
    passes = filtered(model.problem, model.point, model.noise, keep=False)
    return float(np.sqrt(spread(passes, everything(model.problem))))


