"""The options and the result of tune."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance
from drivetool.tune.optimisation import Criterion, Factors, FigureSpread, TuneLimits, Variation, criterion
from drivetool.tune.simulation import DisturbanceResponse
from drivetool.tune.speed_loop import Configuration, DeadTimeForm, MarginsSection, Settings, Wiring


@dataclass(frozen=True)
class Ratings:
    """The base of per-unit figures: torque [drive's unit], speed of the first motor [drive's unit]."""

    torque: float
    speed: float


@dataclass(frozen=True)
class TuneOptions:
    """The requirements on the settings.

    criterion        minimised; limits: constraints
    configurations   requested; None: siso for one motor, for two all that are possible
    motors           driven bodies; None: those whose name begins with motor
    speed_filter     of the controller, behind the sensor's own filter [s]
    speed            of the first motor at the working point [drive's unit]
    dead_time        form of the dead time, see loop.Wiring
    shaft_torque     whether the torque in the last shaft is measured, which mimo needs
    confidence       share of the draws in which the sensitivity limit must hold; None: nominal
    draws, seed      of the covariance
    known, stds      covariance and single standard deviations of the parameters
    ratings          None: no per-unit figures
    unidentified     name -> reason of values that no recording identifies
    """

    criterion: Criterion = field(default_factory=lambda: criterion("IAE"))
    limits: TuneLimits = field(default_factory=TuneLimits)
    configurations: tuple[Configuration, ...] | None = None
    motors: tuple[str, ...] | None = None
    speed_filter: float = 0.0
    speed: float = 0.0
    dead_time: DeadTimeForm = "exact"
    shaft_torque: bool = False
    confidence: float | None = None
    draws: int = 200
    seed: int = 1
    known: Covariance | None = None
    stds: Mapping[str, float] = field(default_factory=dict)
    ratings: Ratings | None = None
    unidentified: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Design:
    """One controller and its figures.

    value       of the criterion, for a unit step of load torque
    active      active limit at the optimum: sensitivity, gain, confidence, or nothing (interior)
    spread      None where no parameter has an uncertainty
    kept        share of fresh draws in which the limit holds; None without a robust design
    watches     simulated kicks of the nonlinear drive, one per load state; empty if it is linear
    safe_gain   largest Kp, at this Ti, that is stable at every effective stiffness of a gap; None
                if there is no gap or the gain is below it
    """

    wiring: Wiring
    settings: Settings
    value: float
    active: str
    factors: Factors
    margins: MarginsSection
    variations: tuple[Variation, ...]
    spread: FigureSpread | None = None
    kept: float | None = None
    watches: tuple[DisturbanceResponse, ...] = ()
    safe_gain: float | None = None


@dataclass(frozen=True)
class Gains:
    """The tuned controllers; several configurations of a tandem side by side.

    options  as used
    """

    drive: Drive
    designs: tuple[Design, ...]
    options: TuneOptions
    outcome: str
    findings: tuple[Finding, ...] = ()
    exhibits: tuple[object, ...] = ()

    @property
    def best(self) -> Design:
        """The design with the smallest criterion."""
        return min(self.designs, key=lambda each: each.value)
