"""Options of the estimators."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from drivetool.identify.estimate import Covariance
from drivetool.identify.setup.start import KnownStart

Criterion = Literal["auto", "innovations", "simulation", "frequency", "inverse"]
Method = Literal["speeds", "acceleration", "coast-down"]
Weighting = Literal["variance", "coherence"]
# Of every recording, left out of a fit to compare fits by it. A choice, usual in cross-validation: more leaves too
# little to fit, less too little to compare.
HELD_OUT_SHARE = 0.3
STEP_SPECIFIC = {"of_one_step": True}  # of a field: result files list it only where it differs from its default


@dataclass(frozen=True)
class Options:
    """Options of every estimator; each uses what concerns it.

    hold       parameter names that keep their value
    free       parameter names that are fitted although they would be held
    criterion  greybox and backlash: auto chooses among candidate fits of the record; innovations, simulation,
               frequency and inverse are one each
    starts     starting points tried when the problem may have several optima; None: the
               estimator decides
    segment    length [s] of the segments with free start states of a simulation-error
               fit; None: the estimator decides; 0: one free run over each record
    seed       of everything random
    structure  blackbox: a polynomial structure (oe, bj, arx, armax, innovations); None: the
               third-order model in continuous time. order: of its dynamics, None to choose by
               held-out score; noise_order: of its noise, None for two
    weighting  of a fit in the frequency domain: by the measured variance (maximum likelihood), or by
               coherence over frequency
    band       (low, high) Hz of a fit in the frequency domain; None: where the record is excited
    method     steady: speeds, from intervals of constant speed; acceleration, from those of constant torque;
               coast-down, from running down without torque. flux_decay: time after switching off that a coast-down
               leaves out [s]. stages: of a coast-down, windows (high, low) of the speed [motion unit/s] that are
               fitted one after the other
    start      greybox and backlash: known states in which every recording begins
    known      covariance of the values in the parameter files, so that the intervals of fitted
               parameters include the uncertainty of held ones
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    criterion: Criterion = "auto"
    starts: int | None = None
    segment: float | None = None
    seed: int = 1
    structure: str | None = field(default=None, metadata=STEP_SPECIFIC)
    order: int | None = field(default=None, metadata=STEP_SPECIFIC)
    noise_order: int | None = field(default=None, metadata=STEP_SPECIFIC)
    weighting: Weighting = field(default="variance", metadata=STEP_SPECIFIC)
    band: tuple[float, float] | None = field(default=None, metadata=STEP_SPECIFIC)
    method: Method = field(default="speeds", metadata=STEP_SPECIFIC)
    flux_decay: float | None = field(default=None, metadata=STEP_SPECIFIC)
    stages: tuple[tuple[float, float], ...] = field(default=(), metadata=STEP_SPECIFIC)
    start: KnownStart = field(default_factory=KnownStart)
    known: Covariance | None = None
