"""Performance factors of a load-step response, exact in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.tune.optimisation.criteria import signals
from drivetool.tune.speed_loop import Loop, Modes, Settings

SETTLING_BAND = 0.05  # of the first peak: the usual 5 % settling time


@dataclass(frozen=True)
class SpeedFactors:
    """A speed after a unit step of load torque.

    peak           largest speed error before its first change of sign [speed per torque]
    impact_drop    largest |integral of the error| [angle per torque]
    overshoot      opposite peak over first peak [%]
    settling_time  last time outside 5 % of the first peak [s]
    ie, ise, iae   integrals of error, squared error and |error| for a unit step
    """

    peak: float
    impact_drop: float
    overshoot: float
    settling_time: float
    ie: float
    ise: float
    iae: float


@dataclass(frozen=True)
class Factors:
    """Both speeds, and the overshoot of each motor's torque over its final value [%]."""

    motor: SpeedFactors
    load: SpeedFactors
    torque_overshoot: Mapping[str, float]


def factors(loop: Loop, settings: Settings) -> Factors:
    """Performance factors of a stable loop.

    source  Tallfors 2005, sec. 2.2
    """
    torques = {motor: f"{motor}_torque" for motor in loop.wiring.motors}
    found = signals(loop, settings, ("motor_speed", "load_speed", *torques.values()))
    return Factors(speed_factors(found["motor_speed"]), speed_factors(found["load_speed"]),
                   {motor: torque_overshoot(found[name]) for motor, name in torques.items()})


def speed_factors(speed: Modes) -> SpeedFactors:
    """Of a speed error that starts from zero and decays."""
    (iae, drop), (_, values) = speed.integrals_and_extrema
    first, opposite = peaks(values)
    pairs = -(speed.rates[:, None] + speed.rates[None, :])
    return SpeedFactors(
        first, float(drop), 100.0 * opposite / first, speed.last_outside(SETTLING_BAND * first),
        float(abs((speed.weights / speed.rates).sum().real)),
        float((speed.weights[:, None] * speed.weights / pairs).sum().real), float(iae))


def peaks(values: np.ndarray) -> tuple[float, float]:
    """(largest excursion before the first change of sign, largest of the opposite sign)."""
    sign = np.sign(values[0])
    turned = np.flatnonzero(sign * values < 0.0)
    first = np.max(sign * values[:turned[0]] if len(turned) else sign * values)
    return float(first), float(max(0.0, np.max(-sign * values)))


def torque_overshoot(torque: Modes) -> float:
    """Largest torque beyond its final value, in % of it."""
    values = torque.integrals_and_extrema[1][1]
    if not len(values) or abs(torque.rest) < 1e-12 * np.max(np.abs(values)):
        return 0.0
    return float(max(0.0, 100.0 * np.max(values / torque.rest)))
