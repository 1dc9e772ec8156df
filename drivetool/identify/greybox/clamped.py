"""Recordings with a body clamped: tests of the clamp, and start values from such recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.drive import Drive
from drivetool.errors import BadRecording
from drivetool.identify.plateaus import rough_inertia, speed_of
from drivetool.identify.setup import as_recorded, white_std
from drivetool.logs import Experiment
from drivetool.quantity import name_of, quantity_of, record_of

# Mean speed over rms. A drive that swings against a clamp has a mean near zero, one that turns freely a mean near
# the rms; halfway lies a drive that swings as much as it turns.
MAX_MEAN_OVER_RMS = 0.5
# Speed of a clamped body over that of the motor. A choice: a fixture that yields by a twentieth is no clamp.
MAX_CLAMP_MOTION = 0.05
# Times the white noise of its sensor from which a clamped motor oscillates: mains hum and drift are less.
MAX_CLAMPED_NOISE_RATIO = 3.0
DAMPING_RATIOS = (0.01, 0.03, 0.1, 0.3, 0.7)  # of the grid: spaced by a factor of about three, up to aperiodic
FREQUENCIES_PER_OCTAVE = 12  # frequencies of the grid: closer than the half width of a resonance damped by 0.03
MIN_PERIODS = 2.0  # periods in a recording. A choice: with fewer a resonance is not distinguishable from drift
MIN_SAMPLES_PER_PERIOD = 10.0  # in one period at least. A choice: with fewer the held torque distorts the response


def check_clamped(experiment: Experiment, drive: Drive, body: str) -> None:
    """Raise BadRecording where a body that is stated as clamped turns, or the bodies joined to it do."""
    advice = ("Correct --record, or clamp it and record again, with "
              "an alternating torque about a constant one, for some seconds.")
    unit, place = f"{experiment.motion_unit}/s", drive.bodies.index(body)
    motor, own = _speed_of_body(experiment, drive, 0), _speed_of_body(experiment, drive, place)
    if motor is None:
        return
    if place == 0:
        if float(np.nanstd(motor)) > MAX_CLAMPED_NOISE_RATIO * white_std([motor]):
            raise BadRecording(f"{body} at standstill in {experiment.name}, where it is clamped",
                               f"that it oscillates with {np.nanstd(motor):.3g} {unit} rms", advice)
        return
    # The part that follows the motor, without the noise of the sensor.
    share = 0.0 if own is None else drive.gear_ratios()[place] * _following_ratio(own, motor)
    if share > MAX_CLAMP_MOTION:
        raise BadRecording(f"{body} at standstill in {experiment.name}, where it is clamped",
                           f"that it follows {100.0 * share:.2g} % of the motor's motion", advice)
    mean = abs(float(np.nanmean(motor)))
    if mean > MAX_MEAN_OVER_RMS * float(np.sqrt(np.nanmean(motor**2))):
        raise BadRecording(f"a motor that oscillates against the clamped {body} in {experiment.name}",
                           f"one that rotates at {mean:.3g} {unit} on average", advice)


def unidentified_by_clamps(drive: Drive, experiments: Sequence[Experiment]) -> frozenset[str]:
    """The bodies and shafts that no recording identifies: those clamped in all, and those beyond them."""
    as_they_were = [as_recorded(drive, (), e.number)[0] for e in experiments]
    first = next((place for place, body in enumerate(drive.bodies) if place > 0
                  and all(d.value(name_of(body, "clamped")) for d in as_they_were)), len(drive.bodies))
    return frozenset((*drive.bodies[first:], *drive.shafts[first:]))


def with_start_values_from_clamped(drive: Drive, experiments: Sequence[Experiment]) -> Drive:
    """The drive of two bodies with missing start values, from a recording with its load clamped.

    There the motor swings on the shaft like a mass on a spring: frequency, damping and inertia of the best of a
    grid of such systems. Recordings without the clamp give the load's inertia.
    """
    missing = [n for n in drive.missing() if not record_of(n)]
    clamped = [e for e in experiments if len(drive.bodies) == 2
               and as_recorded(drive, (), e.number)[0].value(name_of(drive.bodies[1], "clamped"))]
    if not missing or not clamped:
        return drive
    (motor, load), (shaft,) = drive.bodies, drive.shafts
    swings = [s for e in clamped if (s := clamped_oscillation_of(e)) is not None]
    if not swings:
        return drive
    best, ratio = min(swings, key=lambda s: s.left), drive.value(name_of(shaft, "ratio"))
    inertia = drive.value(name_of(motor, "inertia")) or best.inertia
    found = {name_of(motor, "inertia"): inertia,
             name_of(shaft, "stiffness"): inertia * best.frequency**2 * ratio**2}
    if name_of(shaft, "damping") not in drive.values:
        found[name_of(shaft, "damping")] = 2.0 * best.damping_ratio * best.frequency * inertia * ratio**2
    whole = [rough_inertia(speed_of(e, "motor", "the load's inertia"), e.signals["motor_torque"], e)
             for e in experiments if e not in clamped]
    if any(w > inertia for w in whole):
        found[name_of(load, "inertia")] = (max(whole) - inertia) * ratio**2
    elif not whole:
        found[name_of(load, "inertia")] = inertia * ratio**2  # it does not move: any value does
    return drive.with_values({n: v for n, v in found.items() if n in missing or quantity_of(n) == "damping"})


def with_start_inertia_of_record(drive: Drive, experiments: Sequence[Experiment]) -> Drive:
    """The drive of one body with a missing start inertia, by the mean torque over the mean acceleration."""
    name = name_of(drive.bodies[0], "inertia")
    if len(drive.bodies) > 1 or drive.missing() != [name]:
        return drive
    found = [abs(rough_inertia(speed_of(e, "motor", "the inertia"), e.signals["motor_torque"], e))
             for e in experiments
             if "motor_torque" in e.signals and {"motor_speed", "motor_angle"} & set(e.signals)]
    return drive.with_values({name: max(found)}) if max(found, default=0.0) > 0.0 else drive


@dataclass(frozen=True)
class ClampedOscillation:
    """A mass on a spring: natural frequency [rad/s], damping ratio, inertia; left: mean square of the residual."""

    frequency: float
    damping_ratio: float
    inertia: float
    left: float


def clamped_oscillation_of(experiment: Experiment) -> ClampedOscillation | None:
    """The mass on a spring that explains the motor's speed best; None where none of the grid can be tried.

    For each frequency and damping the response is linear in the compliance and in the start state, so that noise
    does not bias it as it biases an equation between torque and derivatives.
    """
    first, last = max(experiment.segments, key=lambda s: s[1] - s[0])
    torque = experiment.signals["motor_torque"][first:last]
    speed = speed_of(experiment, "motor", "the first values")[first:last]
    known = np.isfinite(speed)
    low = 2.0 * np.pi * MIN_PERIODS / (len(torque) * experiment.step)
    high = 2.0 * np.pi / (MIN_SAMPLES_PER_PERIOD * experiment.step)
    if not low < high or known.mean() < 0.5:
        return None
    found = []
    for frequency in np.geomspace(low, high, round(FREQUENCIES_PER_OCTAVE * np.log2(high / low)) + 1):
        for ratio in DAMPING_RATIOS:
            columns = _responses(frequency, ratio, torque, experiment.step)[known]
            factors = np.linalg.lstsq(columns, speed[known], rcond=None)[0]
            residual = float(np.mean((speed[known] - columns @ factors) ** 2))
            if factors[0] > 0.0:
                found.append(ClampedOscillation(float(frequency), ratio, float(1.0 / factors[0]), residual))
    return min(found, key=lambda s: s.left, default=None)


def _responses(frequency: float, ratio: float, torque: np.ndarray, step: float) -> np.ndarray:
    """(n, 3) speed of a unit inertia on its spring: under the torque, and from a unit start speed and twist."""
    poles = frequency * (-ratio + np.array([1j, -1j]) * np.sqrt(1.0 - ratio**2))
    decay = np.exp(poles * step)
    backward = np.array([1.0, -2.0 * decay[0].real, abs(decay[0]) ** 2])
    # The step response is a difference of exp(p0 t) and exp(p1 t): the filter has its samples at each interval.
    amplitude = ((decay[0] - decay[1]) / (poles[0] - poles[1])).real
    forced = scipy.signal.lfilter([0.0, amplitude, -amplitude], backward, torque - torque[0])
    time = np.arange(len(torque)) * step
    free = np.exp(poles[0] * time)
    return np.column_stack([forced, free.real, free.imag])


def _speed_of_body(experiment: Experiment, drive: Drive, place: int) -> np.ndarray | None:
    """Speed of a body where it, or its angle, was logged."""
    names = [drive.bodies[place]]
    names += ["motor"] if place == 0 else ["load"] if drive.bodies[place] == drive.load else []
    for name in names:
        if {f"{name}_speed", f"{name}_angle"} & set(experiment.signals):
            return speed_of(experiment, name, "the clamp")
    return None


def _following_ratio(own: np.ndarray, motor: np.ndarray) -> float:
    """Speed of a body over that of the motor, by least squares, less three of its standard deviations."""
    known = np.isfinite(own) & np.isfinite(motor)
    x, y = motor[known], own[known]
    if not x @ x > 0.0:
        return 0.0
    share = float(x @ y / (x @ x))
    return abs(share) - 3.0 * float(np.sqrt(np.mean((y - share * x) ** 2) / (x @ x)))
