"""The options and the result of diagnose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from drivetool.check.outcome.sections import GainSection, State, Verdict
from drivetool.identify.estimate import Estimate, Parameter, PlotData

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


@dataclass(frozen=True)
class CandidateResult:
    """One cause that was tested in one round.

    code       of the catalogue; law: its equation
    state      named; possible: as good as the best; worse: gains, but less than the best; no-gain;
               not-shown: not identifiable from this record; in-the-model already; failed
    gain       log likelihood gained on held-out data; gain_std: its standard error; None if not fitted
    evidence   log10 of one over the share of records without any cause on which as much would be found
    smallest   detection limit of this record, by parameter, in its unit; None: unknown
    parameters its values on the whole record, with intervals
    reason     in words: why there is no gain, or in which records it is
    sure       whether the gain is significant by the held-out blocks
    """

    code: str
    law: str
    state: State
    gain: float | None = None
    gain_std: float | None = None
    evidence: float | None = None
    smallest: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    reason: str = ""
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
        blocks = 0.0 if significant else float(stdtrit(self.blocks - 1, 0.975)) * np.sqrt(2.0) * self.rmse_std
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


@dataclass(frozen=True)
class Round:
    """One round: the causes tested on top of those found before, and the decision.

    cause  the code that was added to the model, or None where the round ended the search
    """

    cause: str | None
    candidates: tuple[CandidateResult, ...]
    gain: Gain | None = None


@dataclass(frozen=True)
class Facts:
    """Numbers that the rules of a verdict compare, and the causes it reports; see `FACTS` for their meanings.

    Log likelihoods are natural; errors of free runs are in the unit of the gain.
    """

    faults: tuple[str, ...] = ()
    by_model: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    between: tuple[str, ...] = ()
    strongest: str = ""
    hardly: tuple[str, ...] = ()
    unasked: str = ""
    gained: float = 0.0
    left: float = 0.0
    left_time: float = 0.0
    repeats: bool = False
    before: float = 1.0
    after: float = 1.0
    scatter: float = 0.0
    floor: float = 0.0
    by_noise: float | None = None
    left_percent: float = 0.0
    torque_noise: float = 0.0
    load_changes: int = 0
    by_speed: float | None = None
    other_values: bool = False

    def plain(self) -> dict[str, object]:
        """By name, as files have them."""
        return {n: list(v) if isinstance(v, tuple) else v for n, v in asdict(self).items()}


@dataclass(frozen=True)
class Diagnosis:
    """The outcome.

    estimate    the extended and refitted drive; the base where nothing was found
    verdict     nothing-found, named, undetermined (see between) or unexplained
    causes      codes in the order found; between: codes that explain the record equally well
    closest     where it is unexplained, the catalogue causes of the extended drive: perhaps part of the answer
    experiment  the experiment that would decide, or detect a smaller effect
    evidence    log10 of the evidence for every cause
    gain        from the base to the extended drive
    sentence    the verdict for a plant engineer
    rule        the line of the table of rules that decided; facts: the numbers it compared
    """

    estimate: Estimate
    verdict: Verdict
    causes: tuple[str, ...]
    between: tuple[str, ...]
    experiment: str
    evidence: Mapping[str, float]
    gain: Gain
    rounds: tuple[Round, ...]
    sentence: str
    exhibits: tuple[PlotData, ...] = ()
    closest: tuple[str, ...] = ()
    rule: str = ""
    facts: Facts = Facts()
