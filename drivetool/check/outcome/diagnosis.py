"""What diagnose is asked and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from drivetool.identify.estimate import Estimate, Exhibit, Parameter

Verdict = Literal["nothing-found", "named", "undetermined", "unexplained"]
BETWEEN = 1.75  # factor by which what a base errs for want of a cause differs between records, docs/evidence
TOLD = 2.0  # standard errors of a gain, from which the scatter of its blocks adds nothing to that
UNLISTED = "unlisted"  # among causes that it could be: something that is in no catalogue
LOUD = 5.0  # sensor noises of error in free runs, from which a torque noise that large is to be said
REST = 0.25  # of the error before, from which on what is left is much
IMPLAUSIBLE = 0.03  # of the torque's spread, from which a noise of the torque may be a law that is missing
State = Literal["named", "possible", "worse", "no-gain", "not-shown", "in-the-model", "failed"]


@dataclass(frozen=True)
class DiagnoseOptions:
    """Options of a diagnosis.

    candidates    codes to try; empty: the whole catalogue
    error_budget  share of records without a cause on which one may be named, over all rounds
    rounds        most causes that are looked for
    seed          of everything random
    criterion     simulation: free runs of the motion judge; inverse: the torque that the motion asks for
    """

    candidates: tuple[str, ...] = ()
    error_budget: float = 0.01
    rounds: int = 3
    seed: int = 1
    criterion: Literal["simulation", "inverse"] = "simulation"


@dataclass(frozen=True)
class CandidateResult:
    """One cause that was tried in one round.

    code       of the catalogue; law: the equation in the words of the field
    state      named; possible: as good as the best; worse: gains, but less than the best; no-gain;
               not-shown: this record cannot show it; in-the-model already; failed
    gain       log likelihood gained on data held out, gain_std its standard error; None if not fitted
    evidence   log10 of one over the share of records without any cause on which as much would be found
    smallest   smallest size that this record would have shown, by parameter, in its unit; None: unknown
    parameters its values on the whole record, with intervals
    reason     in words: why there is no gain to state, or where it was seen
    sure       whether blocks of data held out tell that there is a gain
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


@dataclass(frozen=True)
class Gain:
    """How much better the model predicts, in free runs of `segment` seconds over data held out.

    rmse_before, rmse_after  of the first output, in `unit`; fit_*: percent. Before: by the base as it was fitted to
                             all samples that are no judges; after: by what was fitted without the samples it meets
    rmse_std                 standard error of the difference before - after, from the scatter over blocks
    rmse_bar                 what such a difference is weighed against: standard error of the difference of the mean
                             squares over the sum of both errors; rmse_std where the errors differ little, and up to
                             twice it where nearly all of the error goes
    noise_floor              std of the sensor alone, as far as the record tells
    unexplained_percent      share of what the base left unexplained that is still there
    blocks                   of data held out, one free run each
    of                       motion: as said; torque: the errors are those of the torque that the motion asks
                             for, over blocks of `segment` seconds
    """

    unit: str
    segment: float
    held_out_rmse_before: float
    held_out_rmse_after: float
    held_out_fit_before: float
    held_out_fit_after: float
    rmse_std: float
    rmse_bar: float
    noise_floor: float
    unexplained_percent: float
    blocks: int = 0
    of: Literal["motion", "torque"] = "motion"

    @property
    def on_a_fresh_record(self) -> tuple[float, float] | None:
        """95 % interval of before - after on a further record of this length; None where nothing scatters.

        What the worse of both models errs beyond the better is no noise: it depends on what the record asks of the
        machine, by a factor. Errors add as squares. Where blocks hardly tell that there is a gain, their scatter
        counts besides, on the further record as much as on this one, by a standard error that is itself estimated
        from so many (Student's t): distances of both limits are added as squares then, side by side (Zou and
        Donner, Statistics in Medicine 27, 2008, 1693).
        """
        if self.blocks < 2 or not self.rmse_std > 0.0:
            return None
        told = abs(self.held_out_rmse_before - self.held_out_rmse_after) > TOLD * self.rmse_std
        blocks = 0.0 if told else float(stdtrit(self.blocks - 1, 0.975)) * np.sqrt(2.0) * self.rmse_std
        low, high = sorted((self.held_out_rmse_before, self.held_out_rmse_after))
        beyond = np.sqrt(high**2 - low**2)
        ends = [float(np.hypot(low, beyond * factor)) - low for factor in (1.0 / BETWEEN, BETWEEN)]
        better = self.held_out_rmse_before - self.held_out_rmse_after
        if better < 0.0:
            ends = [-ends[1], -ends[0]]
        return (better - float(np.hypot(blocks, better - ends[0])),
                better + float(np.hypot(blocks, ends[1] - better)))


def taken_for_noise(before: float, after: float, floor: float, share: float, loud: float = LOUD) -> bool:
    """Whether a noise of the torque that is hardly one stands in for much of what was there.

    Then a law that is in no catalogue may hide behind it: one-step errors cannot tell the two apart.

    before, after  rms errors of free runs; floor: of the sensor alone; loud: times that which `after` must exceed
    share          std of the torque's noise over the spread of the torque
    """
    return after > loud * floor and after > REST * before and share > IMPLAUSIBLE


@dataclass(frozen=True)
class Round:
    """One round: what was looked for on top of what had been found, and what was decided.

    cause  the code that was added to the model, or None where the round ended the search
    """

    cause: str | None
    candidates: tuple[CandidateResult, ...]
    gain: Gain | None = None


@dataclass(frozen=True)
class Facts:
    """Figures that the rules of a verdict compare, and the names that it hands on; see `FACTS` for their meanings.

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
    closest     where it is unexplained, what the extended drive has of the catalogue: part of the answer, maybe
    experiment  what would decide, or what would show a smaller effect
    evidence    log10 of the evidence for every cause
    gain        from the base to the extended drive
    sentence    the verdict for a plant engineer
    rule        the line of the table of rules that decided, facts: what it was held against
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
    exhibits: tuple[Exhibit, ...] = ()
    closest: tuple[str, ...] = ()
    rule: str = ""
    facts: Facts = Facts()
