"""The result of a search: the selected causes, their rivals, and the models that the verdict is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from drivetool.check.faults import Fault
from drivetool.check.fit import Model, ResidualTests, residuals_large, run_residual_tests, sensor_std
from drivetool.check.heldout import (
    Change,
    Fold,
    FreeRuns,
    Split,
    blocks_of,
    gain_of,
    held_out_free_runs,
    over_all_records,
    unexplained_percent,
)
from drivetool.check.outcome import DiagnoseOptions, Gain, Round
from drivetool.finding import Finding
from drivetool.logs import Experiment


@dataclass(frozen=True)
class SelectedCauses:
    """The selected causes.

    causes    codes in the order found
    rivals    cause -> causes that explain the records as well, together with the others
    evidence  cause -> log10 of the evidence
    added     cause -> names of the parameters that it freed
    gained    log likelihood by all of them on data held out
    sure      causes that the held-out blocks confirm beyond their scatter
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
    """The drive without causes: the model over all training samples, and the folds with their own fits."""

    model: Model
    folds: tuple[Fold, ...]

    @property
    def trained(self) -> tuple[Model, ...]:
        """Per fold the model."""
        return tuple(f.trained for f in self.folds)

    @cached_property
    def free_runs(self) -> FreeRuns:
        """Its free runs over the held-out data of its folds: every gain over it needs them."""
        return held_out_free_runs(self.trained, self.folds)


@dataclass(frozen=True)
class SearchResult:
    """The end of a search.

    first    base that gains are stated over, by the fit to all training samples; origin: that the search started
             with, trained in every fold as the causes are, so that the comparison is fair
    model    the last one, over the training samples; whole: over all records
    trained  per fold the last model
    rounds   candidates and selected cause of each round
    left     residual tests of the last model
    unasked  a cause that explains the records but was not requested
    change   parameters that differ in the held-out records
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
    found: SelectedCauses
    rounds: tuple[Round, ...]
    left: ResidualTests
    unasked: str = ""
    change: Change | None = None

    @property
    def folds(self) -> tuple[Fold, ...]:
        """Training and test samples."""
        return self.first.folds

    @property
    def confident(self) -> bool:
        """Whether the residuals are small enough for an identified cause to be trusted."""
        return not residuals_large(self.left.total, self.found.gained)

    def total_gain(self) -> Gain:
        """From the first base to the last model, as it is stated."""
        return self._gain_over(self.first)

    def judged_gain(self) -> Gain:
        """The same from the base that was trained on the same samples as the last model."""
        return self._gain_over(self.origin)

    @cached_property
    def free_runs(self) -> FreeRuns:
        """Free runs of the last model: every gain of it needs them."""
        return held_out_free_runs(self.trained, self.folds)

    def _gain_over(self, base: Base) -> Gain:
        gain = gain_between(base, self.trained, self.split, free_runs=self.free_runs)
        return gain.replace(unexplained_percent=unexplained_percent(self.found.gained, self.left))

    def without_causes(self) -> SearchResult:
        """Back on the first base: the causes worsen the free-run error and are no model of the machine."""
        whole = self.first.folds[0].trained if self.split.held_out else self.first.model
        return replace(self, model=self.first.model, whole=whole, origin=self.first, trained=self.first.trained,
                       found=SelectedCauses(),
                       left=run_residual_tests(whole, self.split.held))


def fitted_to_all(model: Model, split: Split, base: Base) -> Base:
    """A base whose free runs are those of the fit to all training samples, whatever the folds hold out.

    That is what a user has. Fitted to half of the samples it would be biased further by the missing law, and its
    error on the other half would exceed that on a further record.
    """
    whole = over_all_records(model, split)
    return Base(model, tuple(replace(fold, trained=whole) for fold in base.folds))


def gain_between(before: Base, after: Sequence[Model], split: Split, gained: float = 0.0,
                 free_runs: FreeRuns | None = None) -> Gain:
    """The gain in free runs over held-out blocks, from a base to what was trained in its folds.

    gained     log likelihood by all that was found, on held-out data
    free_runs  of the trained models; None: they are computed
    """
    task = before.model.task
    motion = task.drive.motion_unit
    unit = motion if task.roles.outputs[0].endswith("angle") else f"{motion}/s"
    i, a, b = blocks_of(split.traces)[0]
    return gain_of(before.free_runs, free_runs or held_out_free_runs(after, before.folds), unit,
                   (b - a) * split.traces[i].step, sensor_std(after[0]),
                   unexplained_percent(gained, run_residual_tests(after[0], split.held)))
