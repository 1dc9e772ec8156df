"""Recordings with a body clamped: what contradicts the clamp, and the first values that such a recording gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from drivetool.drive import AT, Drive
from drivetool.errors import BadRecording
from drivetool.identify.plateaus import rough_inertia, speed_of
from drivetool.identify.setup import as_recorded, white_std
from drivetool.logs import Experiment

# A drive that swings against a clamp turns to and fro: its mean speed is what its angle changed by over the record.
# Of one that turns freely the mean is near the rms. Halfway lies a drive that swings as much as it turns.
TURNS = 0.5
# Speed of a clamped body over that of the motor: a brake or fixture that gives way by a twentieth is none.
GIVES_WAY = 0.05
MOVES = 3.0  # times the white noise of its sensor, by which a clamped motor swings: hum and drift are less
DAMPING_RATIOS = (0.01, 0.03, 0.1, 0.3, 0.7)  # that are tried: a factor of about three apart, up to aperiodic
PER_OCTAVE = 12  # frequencies that are tried: closer than the half width of a resonance damped by 0.03
LEAST_SWINGS = 2.0  # within a recording, below which a resonance does not show
SAMPLES = 10.0  # in one swing, above which it does


def check_clamped(experiment: Experiment, drive: Drive, body: str) -> None:
    """Raise BadRecording where a body that is said to be clamped turns, or what is joined to it does."""
    do = "Correct --record, or clamp it and record again: torque to and fro about a constant one, for some seconds."
    unit, place = f"{experiment.motion_unit}/s", drive.bodies.index(body)
    motor, own = _speed(experiment, drive, 0), _speed(experiment, drive, place)
    if motor is None:
        return
    if place == 0:
        if float(np.nanstd(motor)) > MOVES * white_std([motor]):
            raise BadRecording(f"{body} at standstill in {experiment.name}, where it is clamped",
                               f"that it swings by {np.nanstd(motor):.3g} {unit} rms", do)
        return
    # What follows the motor, and not the noise of a sensor that hardly sees anything.
    share = 0.0 if own is None else drive.turns()[place] * _follows(own, motor)
    if share > GIVES_WAY:
        raise BadRecording(f"{body} at standstill in {experiment.name}, where it is clamped",
                           f"that it follows {100.0 * share:.2g} % of the motor's motion", do)
    mean = abs(float(np.nanmean(motor)))
    if mean > TURNS * _rms(motor):
        raise BadRecording(f"a motor that swings against the clamped {body} in {experiment.name}",
                           f"one that turns on at {mean:.3g} {unit} on average", do)


def always_clamped(drive: Drive, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """The bodies that are clamped in all of the recordings."""
    as_they_were = [as_recorded(drive, (), e.number)[0] for e in experiments]
    return tuple(b for b in drive.bodies if all(d.value(f"{b}.clamped") for d in as_they_were))


def beyond_clamps(drive: Drive, experiments: Sequence[Experiment]) -> frozenset[str]:
    """The bodies and shafts of which no recording shows anything: what is clamped in all, and what lies beyond."""
    places = [drive.bodies.index(b) for b in always_clamped(drive, experiments)]
    first = min((p for p in places if p > 0), default=len(drive.bodies))
    return frozenset((*drive.bodies[first:], *drive.shafts[first:]))


def with_first_values(drive: Drive, experiments: Sequence[Experiment]) -> Drive:
    """The drive of two bodies with what it lacks to begin a fit, where a recording has its load clamped.

    There the motor swings on the shaft like a mass on a spring: frequency, damping and inertia of the best of a
    grid of such systems. Recordings without the clamp give the load's inertia.
    """
    missing = [n for n in drive.missing() if AT not in n]
    clamped = [e for e in experiments if len(drive.bodies) == 2
               and as_recorded(drive, (), e.number)[0].value(f"{drive.bodies[1]}.clamped")]
    if not missing or not clamped:
        return drive
    (motor, load), (shaft,) = drive.bodies, drive.shafts
    swings = [s for e in clamped if (s := swing_of(e)) is not None]
    if not swings:
        return drive
    best, ratio = min(swings, key=lambda s: s.left), drive.value(f"{shaft}.ratio")
    inertia = drive.value(f"{motor}.inertia") or best.inertia
    found = {f"{motor}.inertia": inertia, f"{shaft}.stiffness": inertia * best.frequency**2 * ratio**2}
    if f"{shaft}.damping" not in drive.values:
        found[f"{shaft}.damping"] = 2.0 * best.damping_ratio * best.frequency * inertia * ratio**2
    whole = [rough_inertia(speed_of(e, "motor", "the load's inertia"), e.signals["motor_torque"], e)
             for e in experiments if e not in clamped]
    if any(w > inertia for w in whole):
        found[f"{load}.inertia"] = (max(whole) - inertia) * ratio**2
    elif not whole:
        found[f"{load}.inertia"] = inertia * ratio**2  # it does not move: any value does
    return drive.with_values({n: v for n, v in found.items() if n in missing or n.endswith(".damping")})


@dataclass(frozen=True)
class Swing:
    """A mass on a spring: natural frequency [rad/s], damping ratio, inertia; left: mean square that it leaves."""

    frequency: float
    damping_ratio: float
    inertia: float
    left: float


def swing_of(experiment: Experiment) -> Swing | None:
    """The mass on a spring that explains the motor's speed best; None where none of the grid can be tried.

    For each frequency and damping the response is linear in the compliance and in the start state, so that noise
    does not bend it as it does an equation between torque and derivatives.
    """
    first, last = max(experiment.segments, key=lambda s: s[1] - s[0])
    torque = experiment.signals["motor_torque"][first:last]
    speed = speed_of(experiment, "motor", "the first values")[first:last]
    known = np.isfinite(speed)
    low = 2.0 * np.pi * LEAST_SWINGS / (len(torque) * experiment.step)
    high = 2.0 * np.pi / (SAMPLES * experiment.step)
    if not low < high or known.mean() < 0.5:
        return None
    found = []
    for frequency in np.geomspace(low, high, round(PER_OCTAVE * np.log2(high / low)) + 1):
        for ratio in DAMPING_RATIOS:
            columns = _responses(frequency, ratio, torque, experiment.step)[known]
            factors = np.linalg.lstsq(columns, speed[known], rcond=None)[0]
            left = float(np.mean((speed[known] - columns @ factors) ** 2))
            if factors[0] > 0.0:
                found.append(Swing(float(frequency), ratio, float(1.0 / factors[0]), left))
    return min(found, key=lambda s: s.left, default=None)


def _responses(frequency: float, ratio: float, torque: np.ndarray, step: float) -> np.ndarray:
    """(n, 3) speed of a unit inertia on its spring: under the torque, and from a unit start speed and twist."""
    poles = frequency * (-ratio + np.array([1j, -1j]) * np.sqrt(1.0 - ratio**2))
    decay = np.exp(poles * step)
    backward = np.array([1.0, -2.0 * decay[0].real, abs(decay[0]) ** 2])
    # A step of torque answers with exp(p0 t) and exp(p1 t) in a difference: its samples, one apart, are the filter.
    answer = ((decay[0] - decay[1]) / (poles[0] - poles[1])).real
    forced = lfilter([0.0, answer, -answer], backward, torque - torque[0])
    time = np.arange(len(torque)) * step
    free = np.exp(poles[0] * time)
    return np.column_stack([forced, free.real, free.imag])


def _speed(experiment: Experiment, drive: Drive, place: int) -> np.ndarray | None:
    """Speed of a body where it, or its angle, was logged."""
    names = [drive.bodies[place]]
    names += ["motor"] if place == 0 else ["load"] if drive.bodies[place] == drive.load else []
    for name in names:
        if {f"{name}_speed", f"{name}_angle"} & set(experiment.signals):
            return speed_of(experiment, name, "the clamp")
    return None


def _follows(own: np.ndarray, motor: np.ndarray) -> float:
    """Speed of a body over that of the motor, by least squares, less three of its standard deviations."""
    known = np.isfinite(own) & np.isfinite(motor)
    x, y = motor[known], own[known]
    if not x @ x > 0.0:
        return 0.0
    share = float(x @ y / (x @ x))
    return abs(share) - 3.0 * float(np.sqrt(np.mean((y - share * x) ** 2) / (x @ x)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
