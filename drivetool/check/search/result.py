"""What a search hands over: the causes found, what rivals them, and the models that the verdict is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from drivetool.check.faults import Fault
from drivetool.check.fit import Model, Remainder, much_left, remainder, sensor_std
from drivetool.check.heldout import (
    Change,
    Fold,
    Forecast,
    Split,
    blocks_of,
    extended,
    forecast,
    gain_of,
    unexplained_percent,
)
from drivetool.check.outcome import DiagnoseOptions, Gain, Round
from drivetool.errors import Finding
from drivetool.logs import Experiment


@dataclass(frozen=True)
class Found:
    """The causes found.

    causes    codes in the order found
    rivals    cause -> what explains the records as well, beside the others
    evidence  cause -> log10 of the evidence
    added     cause -> names of the parameters that it freed
    gained    log likelihood by all of them on data held out
    sure      causes that data held out tell by blocks
    """

    causes: tuple[str, ...] = ()
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    evidence: Mapping[str, float] = field(default_factory=dict)
    added: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    gained: float = 0.0
    sure: frozenset[str] = frozenset()

    @property
    def between(self) -> tuple[str, ...]:
        """The causes that have rivals, and those, in the order found."""
        return tuple(dict.fromkeys(c for code in self.causes for c in (code, *self.rivals.get(code, ()))
                                   if self.rivals.get(code)))


@dataclass(frozen=True)
class Base:
    """The drive without causes: the model over all training samples, the folds, and what trained in them."""

    model: Model
    folds: tuple[Fold, ...]

    @property
    def trained(self) -> tuple[Model, ...]:
        """Per fold the model."""
        return tuple(f.trained for f in self.folds)

    @cached_property
    def foretold(self) -> Forecast:
        """Its free runs over what its folds have not seen: every gain over it asks for them."""
        return forecast(self.trained, self.folds)


@dataclass(frozen=True)
class Searched:
    """The end of a search.

    first    base that gains are stated over, by the fit to all training samples; origin: that the search began
             with, trained in every fold as the causes are, so that like is judged by like
    model    the last one, over the training samples; whole: over all records
    trained  per fold the last model
    rounds   what was tried and found
    left     what the last model leaves
    unasked  what explains the records but was not to be looked for
    change   what records held out ask for
    """

    split: Split
    options: DiagnoseOptions
    faults: tuple[Fault, ...]
    notes: tuple[Finding, ...]
    train: tuple[Experiment, ...]
    first: Base
    origin: Base
    model: Model
    whole: Model
    trained: tuple[Model, ...]
    found: Found
    rounds: tuple[Round, ...]
    left: Remainder
    unasked: str = ""
    change: Change | None = None

    @property
    def folds(self) -> tuple[Fold, ...]:
        """Training and test samples."""
        return self.first.folds

    @property
    def confident(self) -> bool:
        """Whether little enough is left over for a name to be trusted."""
        return not much_left(self.left.total, self.found.gained)

    def total_gain(self) -> Gain:
        """From the first base to the last model, as it is stated."""
        return self._gain_over(self.first)

    def judged_gain(self) -> Gain:
        """The same from the base that was trained on the same samples as the last model."""
        return self._gain_over(self.origin)

    @cached_property
    def foretold(self) -> Forecast:
        """Free runs of the last model: every gain of it asks for them."""
        return forecast(self.trained, self.folds)

    def _gain_over(self, base: Base) -> Gain:
        gain = gain_between(base, self.trained, self.split, foretold=self.foretold)
        return replace(gain, unexplained_percent=unexplained_percent(self.found.gained, self.left))

    def given_up(self) -> Searched:
        """On the first base again: what was found spoils free runs, and is nobody's model of the machine."""
        whole = self.first.folds[0].trained if self.split.held_out else self.first.model
        return replace(self, model=self.first.model, whole=whole, origin=self.first, trained=self.first.trained,
                       found=Found(),
                       left=remainder(whole, self.split.held))


def fitted_to_all(model: Model, split: Split, base: Base) -> Base:
    """A base whose free runs are those of the fit to all training samples, whatever the folds hold out.

    That is what a user has. Fitted to half of the samples it would bend further for the law that it lacks, and err
    more on the other half than on a further record.
    """
    whole = extended(model, split)
    return Base(model, tuple(replace(fold, trained=whole) for fold in base.folds))


def gain_between(before: Base, after: Sequence[Model], split: Split, gained: float = 0.0,
                 foretold: Forecast | None = None) -> Gain:
    """The gain in free runs over held-out blocks, from a base to what was trained in its folds.

    gained    log likelihood by all that was found, on data held out
    foretold  free runs of what was trained; None: they are made
    """
    task = before.model.task
    motion = task.drive.motion_unit
    unit = motion if task.roles.outputs[0].endswith("angle") else f"{motion}/s"
    i, a, b = blocks_of(split.traces)[0]
    return gain_of(before.foretold, foretold or forecast(after, before.folds), unit,
                   (b - a) * split.traces[i].step, sensor_std(after[0]),
                   unexplained_percent(gained, remainder(after[0], split.held)))
