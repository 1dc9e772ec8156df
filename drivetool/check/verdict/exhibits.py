"""Where the simulation departs from the machine: the figures of a diagnosis, as arrays.

The error of a free run accumulates: what is wrong with the torque at one instant is seen in the
speed ever after. So what is drawn over speed, torque and angle is the torque that the model lacks,
taken from how fast the error grows: J de/dt, as a single rigid body of all inertias feels it. It is
an exhibit, not the judge: an elastic shaft, a gap or a filter colour it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.check.outcome import CandidateResult, Round
from drivetool.check.verdict.reversals import around, reversals_of
from drivetool.check.verdict.view import View
from drivetool.identify.estimate import Exhibit

Curves = dict[str, tuple[np.ndarray, np.ndarray]]

BINS = 24  # of speed or torque
FEWEST = 30  # samples of a bin
QUICK, SLOW = 0.02, 0.1  # s over which the growth of the error is taken: to see, or to average, resonances
ORDERS, HIGHEST = 480, 40.0  # of the spectrum: how many are drawn, and the highest per turn
FINE, PAD = 6.0, 4.0  # bins of angle per radian of the highest order; length of the transform over the reach
TURNS = 2.0  # fewest that a record must span for one
MOST = 400_000  # bins of angle
CLOSE = 0.3  # s of the close-up


def exhibits_of(views: Sequence[View], inertia: float, rounds: Sequence[Round] = (),
                noise_floor: float | None = None) -> tuple[Exhibit, ...]:
    """All pictures of a diagnosis.

    views        the records; the pictures over speed, torque, order and reversals pool them
    inertia      of the whole drive referred to the motor (Drive.referred_inertia), in its unit
    rounds       what was tried; a picture each
    noise_floor  std of the sensor alone, in the unit of the output
    returns      kinds diagnosis-record, -residual-time (per record), -speed, -torque, -order,
                 -reversal (where the records have them), -candidates (per round)
    """
    found = [_record(view) for view in views]
    found += [_over_time(view, noise_floor) for view in views]
    slow = [_lacking(view, inertia, SLOW) for view in views]
    quick = [_lacking(view, inertia, QUICK) for view in views]
    found += _over_speed(views, slow) + _over_torque(views, quick)
    found += _over_order(views, quick) + around(views, reversals_of(views))
    return (*(each for each in found if each.curves), *candidates_of(rounds))


def candidates_of(rounds: Sequence[Round]) -> tuple[Exhibit, ...]:
    """What was tried, a picture per round in which something was."""
    found = (_candidates(n, one.candidates) for n, one in enumerate(rounds, 1))
    return tuple(each for each in found if each.curves)


def _record(view: View) -> Exhibit:
    """Measured over simulated with errors and torque, all of it and where the base errs most."""
    errors, label = view.errors, view.words[0]
    curves: Curves = {
        "measured": (view.time, view.measured), "simulated before": (view.time, view.before),
        "simulated after": (view.time, view.after),
        "residual before": (view.time, errors["before"]), "residual after": (view.time, errors["after"]),
        f"{view.words[1]} [{view.units[1]}]": (view.time, view.torque),
        "close-up": (np.array(worst(view.time, errors, view.pieces(), _step(view))), np.zeros(2))}
    return Exhibit("diagnosis-record", f"{view.name}: measured and simulated", "time [s]",
                   f"{label} [{view.units[0]}]", curves)


def worst(time: np.ndarray, errors: Mapping[str, np.ndarray], pieces: Sequence[slice],
          step: float) -> tuple[float, float]:
    """The CLOSE seconds over which the base errs most against the extended drive, not across a break.

    time    (n,); errors: before and after, (n,) each; pieces: of the record without breaks; step: [s]
    """
    lost = np.nan_to_num(errors["before"]) ** 2 - np.nan_to_num(errors["after"]) ** 2
    best, where = -np.inf, (time[0], time[min(len(time) - 1, 1)])
    for piece in pieces:
        here = time[piece]
        width = min(len(here), max(2, round(CLOSE / step)))
        gain = np.cumsum(np.concatenate([[0.0], lost[piece]]))
        sums = gain[width:] - gain[:-width]
        k = int(np.argmax(sums))
        if sums[k] > best:
            best, where = sums[k], (here[k], here[k + width - 1])
    return where


def _over_time(view: View, noise_floor: float | None) -> Exhibit:
    """Error over time and its running size; reversals as marks."""
    width = max(3, round(0.1 / _step(view)))
    curves: Curves = {}
    for which, error in view.errors.items():
        curves[f"error {which}"] = (view.time, error)
        curves[f"size {which}"] = (view.time, _running_rms(error, width))
    if noise_floor:
        curves["noise of the sensor"] = (view.time[[0, -1]], np.full(2, noise_floor))
    at = reversals_of([view])[0][0].index
    curves["reversals of the speed"] = (view.time[at], np.zeros(len(at)))
    return Exhibit("diagnosis-residual-time", f"{view.name}: error over time",
                   "time [s]", f"error of {view.words[0]} [{view.units[0]}]", curves)


def _over_speed(views: Sequence[View], lacking: Sequence[Mapping[str, np.ndarray]]) -> list[Exhibit]:
    """Missing torque by speed: friction shows its law here."""
    curves = _binned([v.speed for v in views], lacking)
    units, torque = views[0].units, views[0].words[1]
    return [Exhibit("diagnosis-residual-speed", f"{torque.capitalize()} that the model lacks, by speed",
                    f"motor speed [{units[2]}/s]", f"missing {torque} [{units[1]}]", curves)]


def _over_torque(views: Sequence[View], lacking: Sequence[Mapping[str, np.ndarray]]) -> list[Exhibit]:
    """Missing torque by the torque the shaft carries, or the motor's where there is no shaft."""
    shaft = all(v.shaft is not None for v in views)
    values = [v.shaft if shaft else v.torque for v in views]
    units, torque = views[0].units, views[0].words[1]
    return [Exhibit("diagnosis-residual-torque", f"{torque.capitalize()} that the model lacks, by {torque}",
                    f"{'shaft' if shaft else 'motor'} {torque} [{units[1]}]", f"missing {torque} [{units[1]}]",
                    _binned(values, lacking))]


def _binned(values: Sequence[np.ndarray], lacking: Sequence[Mapping[str, np.ndarray]]) -> Curves:
    """Mean of the missing torque in bins of equal count, its standard error and its spread.

    Neighbouring samples are no independent ones: the error counts one per stretch that the slope
    was taken over, which `lacking` has under "each" as samples.
    """
    x = np.concatenate(values)
    curves: Curves = {}
    for which in ("before", "after"):
        y = np.concatenate([each[which] for each in lacking])
        good = np.isfinite(x) & np.isfinite(y)
        if good.sum() < 2 * FEWEST or np.ptp(x[good]) == 0.0:
            return {}
        edges = _edges(x[good])
        bins = np.clip(np.searchsorted(edges, x[good], "right") - 1, 0, len(edges) - 2)
        count = np.bincount(bins, minlength=len(edges) - 1)
        kept = count >= FEWEST
        middle = np.bincount(bins, x[good], len(count))[kept] / count[kept]
        mean = np.bincount(bins, y[good], len(count))[kept] / count[kept]
        spread = np.sqrt(np.bincount(bins, y[good] ** 2, len(count))[kept] / count[kept])
        alone = np.maximum(count[kept] / float(lacking[0]["each"][0]), 1.0)
        scatter = np.sqrt(np.maximum(spread**2 - mean**2, 0.0))
        curves[which] = (middle, mean)
        curves[f"std {which}"] = (middle, scatter / np.sqrt(alone))
        curves[f"rms {which}"] = (middle, spread)
    return curves


def _edges(x: np.ndarray) -> np.ndarray:
    """Bins half of equal width and half of equal count: both ends and the crowd are seen."""
    share = np.linspace(0.0, 1.0, BINS + 1)
    low, high = np.quantile(x, [0.002, 0.998])
    return np.unique(0.5 * (low + share * (high - low)) + 0.5 * np.quantile(x, 0.002 + 0.996 * share))


def _over_order(views: Sequence[View], lacking: Sequence[Mapping[str, np.ndarray]]) -> list[Exhibit]:
    """Amplitude of the missing torque that repeats with the motor's angle, by order."""
    if any(v.angle is None for v in views):
        return []
    ways = [float(np.sum(np.abs(v.speed))) * _step(v) for v in views]
    reach = max(float(np.ptp(v.angle)) for v in views)
    quick = float(np.median(np.concatenate([np.abs(np.diff(v.angle)) for v in views])))
    rotary = views[0].units[2] == "rad"
    # To and fro within less than a few turns tells no order from its neighbours.
    still_or_gone = not np.min([reach, quick, *ways]) > 0.0  # gone: a run that has diverged is no number
    if (rotary and reach < TURNS * 2.0 * np.pi) or still_or_gone:
        return []
    highest = min(0.3 * np.pi / quick, HIGHEST if rotary else np.inf)
    curves: Curves = {}
    for which in ("before", "after"):
        power = [way * np.square(_spectrum(v, each[which], highest, reach) / way)
                 for v, each, way in zip(views, lacking, ways, strict=True) if way > 0.0]
        order = np.linspace(0.0, highest if rotary else highest / (2.0 * np.pi), len(power[0]))
        curves[which] = _peaks(order, np.sqrt(sum(power) / sum(ways)))
    _, torque, angle = views[0].words
    return [Exhibit("diagnosis-residual-order", f"Missing {torque} that repeats with the motor's {angle}",
                    "order [periods per turn]" if rotary else "periods per metre [1/m]",
                    f"amplitude, rigid drive [{views[0].units[1]}]", curves)]


def _spectrum(view: View, torque: np.ndarray, highest: float, reach: float) -> np.ndarray:
    """Twice |integral of torque exp(-j order angle) over the way|, at orders from 0 to `highest`.

    The samples are collected in narrow bins of angle first: then it is a Fourier transform.
    """
    width = max(1.0 / (FINE * highest), reach / MOST)
    size = int(2 ** np.ceil(np.log2(PAD * reach / width + 1.0)))
    weight = np.where(np.isfinite(torque), torque, 0.0) * np.abs(view.speed) * _step(view)
    place = np.rint((view.angle - view.angle.min()) / width).astype(np.int64)
    found = 2.0 * np.abs(np.fft.rfft(np.bincount(place, weight, size)[:size]))
    return found[:max(2, round(highest * size * width / (2.0 * np.pi)) + 1)]


def _peaks(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most ORDERS points, the highest of each stretch, so that no peak is lost."""
    width = -(-len(y) // ORDERS)
    rows = np.pad(y, (0, -len(y) % width), constant_values=-1.0).reshape(-1, width)
    best = np.argmax(rows, axis=1) + width * np.arange(len(rows))
    return x[best], y[best]


def _lacking(view: View, inertia: float, width: float) -> dict[str, np.ndarray]:
    """Missing torque before and after, (n,) with NaN at the ends of runs; "each": samples it spans.

    The slope of a line through the error over `width` seconds; for an angle the slope of that slope.
    """
    step = _step(view)
    half = max(1, round(0.5 * width / step))
    found = {"each": np.array([2 * half + 1])}
    for which, error in view.errors.items():
        growth = np.full(len(error), np.nan)
        for piece in view.pieces():
            slope = _slope(error[piece], half, step)
            growth[piece] = _slope(slope, half, step) if view.output.endswith("angle") else slope
        found[which] = inertia * growth
    return found


def _slope(y: np.ndarray, half: int, step: float) -> np.ndarray:
    """(n,) slope of the line through 2 half + 1 neighbours; NaN where they are not all there."""
    found = np.full(len(y), np.nan)
    if len(y) > 2 * half:
        weight = np.arange(half, -half - 1, -1) / (step * np.sum(np.arange(-half, half + 1) ** 2))
        found[half:-half] = np.convolve(y, weight, "valid")
    return found


def _running_rms(y: np.ndarray, width: int) -> np.ndarray:
    """(n,) root mean square over `width` neighbours, NaN left out."""
    known = np.isfinite(y)
    box = np.ones(width)
    total = np.convolve(np.where(known, y, 0.0) ** 2, box, "same")[:len(y)]
    count = np.convolve(known.astype(float), box, "same")[:len(y)]
    return np.sqrt(np.maximum(total, 0.0) / np.maximum(count, 1.0))


def _step(view: View) -> float:
    """Sample interval [s]."""
    return float(np.median(np.diff(view.time)))


def _candidates(number: int, candidates: Sequence[CandidateResult]) -> Exhibit:
    """Held-out gain with its standard error; one curve (gain, std) per candidate that was fitted."""
    told = sorted((c for c in candidates if c.gain is not None), key=lambda c: -c.gain)
    return Exhibit(
        "diagnosis-candidates", f"Round {number}: what each cause explains", "log likelihood gained on "
        "data held out", "", {f"{c.code}: {c.state}": (
            np.array([c.gain]), np.array([c.gain_std if c.gain_std is not None else np.nan])) for c in told})
