"""Intervals of constant torque, in which a drive accelerates or coasts, without the oscillation after a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
import scipy

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.identify.plateaus import block_means, speed_of, steady_intervals
from drivetool.logs import Experiment, true_runs

# Of a span: in each the speed is a straight line except for oscillation; a curvature leaves 1/625 of itself.
SPAN_PIECES = 25
MIN_PIECE_SAMPLES = 8  # samples of a piece: two for a straight line and six degrees of freedom for its scatter
# Scatter about its line, over that of the second half, up to which a piece has no oscillation. Six degrees of
# freedom exceed it by chance in one of fifty pieces, which costs a few samples; an oscillation of the noise's size
# does not pass.
MAX_SCATTER_RATIO = 1.5
# Share of the largest torque, by which levels differ: a sensor's error of 0.1 % is then 5 % of the inertia.
MIN_TORQUE_DIFFERENCE = 0.02
MIN_SPEED_CHANGE = 0.05  # of the fastest speed, by which some span must change it: less is a constant speed
ACCELERATION_ADVICE = (
    "Accelerate at constant torque from standstill or a low speed to a high one, and let the drive coast down, "
    "some seconds each.")


@dataclass(frozen=True)
class Span:
    """An interval of constant torque.

    recording    index of its recording
    first, last  samples, after the transient
    torque       mean; slope: (m,) of the speed in its pieces; speed: (m,) mean of each
    """

    recording: int
    first: int
    last: int
    torque: float
    slope: np.ndarray
    speed: np.ndarray


def spans_of(experiments: Sequence[Experiment]) -> list[Span]:
    """The intervals of constant torque of all recordings.

    raises  NotEnoughData: none, one level of torque only, or a speed that does not change; BadRecording: no signed
            torque, no speed
    """
    found = [span for k, e in enumerate(experiments) for span in _spans_of_recording(k, e)]
    wanted = "intervals of constant torque in which the speed changes"
    if not found:
        raise NotEnoughData(wanted, f"none in {', '.join(e.name for e in experiments)}", ACCELERATION_ADVICE)
    torques = np.array([s.torque for s in found])
    size = float(np.abs(torques).max())
    if np.ptp(torques) <= MIN_TORQUE_DIFFERENCE * size:
        raise NotEnoughData(
            "constant torques of two sizes, for example an accelerating one and zero",
            f"only {torques.mean():.4g} {experiments[0].torque_unit}",
            f"One level alone identifies ratios, not the mass. {ACCELERATION_ADVICE}")
    fastest = max(float(np.abs(s.speed).max()) for s in found)
    if max(float(np.ptp(s.speed)) for s in found) < MIN_SPEED_CHANGE * fastest:
        raise NotEnoughData(wanted, f"constant speeds, up to {fastest:.4g} {experiments[0].motion_unit}/s",
                            "Leave --method out: steady speeds identify the friction. "
                            f"For the mass: {ACCELERATION_ADVICE}")
    return found


def first_values(spans: Sequence[Span]) -> dict[str, float]:
    """inertia, viscous, idle_torque and coulomb by least squares of torque over slope and speed of all pieces.

    Accurate enough as start values. In one direction the idle torque includes the Coulomb friction.

    raises  BadRecording: the larger torque accelerates less
    """
    slope, speed = (np.concatenate([getattr(s, n) for s in spans]) for n in ("slope", "speed"))
    torque = np.concatenate([np.full(len(s.slope), s.torque) for s in spans])
    columns = {"inertia": slope, "viscous": speed, "idle_torque": np.ones(len(slope))}
    if turns_both_ways(spans):
        columns["coulomb"] = np.sign(speed)
    factors = np.linalg.lstsq(np.column_stack(list(columns.values())), torque, rcond=None)[0]
    found = dict(zip(columns, factors.tolist(), strict=True))
    if found["inertia"] <= 0.0:
        raise BadRecording("a speed that rises faster under a larger torque", "one that rises slower or falls",
                           "Check that torque and speed are of one axis, and the sign of both in the channel map.")
    return {"coulomb": 0.0, **found} | {n: max(found.get(n, 0.0), 0.0) for n in ("viscous", "coulomb")}


def p_of_common_line(spans: Sequence[Span]) -> float:
    """p-value of one friction line for the slopes of all spans, against their scatter about separate lines.

    An F test: slope over torque, speed and direction, with a constant for each recording, against a line over the
    speed for each span.
    """
    recordings = sorted({s.recording for s in spans})
    separate, scaled, weights = 0.0, [], []
    for s in spans:
        line = np.column_stack([np.ones(len(s.speed)), s.speed])
        residual = s.slope - line @ np.linalg.lstsq(line, s.slope, rcond=None)[0]
        std = float(np.sqrt(residual @ residual / max(len(residual) - 2, 1)))
        std = max(std, 1e-9 * float(np.abs(s.slope).max()) + 1e-300)
        separate += float(residual @ residual) / std**2
        columns = [np.full(len(s.speed), s.torque), s.speed, np.sign(s.speed),
                   *(np.full(len(s.speed), float(s.recording == r)) for r in recordings)]
        scaled.append(np.column_stack(columns) / std)
        weights.append(s.slope / std)
    rows, right = np.concatenate(scaled), np.concatenate(weights)
    size = np.linalg.norm(rows, axis=0)
    factors, _, rank, _ = np.linalg.lstsq(rows / size, right, rcond=1e-9)
    common = float(np.sum((right - rows / size @ factors) ** 2))
    more, free = 2 * len(spans) - int(rank), len(right) - 2 * len(spans)
    if more <= 0 or free <= 0:
        return 1.0
    return float(scipy.stats.f.sf(max(common - separate, 0.0) / more / (separate / free), more, free))


def turns_both_ways(spans: Sequence[Span]) -> bool:
    """Whether there are spans of either direction."""
    return len({float(np.sign(s.speed.mean())) for s in spans}) > 1


def block_averages_of_spans(experiment: Experiment, spans: Sequence[Span], length: int) -> Experiment:
    """The recording with the spans as its only stretches and the motor alone, as means over blocks of samples."""
    signals = {role: np.concatenate([block_means(experiment.signals[role][s.first:s.last], length) for s in spans])
               for role in ("motor_torque", "motor_speed", "motor_angle") if role in experiment.signals}
    edges = accumulate(((s.last - s.first) // length for s in spans), initial=0)
    return replace(experiment, step=experiment.step * length, others=(), begins=False, signals=signals,
                   segments=tuple(pairwise(edges)))


def _spans_of_recording(place: int, experiment: Experiment) -> list[Span]:
    """The spans of one recording that are long enough for a slope."""
    why = "the intervals of constant torque"
    torque, speed = experiment.signed("motor_torque", why), speed_of(experiment, "motor", why)
    found = []
    whole = [_extended_interval(torque, a, b, experiment.segments)
             for a, b in steady_intervals([torque], experiment.segments)[0]]
    for first, last in dict.fromkeys(whole):  # two parts of one interval have the same ends
        for a, b in _one_direction_parts(speed, first, last):
            size = (b - a) // SPAN_PIECES
            if size < MIN_PIECE_SAMPLES:
                continue
            lines = [_fit_line(speed[i:i + size], experiment.step) for i in range(a, a + SPAN_PIECES * size, size)]
            slope, mean, scatter = (np.array(each) for each in zip(*lines, strict=True))
            usual = float(np.nanmedian(scatter[SPAN_PIECES // 2:]))
            oscillating = np.flatnonzero(~(scatter <= MAX_SCATTER_RATIO * usual))
            begin = next((k for k in range(SPAN_PIECES) if k not in oscillating), SPAN_PIECES)
            # The next piece is left out too, for the rest of the oscillation. Block means later average a lasting
            # one.
            begin = min(begin + 1 if begin else 0, SPAN_PIECES // 2)
            known = np.isfinite(slope[begin:])
            if known.sum() > SPAN_PIECES // 4:
                found.append(Span(place, a + begin * size, b, float(torque[a:b].mean()), slope[begin:][known],
                                  mean[begin:][known]))
    return found


def _extended_interval(torque: np.ndarray, first: int, last: int,
                 segments: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """An interval extended at both ends, which its search cuts by blocks, as far as the torque is the same."""
    begin, end = next((a, b) for a, b in segments if a <= first < b)
    part = torque[first:last]
    level, deviation = float(np.median(part)), float(np.abs(part - np.median(part)).max())
    same = np.abs(torque[begin:end] - level) <= deviation + 1e-9 * abs(level)
    before, after = np.flatnonzero(~same[:first - begin]), np.flatnonzero(~same[last - begin:])
    return (begin + int(before[-1]) + 1 if len(before) else begin), (last + int(after[0]) if len(after) else end)


def _one_direction_parts(speed: np.ndarray, first: int, last: int) -> list[tuple[int, int]]:
    """The parts of an interval before and after the motion reverses, without the standstill between them."""
    part = speed[first:last]
    slow = np.abs(part) <= MIN_SPEED_CHANGE * np.nanmax(np.abs(part), initial=0.0)  # a missing value is not slow
    return [(first + int(a), first + int(b)) for a, b in true_runs(~slow)]


def _fit_line(speed: np.ndarray, step: float) -> tuple[float, float, float]:
    """(slope, mean, scatter about it) of a straight line; NaN where more than half of its values are missing."""
    known = np.isfinite(speed)
    if known.mean() < 0.5:
        return np.nan, np.nan, np.nan
    time = (np.arange(len(speed)) - 0.5 * (len(speed) - 1)) * step
    line = np.polyfit(time[known], speed[known], 1)
    residual = speed[known] - np.polyval(line, time[known])
    return float(line[0]), float(np.mean(speed[known])), float(np.sqrt(np.mean(residual**2)))
