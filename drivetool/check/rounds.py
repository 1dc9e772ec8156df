"""The rounds of a diagnosis: every cause on top of what was found, judged by data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.check.afresh import at_start, beside_gap, likelier, returned, strayed
from drivetool.check.afterwards import SPOILT, doubts_again, drop_needless, look_alikes_again
from drivetool.check.arrival import all_arrived
from drivetool.check.between_records import Change, change_between
from drivetool.check.causes import CAUSES, FITTED, mistaken_for
from drivetool.check.causes.cause import Cause
from drivetool.check.decide import LEFT, Decision, decide
from drivetool.check.diagnosis import DiagnoseOptions, Gain, Round
from drivetool.check.folds import blocks_of
from drivetool.check.forecast import exact, forecast, gain_of, unexplained_percent
from drivetool.check.found import Found
from drivetool.check.heldout import Score, both, folds_of, in_one_place, score, total_evidence
from drivetool.check.hypothesis import (
    TRIFLE,
    Tried,
    also,
    as_special_case,
    attempt,
    place_of,
    polished,
    sizeable,
    without,
)
from drivetool.check.imitation import imitates
from drivetool.check.model import Model, at_rest, fit, heard_afresh, judge, sensor_std, whitened
from drivetool.check.needless import NESTED
from drivetool.check.parts import with_parts
from drivetool.check.preflight import Fault
from drivetool.check.remainder import Remainder, faked, is_coarse, remainder
from drivetool.check.samples import fitted_samples, held_out
from drivetool.check.story import results_of
from drivetool.errors import Finding
from drivetool.identify.setup import traces_of
from drivetool.logs.experiment import Experiment
from drivetool.progress import counted

WORKERS = 2
REFITS = 2  # of the base, from where causes took its parameters
JUDGED = 8  # causes that are judged on held-out samples, the likeliest first
CHANCE = 0.15  # of the best gain, below which a cause cannot come out as good as the best
LITTLE = 0.2  # of what was gained before, below which a cause may make up for an inexact law
DOUBLED = 2.0  # of that error, beyond twice its scatter, from which it is no law, however likely steps become
RUINED = 10.0  # the same, whatever its scatter
AGAINST = "free runs over data held out become worse with it"
ONE_PLACE = "nearly all that it gains on data held out lies in one place"
FAKED = 0.5  # of what a cause gains, that it may gain on records of the base logged in the same steps
STEPS = "the steps of the logger would show as much"


class Search:
    """The rounds of a diagnosis; `run` goes through them."""

    def __init__(self, base: Model, wanted: Sequence[str], options: DiagnoseOptions,
                 samples: Sequence, faults: Sequence[Fault], train: Sequence[Experiment]):
        self.first, self.options, self.samples, self.faults = base, options, samples, list(faults)
        # A law that contains another one gains where the other is true: that is tried too, asked for or not.
        special = {code for c in wanted for code in NESTED.get(c, ())}
        self.candidates = [c for c in FITTED if c.code in {*wanted, *special}]
        self.asked, self.unasked, self.possible = frozenset(wanted), "", frozenset(CAUSES)
        self.masks, self.train, self.held = fitted_samples(samples), tuple(train), held_out(samples)
        self.origin = base
        self.stand_on(base)
        self.first_folds = self.folds
        self.notes: tuple[Finding, ...] = ()
        self.begun: Mapping[str, float] = {}
        self.found = Found()
        self.rounds: list[Round] = []
        self.left = Remainder(0.0, 0.0, 0.0)
        self.change: Change | None = None  # what records held out ask for
        self.trained = tuple(f.trained for f in self.folds)
        self.ends: Mapping[str, Model] = {}  # further ends of fits, from which the next round may start

    def stand_on(self, model: Model) -> None:
        """Make a model the base of what comes: `bases` under every noise that is possible for it, and the folds."""
        self.model, self.bases = model, both(model, self.masks)
        self.folds = folds_of(self.bases, self.samples)

    def begin_with(self, base: Model) -> None:
        """State gains over this base instead: it lacks what the record itself gave away."""
        self.first, self.first_folds = base, folds_of(both(base, self.masks), self.samples)

    def run(self) -> Search:
        """All rounds, until nothing more is found; further ones where a cause turned out another one by then.

        None where free runs of the base leave rounding alone.
        """
        if exact(self.model):
            return self
        self._rounds()
        drop_needless(self)
        if doubts_again(self):
            drop_needless(self)
            self.rounds = [one for one in self.rounds if one.cause]
            self._rounds()
        self.change = change_between(self.model, self.folds)
        return self

    def _rounds(self) -> None:
        """Round by round, until nothing more is found."""
        for number in range(len(self.rounds), self.options.rounds + 1):
            budget = self.options.error_budget * 0.5 ** (number + 1)
            tried = self.attempts()
            if number == 0 and strayed(self.model, self.begun):
                tried = self._afresh(tried)
            if self._improve(tried):
                tried = self.attempts({t.candidate.code: t for t in tried})
            scores = self.judged(tried)
            decision = decide(scores, budget, self.found.gained, imitates)
            if decision.best is not None:
                scores = self._doubted(scores, decision.best)
                decision = decide(scores, budget, self.found.gained, imitates)
                scores = self.with_doubles(tried, scores, decision)
                decision = decide(scores, budget, self.found.gained, imitates)
            decision, stage, against = self._foretelling(decision, scores, budget)
            last = number == self.options.rounds
            asked = [t for t in tried if t.candidate.code in self.asked]
            results = tuple(replace(r, reason=against.get(r.code, r.reason)) for r in results_of(
                asked, scores, decision, self.model, self.found.gained))
            if decision.best is not None and decision.best.model.code not in self.asked:
                self.unasked = decision.best.model.code
            if decision.best is None or last or self.unasked:
                stage = None
            else:
                self._adopt(decision, scores)
            self.rounds.append(Round(self.found.causes[-1] if stage else None, results, stage))
            self.left = remainder(self.model, self.held)
            if stage is None:
                break
            self.stand_on(self.model)
            look_alikes_again(self)

    def with_doubles(self, tried: Sequence[Tried], scores: Sequence[Score], decision: Decision) -> list[Score]:
        """The scores, and those of causes that look like the ones decided for but were not to be looked for."""
        unseen = (mistaken_for(decision.between) & self.possible) - {t.candidate.code for t in tried}
        if not unseen:
            return list(scores)
        return [*scores, *self.judged(self.attempts(among=[c for c in FITTED if c.code in unseen]))]

    def _afresh(self, tried: Sequence[Tried]) -> list[Tried]:
        """The causes, those that are likelier so from the values that the base was once started from.

        First under the torque noise that the base has there, which may be so loud that it bends again what is
        fitted; then, where they ended bent, once more under the noise that they have themselves.
        """
        again = self.attempts(stand=at_start(self.model, self.begun, self.masks))
        tried = [likelier(one, other, self.model) for one, other in zip(tried, again, strict=True)]
        likely = [t for t in self._likely(tried) if t.absent is None]
        with ThreadPoolExecutor(WORKERS) as pool:
            models = list(pool.map(lambda t: returned(t.model, self.begun, self.masks), likely))
        back = {t.candidate.code: replace(t, models=(m, *t.models[1:]))
                for t, m in zip(likely, models, strict=True)}
        return [back.get(t.candidate.code, t) for t in tried]

    def attempts(self, before: Mapping[str, Tried] | None = None, among: Sequence[Cause] = (),
                 stand: Model | None = None) -> list[Tried]:
        """Every cause on top of the base; those that have a chance after a few steps are fitted to the end.

        among  the causes; none: all that are to be tried
        stand  what they are put on top of; None: the base
        """
        before, among, stand = before or {}, among or self.candidates, stand or self.model
        begun = self.begun if self.found.causes else {}
        with ThreadPoolExecutor(WORKERS) as pool:
            tried = [also(t, self.ends.get(t.candidate.code)) for t in counted(
                f"round {len(self.rounds) + 1}: causes tried", pool.map(
                    lambda c: attempt(c, stand, self.masks, before.get(c.code)), among), len(among))]
            likely = self._likely(tried, promised=True, over=stand)
            fitted = counted(f"round {len(self.rounds) + 1}: causes fitted", pool.map(
                lambda t: beside_gap(polished(t, self.masks, stand), begun, self.masks), likely), len(likely))
            fitted = all_arrived(list(fitted), stand, self.masks, pool)
            ends = self._with_special_cases(fitted, tried)
            sized = dict(zip(ends, pool.map(lambda t: sizeable(t, self.model, self.masks), ends.values()),
                             strict=True))
        return [sized.get(t.candidate.code, t) for t in tried]

    def _with_special_cases(self, tried: Iterable[Tried], given_up: Sequence[Tried] = ()) -> dict[str, Tried]:
        """The causes by code, each no less likely than a law that contains it makes it.

        given_up  causes after a few steps: a special case among them may have lost its way in these
        """
        ends = {t.candidate.code: t for t in tried}
        known = {**{t.candidate.code: t for t in given_up}, **ends}
        for code in [c for c in ends if c in NESTED]:
            for simple in [c for c in NESTED[code] if c in known]:
                found = as_special_case(known[simple], ends[code], self.masks)
                if simple in ends or found is not known[simple]:
                    ends[simple] = found
        return ends

    def _likely(self, tried: Sequence[Tried], promised: bool = False, over: Model | None = None) -> list[Tried]:
        """The causes that gain on what they were fitted to, and not far less than the best, the likeliest first.

        promised  before they are fitted to the end: what a linear step promises counts too
        over      the model that they gain on; None: the base
        """
        least = (over or self.model).value
        gains = {t.candidate.code: max(least - t.model.value, t.promise if promised else -np.inf)
                 for t in tried if t.model is not None}
        least = max(TRIFLE, CHANCE * max(gains.values(), default=0.0))
        likely = [t for t in tried if gains.get(t.candidate.code, -np.inf) > least]
        return sorted(likely, key=lambda t: -gains[t.candidate.code])[:JUDGED]

    def _improve(self, tried: Sequence[Tried]) -> bool:
        """Refit the base from where the likeliest causes took its parameters; whether that is better.

        A base that has not reached its optimum makes every cause look like a discovery.
        """
        before = self.model.value
        for t in self._likely(tried)[:REFITS]:
            trial = without(t.model, self.model, self.masks, self.model.value)
            if trial.value < self.model.value - 0.5:
                self.model = trial
        if self.model.value > before - TRIFLE:
            return False
        self.stand_on(self.model)
        return True

    def _under_other_noise(self, model: Model) -> Model:
        """The model under torque noise that remembers, if the base has that too, or forgets, if it is likelier so.

        Slow torque noise may be what the base took the cause for.
        """
        if model.noise.memory is not None:
            return min(model, whitened(model, self.masks), key=lambda m: m.value)
        memory = [f.trained.noise for f in self.folds if f.trained.noise.memory is not None]
        if not memory:
            return model
        trial = fit(model.code, model.task, model.problem, model.point, memory[0], self.masks, rounds=3)
        return trial if trial.value < model.value else model

    def _doubted(self, scores: Sequence[Score], best: Score) -> list[Score]:
        """The scores against a base that was also fitted from where the best cause took its parameters."""
        lower = []
        for fold, own in zip(self.folds, best.trained, strict=True):
            # Under the noise that the cause was judged with, if that remembers.
            base = self.model if own.noise.memory is None else replace(self.model, noise=own.noise)
            trial = without(own, base, fold.again)
            reached = judge(trial.problem, trial.point, trial.noise, fold.test)
            lower.append(max(fold.best - reached, 0.0) if np.isfinite(reached) else 0.0)
        return [replace(s, evidence=tuple(e - d for e, d in zip(s.evidence, lower, strict=True))) for s in scores]

    def judged(self, tried: Sequence[Tried]) -> list[Score]:
        """Held-out scores of the likeliest causes."""
        likely = [t for t in self._likely(tried) if t.absent is None]
        least = min(f.value for f in (self.model, *self.bases))

        def heard(t: Tried) -> Tried | None:
            try:
                model = self._under_other_noise(t.model)
                changed = replace(t, models=(model,))
                lost = model is not t.model and sizeable(changed, self.model, self.masks).absent
                return None if lost else changed
            except (np.linalg.LinAlgError, FloatingPointError):
                return None

        def one(t: Tried) -> Score | None:
            try:
                found = score(t.model, self.folds)
                return replace(found, lead=least - found.model.value,
                               further=len(t.model.task.free) - len(self.model.task.free))
            except (np.linalg.LinAlgError, FloatingPointError):
                return None

        with ThreadPoolExecutor(WORKERS) as pool:
            ends = self._with_special_cases(t for t in pool.map(heard, likely) if t is not None)
            scores = list(counted(f"round {len(self.rounds) + 1}: causes judged on data held out",
                                  pool.map(one, ends.values()), len(ends)))
        return [s for s in scores if s is not None]

    def _foretelling(self, decision: Decision, scores: Sequence[Score],
                     budget: float) -> tuple[Decision, Gain | None, dict[str, str]]:
        """(the decision without causes that data held out speak against, gain of the best, those and why).

        A law that gains little beside those before it, and mends single steps but spoils the run, or gains in one
        place only, makes up for what they are not exact in; one that records made up without it show as well makes
        up for the steps of the logger. What ties with it must then be found by itself.
        """
        against: dict[str, str] = {}
        tied = [s for s in scores if s.model.code in decision.between]
        # One that was asked for first, where that is as good as one that was not.
        for s in sorted(tied, key=lambda s: (s.model.code not in self.asked, -s.gain)):
            if against and total_evidence([s], self.found.gained) < np.log(1.0 / budget):
                continue
            stage, code = self.gain_between(self.trained, s.trained, s.gain), s.model.code
            change = stage.held_out_rmse_after - stage.held_out_rmse_before
            worse = change > max(SPOILT * stage.held_out_rmse_before, stage.rmse_bar)
            why = AGAINST if worse else ONE_PLACE if in_one_place(s, self.model) else ""
            ruined = (stage.held_out_rmse_after > RUINED * stage.held_out_rmse_before
                      or change > max((DOUBLED - 1.0) * stage.held_out_rmse_before, 2.0 * stage.rmse_bar))
            why = AGAINST if ruined else why if s.gain < LITTLE * self.found.gained else ""
            if self.made_of_steps(s, stage):
                why = STEPS
            if not why:
                between = tuple(c for c in decision.between if c not in against)
                return replace(decision, best=s, between=between), stage, against
            against[code] = why
        return replace(decision, best=None, between=()), None, against

    def made_of_steps(self, one: Score, stage: Gain) -> bool:
        """Whether a cause may be what the steps of the logger make of a record, and nothing else.

        Records of the base, logged in the same steps, would show much of it, or free runs are no better for it.
        """
        better = stage.held_out_rmse_before - stage.held_out_rmse_after
        return is_coarse(self.model) and (
            better < stage.rmse_bar or faked(self.model, one.model, self.masks) > FAKED * one.lead)

    def _adopt(self, decision: Decision, scores: Sequence[Score]) -> None:
        """Make the winner the base of the next round."""
        best, before = decision.best, self.model.task.free
        places = {s.model.code: place for s in scores if s.model.code in decision.between
                  and (place := place_of(s.model)) is not None}
        self.ends = {}  # they lack what is adopted now
        rested = heard_afresh(returned(at_rest(best.model, self.masks), self.begun, self.masks), self.masks)
        self.trained = best.trained
        rested, gain = self._with_others(rested, best.gain)
        added = [n for n in rested.task.free if n not in before]
        self.found.take(best.model.code, decision, added, gain, places)
        # Across a gap, say, friction of the motor and of the load are no longer the same.
        self.model = with_parts(rested, self.masks)

    def _with_others(self, model: Model, gain: float) -> tuple[Model, float]:
        """(the model with all of the kind that the records ask for and data held out agree to; its gain)."""
        another = CAUSES[model.code].another
        while another is not None and (more := another(model, self.masks)) is not None:
            known = score(more, self.folds)
            stage = self.gain_between(self.trained, known.trained)
            if known.gain < gain or stage.held_out_rmse_after > (1.0 + SPOILT) * stage.held_out_rmse_before:
                break
            model, gain, self.trained = more, known.gain, known.trained
        return model, gain

    def leave_out(self, experiments: Sequence[Experiment], findings: Sequence[Finding]) -> None:
        """Take records in place of those of the last model, if there are findings about what they lack."""
        if not findings:
            return
        self.faults += [Fault("outliers", f) for f in findings]
        self.train = tuple(experiments[:len(self.train)])
        task = replace(self.model.task, experiments=tuple(experiments))
        traces = traces_of(experiments, task.roles)
        self.model = replace(self.model, task=task, problem=replace(self.model.problem, traces=traces))

    def gain_between(self, before: Sequence[Model], after: Sequence[Model], brought: float = 0.0) -> Gain:
        """The gain in free runs over held-out blocks.

        brought  log likelihood on data held out, beside what was found before
        """
        role = self.first.task.roles.outputs[0]
        motion = self.first.task.drive.motion_unit
        unit = motion if role.endswith("angle") else f"{motion}/s"
        traces = self.first.problem.traces
        i, a, b = blocks_of(traces)[0]
        return gain_of(forecast(before, self.folds), forecast(after, self.folds), unit,
                       (b - a) * traces[i].step, sensor_std(after[0]),
                       unexplained_percent(self.found.gained + brought, remainder(after[0])))

    def total_gain(self) -> Gain:
        """From the first base to the last model."""
        gain = self.gain_between(tuple(f.trained for f in self.first_folds), self.trained)
        return replace(gain, unexplained_percent=unexplained_percent(self.found.gained, self.left))

    def give_up(self) -> None:
        """Stand on the first base again: what was found spoils free runs, and is nobody's model of the machine."""
        self.model, self.trained = self.first, tuple(f.trained for f in self.first_folds)
        self.found, self.left = Found(), remainder(self.first, self.held)
        self.change = change_between(self.model, self.first_folds)

    @property
    def confident(self) -> bool:
        """Whether little enough is left over for a name to be trusted."""
        return self.left.total <= max(LEFT * self.found.gained, 10.0)
