"""Where a drive runs without torque, and where it is still driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.identify.plateaus import block_means, speed_of
from drivetool.identify.setup import supply_of, white_std
from drivetool.logs import Experiment, true_runs
from drivetool.logs.samples import MAD_PER_STD, quantisation_step

# Standard deviations of the torque's white noise: chance exceeds them once in a million samples.
OFF_TORQUE_STDS = 5.0
# Quantisation steps or noise standard deviations of the sensor that a coast-down moves at least, or of its speed:
# with less the drive may stand.
MIN_MOTION_STEPS = 5.0
# Share of its speed that a drive without torque loses at least: controllers hold it within less, and friction
# takes more of it in any record that identifies friction.
MIN_SPEED_LOSS = 0.01
MIN_COAST_DOWN_SAMPLES = 50  # samples of a stretch: fewer have no shape that separates two frictions
# Means of the speed that locate the beginning where no torque was logged. A choice: 0.5 % of a record.
SPEED_BLOCKS = 200
# Share of the highest speed below which a drive without a logged torque is assumed to coast down: a controller
# holds the speed before within 1 %, and little of the coast-down is lost.
START_SPEED_SHARE = 0.98
# Share of a power of two, within which a jump is the range of a counter of so many bits. A choice.
COUNTER_TOLERANCE = 0.01
# Times the deceleration before, by which a speed falls to zero that its sensor or a brake ends: friction that rises
# before standstill reaches twice or three times the Coulomb friction, and a speed runs down continuously.
MIN_DROP_FACTOR = 5.0
DROP_NOISE_LAGS = 20  # of the upper half of the speed, in its third differences: longer than a filter remembers


@dataclass(frozen=True)
class Stretch:
    """Samples first to last of a recording, by its number in a list; off: no torque acts.

    dropped  speed from which it drops to zero; what follows is left out; 0 where it runs down continuously
    """

    recording: int
    first: int
    last: int
    off: bool
    dropped: float = 0.0


def stretches_of(experiments: Sequence[Experiment], decay: float) -> list[Stretch]:
    """Stretches without torque, each after the flux has decayed, and those under torque before them.

    decay   time after switching off that is left out [s]
    raises  NotEnoughData: none without torque, or none that moves; BadRecording: a counter starts again
    """
    for e in experiments:
        _refuse_counter_wrap(e)
    found = [s for i, e in enumerate(experiments) for s in _stretches_of_record(i, e, decay) if _moves(e, s)]
    if not any(s.off for s in found):
        raise NotEnoughData(
            "a stretch in which the drive coasts down without torque",
            f"none in {', '.join(e.name for e in experiments)}",
            "Switch the drive off at speed and record until it stands. Where it was driven, check the channel of "
            "its torque; if no torque is logged, cut the record to the coast-down with "
            "--condition 'keep from=2 to=8'.")
    return found


def driving_input(experiment: Experiment) -> np.ndarray | None:
    """(n,) input that drives the motor: the voltage of its supply, or its torque; None: neither was logged."""
    supply = supply_of(experiment)
    return experiment.signals.get("motor_torque") if supply is None else supply


def find_coast_downs(experiments: Sequence[Experiment]) -> list[Stretch]:
    """The stretches without torque in which the drive coasts down."""
    return [s for i, e in enumerate(experiments) for s in _stretches_of_record(i, e, 0.0) if s.off and _moves(e, s)]


def _refuse_counter_wrap(experiment: Experiment) -> None:
    """Refuse an angle that jumps where its counter starts again: the fit would take every jump for motion."""
    for finding in experiment.findings:
        if finding.code == "value-wraps" and finding.evidence.get("role") == "motor_angle":
            size = float(finding.evidence["size"])
            whole = 2.0 ** round(np.log2(size))
            wrap = f"{whole:.0f}" if abs(size - whole) < COUNTER_TOLERANCE * whole else f"{size:.4g}"
            raise BadRecording(
                "an unwrapped angle",
                f"motor_angle of {experiment.name} jumps by {size:.6g}",
                f"Write `wrap: {wrap}`, in the unit of its channel, for motor_angle in the channel map; or record "
                "with a counter of more digits.")


def _moves(experiment: Experiment, stretch: Stretch) -> bool:
    """Whether a stretch moves by some quantisation steps or noise stds, and without torque becomes slower."""
    role = "motor_angle" if "motor_angle" in experiment.signals else "motor_speed"
    y = experiment.signal(role, "the coast-down")[stretch.first:stretch.last]
    threshold = MIN_MOTION_STEPS * max(quantisation_step(y) if role == "motor_angle" else 0.0, white_std([y]))
    if not (np.nanmax(y) - np.nanmin(y) if role == "motor_angle" else abs(np.nanmean(y))) > threshold:
        return False
    tenth, known = len(y) // 10, np.flatnonzero(np.isfinite(y))
    head, tail = (known[(known >= a) & (known < b)] for a, b in ((0, tenth), (len(y) - tenth, len(y))))
    if not stretch.off or min(len(head), len(tail)) < 2:
        return not stretch.off
    first_speed, last_speed = ((y[k[-1]] - y[k[0]]) / (k[-1] - k[0]) if role == "motor_angle" else y[k].mean()
                    for k in (head, tail))
    return bool(abs(last_speed) < (1.0 - MIN_SPEED_LOSS) * abs(first_speed))


def _stretches_of_record(number: int, experiment: Experiment, decay: float) -> list[Stretch]:
    """The stretches of one recording."""
    skip, acts = int(np.ceil(decay / experiment.step)), driving_input(experiment)
    found: list[Stretch] = []
    for a, b in experiment.segments:
        first = a if acts is not None else _start_of_coast_down(experiment, a, b)
        for begin, end, off in _on_and_off(np.zeros(b - first) if acts is None else acts[a:b]):
            # At the beginning of a record with its torque, the time since switching off is not known.
            start = first + begin + (skip if off and (begin > 0 or acts is None) else 0)
            if first + end - start >= MIN_COAST_DOWN_SAMPLES:
                found.append(_before_drop(Stretch(number, start, first + end, off), experiment))
    return found


def _before_drop(stretch: Stretch, experiment: Experiment) -> Stretch:
    """The part of a coast-down before its speed drops to zero; the whole of one that runs down, or never rests.

    Between its last values and rest the speed must fall much faster than in any part before: friction stops a drive
    continuously, a sensor below its lowest speed and a brake do not.
    """
    speed = np.abs(experiment.signals.get("motor_speed", np.empty(0))[stretch.first:stretch.last])
    known = np.flatnonzero(np.isfinite(speed))
    if not stretch.off or "motor_angle" in experiment.signals or len(known) < MIN_COAST_DOWN_SAMPLES:
        return stretch
    v = speed[known]
    upper = int(np.flatnonzero(v >= 0.5 * v.max())[-1]) + 1
    noise = OFF_TORQUE_STDS * _noise_std(v[:upper], max(upper // DROP_NOISE_LAGS, 1))
    rest = len(v) - int(np.argmax(v[::-1] > noise))
    fall = (v[:rest] - 2.0 * noise) / np.arange(rest, 0, -1)  # noise of the speed, and of what counts as rest
    last = int(np.argmax(fall >= 0.5 * fall.max()))
    apart = np.arange(last, MIN_COAST_DOWN_SAMPLES - 1, -1)
    before = np.max((v[:len(apart)] - v[last] + noise) / apart, initial=0.0)
    if rest == len(v) or len(apart) == 0 or fall.max() <= MIN_DROP_FACTOR * before:
        return stretch
    return replace(stretch, last=stretch.first + int(known[last]) + 1, dropped=float(v[last]))


def _on_and_off(torque: np.ndarray) -> list[tuple[int, int, bool]]:
    """(first, last + 1, off) of the parts of a torque (n,), off for MIN_COAST_DOWN_SAMPLES samples or more."""
    off = np.abs(torque) <= OFF_TORQUE_STDS * _noise_std(torque)
    for first, last in true_runs(off):
        off[first:last] = last - first >= MIN_COAST_DOWN_SAMPLES
    ends = np.flatnonzero(np.diff(np.concatenate([[2], off.astype(int), [2]])))
    return [(int(first), int(last), bool(off[first])) for first, last in pairwise(ends)]


def _noise_std(values: np.ndarray, lag: int = 1) -> float:
    """Standard deviation of the noise in (n,), robust against steps and outliers: third differences by a lag."""
    v = [values[k * lag:len(values) - (3 - k) * lag] for k in range(4)]
    third = np.abs(v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0])
    return float(np.nanmedian(third)) / (MAD_PER_STD * np.sqrt(20.0)) if len(third) else 0.0


def _start_of_coast_down(experiment: Experiment, a: int, b: int) -> int:
    """The sample from which the speed has left its highest value for good."""
    speed = np.abs(speed_of(experiment, "motor", "the coast-down")[a:b])
    size = max(1, (b - a) // SPEED_BLOCKS)
    means = block_means(speed, size)
    high = np.flatnonzero(means >= START_SPEED_SHARE * np.nanmax(means))
    return a + int(high[-1] + 1) * size if len(high) else a
