"""Intervals of constant torque, in which a drive accelerates or coasts, without the swing that a step leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import stats

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.identify.plateaus import block_means, speed_of, steady_intervals
from drivetool.logs import Experiment

PIECES = 25  # of a span: in each the speed is a straight line but for a swing, a bend leaves 1/625 of itself
SHORTEST = 8  # samples of a piece: a straight line and six to tell its scatter by
# Scatter about its line, over that of the second half, up to which a piece has no swing. Six degrees of freedom
# exceed it by chance in one of fifty pieces, which costs a few samples; a swing of the noise's size does not.
SWING = 1.5
LEVEL = 0.02  # of the largest torque, by which levels differ: a sensor's error of 0.1 % is then 5 % of the inertia
CHANGE = 0.05  # of the fastest speed, by which some span must change it: less is running at a constant speed
DO = "Record at constant torque up and coast down, from standstill or a low speed to a high one, some seconds each."


@dataclass(frozen=True)
class Span:
    """An interval of constant torque.

    recording    place of its recording
    first, last  samples, settled
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
    found = [span for k, e in enumerate(experiments) for span in _of_recording(k, e)]
    wanted = "intervals of constant torque in which the speed changes"
    if not found:
        raise NotEnoughData(wanted, f"none in {', '.join(e.name for e in experiments)}", DO)
    torques = np.array([s.torque for s in found])
    size = float(np.abs(torques).max())
    if np.ptp(torques) <= LEVEL * size:
        raise NotEnoughData(
            "constant torques of two sizes, such as one that accelerates and none", f"only {torques.mean():.4g} "
            f"{experiments[0].torque_unit}", f"One alone tells ratios, and no mass. {DO}")
    fastest = max(float(np.abs(s.speed).max()) for s in found)
    if max(float(np.ptp(s.speed)) for s in found) < CHANGE * fastest:
        raise NotEnoughData(wanted, f"constant speeds, up to {fastest:.4g} {experiments[0].motion_unit}/s",
                            f"Leave --method out: steady speeds tell the friction. For the mass: {DO}")
    return found


def first_values(spans: Sequence[Span]) -> dict[str, float]:
    """inertia, viscous, idle_torque and coulomb by least squares of torque over slope and speed of all pieces.

    Good enough to begin a fit with. In one direction the idle torque has the Coulomb friction in it.

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


def off_the_line(spans: Sequence[Span]) -> float:
    """Probability that the slopes of all spans follow one friction line, by how they scatter about their own lines.

    An F test: slope over torque, speed and direction, with a constant for each recording, against a line over the
    speed for each span.
    """
    recordings = sorted({s.recording for s in spans})
    own, scaled, weights = 0.0, [], []
    for s in spans:
        line = np.column_stack([np.ones(len(s.speed)), s.speed])
        left = s.slope - line @ np.linalg.lstsq(line, s.slope, rcond=None)[0]
        std = float(np.sqrt(left @ left / max(len(left) - 2, 1)))
        std = max(std, 1e-9 * float(np.abs(s.slope).max()) + 1e-300)
        own += float(left @ left) / std**2
        columns = [np.full(len(s.speed), s.torque), s.speed, np.sign(s.speed),
                   *(np.full(len(s.speed), float(s.recording == r)) for r in recordings)]
        scaled.append(np.column_stack(columns) / std)
        weights.append(s.slope / std)
    rows, right = np.concatenate(scaled), np.concatenate(weights)
    size = np.linalg.norm(rows, axis=0)
    factors, _, rank, _ = np.linalg.lstsq(rows / size, right, rcond=1e-9)
    together = float(np.sum((right - rows / size @ factors) ** 2))
    more, free = 2 * len(spans) - int(rank), len(right) - 2 * len(spans)
    if more <= 0 or free <= 0:
        return 1.0
    return float(stats.f.sf(max(together - own, 0.0) / more / (own / free), more, free))


def turns_both_ways(spans: Sequence[Span]) -> bool:
    """Whether there are spans of either direction."""
    return len({float(np.sign(s.speed.mean())) for s in spans}) > 1


def averaged(experiment: Experiment, spans: Sequence[Span], length: int) -> Experiment:
    """The recording with the spans as its only stretches and the motor alone, as means over blocks of samples."""
    signals: dict[str, list[np.ndarray]] = {role: [] for role in ("motor_torque", "motor_speed", "motor_angle")
                                            if role in experiment.signals}
    edges = [0]
    for s in spans:
        for role, parts in signals.items():
            parts.append(block_means(experiment.signals[role][s.first:s.last], length))
        edges.append(edges[-1] + (s.last - s.first) // length)
    return replace(experiment, step=experiment.step * length, others=(), begins=False,
                   signals={role: np.concatenate(parts) for role, parts in signals.items()},
                   segments=tuple(pairwise(edges)))


def _of_recording(place: int, experiment: Experiment) -> list[Span]:
    """The spans of one recording that are long enough to tell a slope."""
    why = "the intervals of constant torque"
    torque, speed = experiment.signed("motor_torque", why), speed_of(experiment, "motor", why)
    found = []
    whole = [_to_its_ends(torque, a, b, experiment.segments)
             for a, b in steady_intervals([torque], experiment.segments)[0]]
    for first, last in dict.fromkeys(whole):  # two parts of one interval have the same ends
        for a, b in _one_way(speed, first, last):
            size = (b - a) // PIECES
            if size < SHORTEST:
                continue
            lines = [_line(speed[i:i + size], experiment.step) for i in range(a, a + PIECES * size, size)]
            slope, mean, left = (np.array(each) for each in zip(*lines, strict=True))
            usual = float(np.nanmedian(left[PIECES // 2:]))
            swings = np.flatnonzero(~(left <= SWING * usual))
            begin = next((k for k in range(PIECES) if k not in swings), PIECES)
            # What is left of it in the next piece goes too. A swing that lasts is averaged over by blocks, later.
            begin = min(begin + 1 if begin else 0, PIECES // 2)
            kept = np.isfinite(slope[begin:])
            if kept.sum() > PIECES // 4:
                found.append(Span(place, a + begin * size, b, float(torque[a:b].mean()), slope[begin:][kept],
                                  mean[begin:][kept]))
    return found


def _to_its_ends(torque: np.ndarray, first: int, last: int,
                 segments: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """An interval with what its search left out at both ends, blocks long: where the torque is still the same."""
    begin, end = next((a, b) for a, b in segments if a <= first < b)
    part = torque[first:last]
    level, most = float(np.median(part)), float(np.abs(part - np.median(part)).max())
    same = np.abs(torque[begin:end] - level) <= most + 1e-9 * abs(level)
    before, after = np.flatnonzero(~same[:first - begin]), np.flatnonzero(~same[last - begin:])
    return (begin + int(before[-1]) + 1 if len(before) else begin), (last + int(after[0]) if len(after) else end)


def _one_way(speed: np.ndarray, first: int, last: int) -> list[tuple[int, int]]:
    """The parts of an interval before and after the motion turns back, without the standstill between them."""
    part = speed[first:last]
    slow = np.abs(part) <= CHANGE * np.nanmax(np.abs(part), initial=0.0)  # what is missing is not slow
    edges = np.flatnonzero(np.diff(np.concatenate([[1], slow.astype(np.int8), [1]]))).reshape(-1, 2)
    return [(first + int(a), first + int(b)) for a, b in edges]


def _line(speed: np.ndarray, step: float) -> tuple[float, float, float]:
    """(slope, mean, scatter about it) of a straight line; NaN where fewer than half of its values are there."""
    known = np.isfinite(speed)
    if known.mean() < 0.5:
        return np.nan, np.nan, np.nan
    time = (np.arange(len(speed)) - 0.5 * (len(speed) - 1)) * step
    line = np.polyfit(time[known], speed[known], 1)
    left = speed[known] - np.polyval(line, time[known])
    return float(line[0]), float(np.mean(speed[known])), float(np.sqrt(np.mean(left**2)))
