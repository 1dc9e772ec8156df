"""What a user may ask of an estimator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from drivetool.identify.estimate import Covariance
from drivetool.identify.setup.start import Start

Criterion = Literal["auto", "innovations", "simulation", "frequency", "inverse"]
Method = Literal["speeds", "acceleration", "coast-down"]
Weighting = Literal["variance", "coherence"]


@dataclass(frozen=True)
class Options:
    """Options of every estimator; each uses what concerns it.

    hold       parameter names that keep their value
    free       parameter names that are fitted although they would be held
    criterion  greybox and backlash: auto chooses among explanations of the record; innovations, simulation,
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
    start      greybox and backlash: what is known of the state in which every recording begins
    known      covariance of the values that the parameter files bring, so that the interval of
               what is fitted includes the uncertainty of what is held
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    criterion: Criterion = "auto"
    starts: int | None = None
    segment: float | None = None
    seed: int = 1
    structure: str | None = None
    order: int | None = None
    noise_order: int | None = None
    weighting: Weighting = "variance"
    band: tuple[float, float] | None = None
    method: Method = "speeds"
    flux_decay: float | None = None
    stages: tuple[tuple[float, float], ...] = ()
    start: Start = field(default_factory=Start)
    known: Covariance | None = None
