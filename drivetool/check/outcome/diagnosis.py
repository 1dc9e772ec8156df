"""The options and the result of diagnose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy
from msgspec import Meta

from drivetool.check.outcome.sections import (
    CandidateSection,
    DiagnosisSection,
    GainSection,
    RoundSection,
    State,
)
from drivetool.identify.estimate import Estimate, Parameter, PlotData
from drivetool.results import Shape

# Factor at 95 % by which the error of a base that lacks a cause differs between records
# (docs/explanation/diagnosis.md).
ERROR_RATIO_BETWEEN_RECORDS = 1.75
# Standard errors of a gain (about 95 %), from which the scatter of its blocks is not added.
SIGNIFICANT_GAIN_STDS = 2.0
OUTSIDE_CATALOGUE = "unlisted"  # among the possible causes: one that is in no catalogue
# Free-run error over sensor noise, from which an implausible torque noise is reported (a choice).
LARGE_ERROR_TO_NOISE = 5.0
LARGE_REMAINING_SHARE = 0.25  # of the error before, from which the remaining error is large (a choice)
# Of the torque's standard deviation, from which torque noise may be a missing law (a choice)
IMPLAUSIBLE_NOISE_SHARE = 0.03


@dataclass(frozen=True)
class DiagnoseOptions:
    """Options of a diagnosis.

    candidates    codes to try; empty: the whole catalogue
    error_budget  share of records without a cause on which one may be named, over all rounds
    rounds        most causes that are searched
    seed          of everything random
    criterion     simulation: free-run error of the motion; inverse: error of the required torque
    """

    candidates: tuple[str, ...] = ()
    error_budget: float = 0.01
    rounds: int = 3
    seed: int = 1
    criterion: Literal["simulation", "inverse"] = "simulation"


class CandidateResult(CandidateSection, kw_only=True):
    """One cause that was tested in one round; a file has its round, and whether the record can show it.

    state      named; possible: as good as the best; worse: gains, but less than the best; no-gain;
               not-shown: not identifiable from this record; in-the-model already; failed
    sure       whether the gain is significant by the held-out blocks
    """

    parameters: dict[str, Parameter] = {}
    sure: bool = True


class Gain(GainSection):
    """A gain with what its interval follows from; in memory `rmse_gain_ci95` is not set.

    rmse_bar  reference for the difference of the errors: standard error of the difference of the mean squares over
              the sum of both errors; rmse_std where the errors differ little, and up to twice it where nearly all
              of the error is removed
    blocks    of held-out data, one free run each
    """

    rmse_bar: float = 0.0
    blocks: int = 0

    @property
    def further_record_interval(self) -> tuple[float, float] | None:
        """95 % interval of before - after on a further record of this length; None where nothing scatters.

        The excess error of the worse model is no noise: it depends on the excitation of the record, by a factor.
        Errors add as squares. Where the gain is not significant by its blocks, their scatter counts as well, on the
        further record as on this one, with a standard error estimated from so few (Student's t): the distances of
        the limits are then added as squares, each side separately (Zou and Donner, Statistics in Medicine 27,
        2008, 1693).
        """
        if self.blocks < 2 or not self.rmse_std > 0.0:
            return None
        significant = abs(
            self.held_out_rmse_before - self.held_out_rmse_after) > SIGNIFICANT_GAIN_STDS * self.rmse_std
        wide = float(scipy.special.stdtrit(self.blocks - 1, 0.975)) * np.sqrt(2.0) * self.rmse_std
        blocks = 0.0 if significant else wide
        low, high = sorted(map(float, (self.held_out_rmse_before, self.held_out_rmse_after)))
        excess = np.sqrt(high**2 - low**2)
        ends = [float(np.hypot(low, excess * factor)) - low
                for factor in (1.0 / ERROR_RATIO_BETWEEN_RECORDS, ERROR_RATIO_BETWEEN_RECORDS)]
        better = self.held_out_rmse_before - self.held_out_rmse_after
        if better < 0.0:
            ends = [-ends[1], -ends[0]]
        return (better - float(np.hypot(blocks, better - ends[0])),
                better + float(np.hypot(blocks, ends[1] - better)))


def noise_hides_law(before: float, after: float, floor: float, share: float,
                    min_error_to_noise: float = LARGE_ERROR_TO_NOISE) -> bool:
    """Whether an implausible torque noise replaces much of the free-run error.

    Then it may hide a law that is in no catalogue: one-step prediction errors do not separate the two.

    before, after       rms errors of free runs; floor: sensor noise
    share               std of the torque noise over the standard deviation of the torque
    min_error_to_noise  times the floor that `after` must exceed
    """
    return (after > min_error_to_noise * floor and after > LARGE_REMAINING_SHARE * before
            and share > IMPLAUSIBLE_NOISE_SHARE)


class Round(RoundSection, kw_only=True):
    """One round: the causes tested on top of those found before, and the decision."""

    candidates: tuple[CandidateResult, ...] = ()
    gain: Gain | None = None

    def with_states(self, states: Mapping[str, State]) -> Round:
        """The round with other states of some causes, by code."""
        return self.replace(candidates=tuple(
            c.replace(state=states.get(c.code, c.state)) for c in self.candidates))


class Facts(Shape):
    """Numbers that the rules of a verdict compare, and the causes it reports.

    Log likelihoods are natural; errors of free runs are in the unit of the gain.
    """

    faults: Annotated[tuple[str, ...], Meta(description="causes that lie in the records")] = ()
    by_model: Annotated[tuple[str, ...], Meta(
        description="faults identifiable only with the fitted drive, which may lack an effect")] = ()
    causes: Annotated[tuple[str, ...], Meta(description="laws that were found")] = ()
    between: Annotated[tuple[str, ...], Meta(description="laws found that have rivals, and the rivals")] = ()
    strongest: Annotated[str, Meta(description="the law with the largest evidence")] = ""
    hardly: Annotated[tuple[str, ...], Meta(
        description="laws with a gain on held-out blocks below two standard errors, except clear events")] = ()
    unasked: Annotated[str, Meta(
        description="a cause that explains the records but was not among the requested candidates")] = ""
    gained: Annotated[float, Meta(description="log likelihood gained on held-out data")] = 0.0
    left: Annotated[float, Meta(description="log likelihood that the residual tests of the one-step prediction "
                                            "errors gain beyond chance")] = 0.0
    left_time: Annotated[float, Meta(
        description="the same by separate parameters for each half of the records")] = 0.0
    repeats: Annotated[bool, Meta(
        description="whether one-step prediction errors of the last fit are correlated")] = False
    before: Annotated[float, Meta(description="rms free-run error on held-out data without the laws found, fitted "
                                              "to the same samples")] = 1.0
    after: Annotated[float, Meta(description="rms free-run error on held-out data with the laws found")] = 1.0
    scatter: Annotated[float, Meta(
        description="uncertainty of the difference of these errors, from their scatter over blocks")] = 0.0
    floor: Annotated[float, Meta(description="noise of the sensor alone, in the same unit")] = 0.0
    by_noise: Annotated[float | None, Meta(description="free-run error that the model's own noise causes; none "
                                                       "where the noise cannot mask a law")] = None
    left_percent: Annotated[float, Meta(description="`left` in per cent of what could be explained")] = 0.0
    torque_noise: Annotated[float, Meta(description="std of the torque noise over the std of the torque")] = 0.0
    load_changes: Annotated[int, Meta(description="instants at which a load changes")] = 0
    by_speed: Annotated[float | None, Meta(description="share of these loads' variance that a function of speed "
                                                       "explains; none with fewer than two")] = None
    other_values: Annotated[bool, Meta(description="whether held-out records need other parameter values")] = False


class Diagnosis(DiagnosisSection, kw_only=True):
    """The outcome; its candidates are those of its rounds.

    estimate    the extended and refitted drive; the base where nothing was found
    verdict     nothing-found, named, undetermined (see between) or unexplained
    facts       the numbers that the rule compared
    """

    estimate: Estimate
    gain: Gain
    rounds: tuple[Round, ...]
    facts: Facts = Facts()
    exhibits: tuple[PlotData, ...] = ()
