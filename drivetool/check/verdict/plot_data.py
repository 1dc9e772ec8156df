"""Where the simulation departs from the machine: the plots of a diagnosis, as arrays.

The error of a free run accumulates: a torque error at one instant stays in the speed ever after. So the
plots over speed, torque and angle show the missing torque: J de/dt, with the total inertia of a single
rigid body. It illustrates and decides nothing: an elastic shaft, backlash or a filter distort it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.check.outcome import Round
from drivetool.check.verdict.reversals import reversal_plots, reversals_of
from drivetool.check.verdict.view import View
from drivetool.identify.estimate import PlotData

Curves = dict[str, tuple[np.ndarray, np.ndarray]]

# Bins of speed or torque. A choice: fewer hide the shape of a friction law, more leave few samples in each.
PLOT_BINS = 24
MIN_BIN_SAMPLES = 30  # in a bin: the standard deviation from 30 samples is itself uncertain by 13 %, 1/sqrt(2 n)
# S over which the growth of the error is taken: to see, or to average, resonances.
SHORT_SLOPE_TIME, LONG_SLOPE_TIME = 0.02, 0.1
# Points and periods per turn of the spectrum. A choice: a picture resolves no more points, and few recordings
# sample higher orders.
MAX_DRAWN_ORDERS, MAX_ORDER_PER_TURN = 480, 40.0
# Bins of 1/6 rad attenuate the highest order by 0.1 %; a transform of four times the span of the angle
# (zero padding) loses at most 3 % of a peak between two of its orders.
BINS_PER_ORDER_RADIAN, ZERO_PADDING_FACTOR = 6.0, 4.0
MIN_SPECTRUM_TURNS = 2.0  # turns that a record must span: the resolution in order is one over them
MAX_ANGLE_BINS = 400_000  # bins of angle. A choice: it bounds the time of the transform of a long recording
CLOSE_UP_TIME = 0.3  # s of the close-up. A choice: a few periods of a resonance of 10 Hz and more


def diagnosis_plots(views: Sequence[View], inertia: float, rounds: Sequence[Round] = (),
                    noise_floor: float | None = None) -> tuple[PlotData, ...]:
    """All plots of a diagnosis.

    views        the records; the plots over speed, torque, order and reversals pool them
    inertia      of the whole drive referred to the motor (Drive.referred_inertia), in its unit
    rounds       of the search; a plot each
    noise_floor  std of the sensor alone, in the unit of the output
    returns      kinds diagnosis-record, -residual-time (per record), -speed, -torque, -order,
                 -reversal (where the records have them), -candidates (per round)
    """
    found = [_record_plot(view) for view in views]
    found += [_error_over_time(view, noise_floor) for view in views]
    slow = [_missing_torque(view, inertia, LONG_SLOPE_TIME) for view in views]
    quick = [_missing_torque(view, inertia, SHORT_SLOPE_TIME) for view in views]
    found += _missing_torque_over_speed_and_torque(views, slow, quick)
    found += _missing_torque_over_order(views, quick) + reversal_plots(views, reversals_of(views))
    return (*(each for each in found if each.curves), *candidate_plots(rounds))


def candidate_plots(rounds: Sequence[Round]) -> tuple[PlotData, ...]:
    """The fitted candidates, a plot per round that has some."""
    found = map(_candidate_plot, rounds)
    return tuple(each for each in found if each.curves)


def _record_plot(view: View) -> PlotData:
    """Measured and simulated output with errors and torque: the whole record and where the base errs most."""
    errors, label = view.errors, view.words[0]
    curves: Curves = {
        "measured": (view.time, view.measured), "simulated before": (view.time, view.before),
        "simulated after": (view.time, view.after),
        "residual before": (view.time, errors["before"]), "residual after": (view.time, errors["after"]),
        f"{view.words[1]} [{view.units[1]}]": (view.time, view.torque),
        "close-up": (
            np.array(worst_interval(view.time, errors, view.pieces(), _sample_interval(view))), np.zeros(2))}
    return PlotData("diagnosis-record", f"{view.name}: measured and simulated", "time [s]",
                    f"{label} [{view.units[0]}]", curves)


def worst_interval(time: np.ndarray, errors: Mapping[str, np.ndarray], pieces: Sequence[slice],
                   step: float) -> tuple[float, float]:
    """The CLOSE_UP_TIME seconds with the most error of the base beyond that of the extended drive, without a break.

    time    (n,); errors: before and after, (n,) each; pieces: of the record without breaks; step: [s]
    """
    lost = np.nan_to_num(errors["before"]) ** 2 - np.nan_to_num(errors["after"]) ** 2
    best, where = -np.inf, (time[0], time[min(len(time) - 1, 1)])
    for piece in pieces:
        here = time[piece]
        width = min(len(here), max(2, round(CLOSE_UP_TIME / step)))
        gain = np.cumsum(np.concatenate([[0.0], lost[piece]]))
        sums = gain[width:] - gain[:-width]
        k = int(np.argmax(sums))
        if sums[k] > best:
            best, where = sums[k], (here[k], here[k + width - 1])
    return where


def _error_over_time(view: View, noise_floor: float | None) -> PlotData:
    """Error over time and its running rms; reversals as marks."""
    width = max(3, round(0.1 / _sample_interval(view)))
    curves: Curves = {}
    for which, error in view.errors.items():
        curves[f"error {which}"] = (view.time, error)
        curves[f"size {which}"] = (view.time, _running_rms(error, width))
    if noise_floor:
        curves["noise of the sensor"] = (view.time[[0, -1]], np.full(2, noise_floor))
    at = reversals_of([view])[0][0].index
    curves["reversals of the speed"] = (view.time[at], np.zeros(len(at)))
    return PlotData("diagnosis-residual-time", f"{view.name}: error over time",
                    "time [s]", f"error of {view.words[0]} [{view.units[0]}]", curves)


def _missing_torque_over_speed_and_torque(
        views: Sequence[View], slow: Sequence[Mapping[str, np.ndarray]],
        quick: Sequence[Mapping[str, np.ndarray]]) -> list[PlotData]:
    """Missing torque over speed: shows the law of friction; over the torque of the shaft, or else of the motor."""
    shaft = all(v.shaft is not None for v in views)
    units, torque = views[0].units, views[0].words[1]
    missing = f"missing {torque} [{units[1]}]"
    return [
        PlotData("diagnosis-residual-speed", f"Unmodelled {torque} over speed", f"motor speed [{units[2]}/s]",
                 missing, _bin_means([v.speed for v in views], slow)),
        PlotData("diagnosis-residual-torque", f"Unmodelled {torque} over {torque}",
                 f"{'shaft' if shaft else 'motor'} {torque} [{units[1]}]", missing,
                 _bin_means([v.shaft if shaft else v.torque for v in views], quick))]


def _bin_means(values: Sequence[np.ndarray], missing: Sequence[Mapping[str, np.ndarray]]) -> Curves:
    """Mean of the missing torque in bins, its standard error and its rms.

    Neighbouring samples are not independent: the standard error counts one sample per span of the slope,
    which `lacking` has under "each" as samples.
    """
    x = np.concatenate(values)
    curves: Curves = {}
    for which in ("before", "after"):
        y = np.concatenate([each[which] for each in missing])
        good = np.isfinite(x) & np.isfinite(y)
        if good.sum() < 2 * MIN_BIN_SAMPLES or np.ptp(x[good]) == 0.0:
            return {}
        edges = _bin_edges(x[good])
        bins = np.clip(np.searchsorted(edges, x[good], "right") - 1, 0, len(edges) - 2)
        count = np.bincount(bins, minlength=len(edges) - 1)
        filled = count >= MIN_BIN_SAMPLES
        middle = np.bincount(bins, x[good], len(count))[filled] / count[filled]
        mean = np.bincount(bins, y[good], len(count))[filled] / count[filled]
        spread = np.sqrt(np.bincount(bins, y[good] ** 2, len(count))[filled] / count[filled])
        independent = np.maximum(count[filled] / float(missing[0]["each"][0]), 1.0)
        scatter = np.sqrt(np.maximum(spread**2 - mean**2, 0.0))
        curves[which] = (middle, mean)
        curves[f"std {which}"] = (middle, scatter / np.sqrt(independent))
        curves[f"rms {which}"] = (middle, spread)
    return curves


def _bin_edges(x: np.ndarray) -> np.ndarray:
    """Bin edges halfway between equal width and equal count: both the ends and the dense range are resolved."""
    share = np.linspace(0.0, 1.0, PLOT_BINS + 1)
    low, high = np.quantile(x, [0.002, 0.998])
    return np.unique(0.5 * (low + share * (high - low)) + 0.5 * np.quantile(x, 0.002 + 0.996 * share))


def _missing_torque_over_order(views: Sequence[View],
                               missing: Sequence[Mapping[str, np.ndarray]]) -> list[PlotData]:
    """Amplitude of the missing torque that repeats with the motor's angle, by order."""
    if any(v.angle is None for v in views):
        return []
    distances = [float(np.sum(np.abs(v.speed))) * _sample_interval(v) for v in views]
    reach = max(float(np.ptp(v.angle)) for v in views)
    quick = float(np.median(np.concatenate([np.abs(np.diff(v.angle)) for v in views])))
    rotary = views[0].units[2] == "rad"
    # Motion within less than a few turns does not resolve neighbouring orders.
    still_or_diverged = not np.min([reach, quick, *distances]) > 0.0  # gone: a run that has diverged is not finite
    if (rotary and reach < MIN_SPECTRUM_TURNS * 2.0 * np.pi) or still_or_diverged:
        return []
    highest = min(0.3 * np.pi / quick, MAX_ORDER_PER_TURN if rotary else np.inf)
    curves: Curves = {}
    for which in ("before", "after"):
        power = [way * np.square(_order_spectrum_of(v, each[which], highest, reach) / way)
                 for v, each, way in zip(views, missing, distances, strict=True) if way > 0.0]
        order = np.linspace(0.0, highest if rotary else highest / (2.0 * np.pi), len(power[0]))
        curves[which] = _highest_of_intervals(order, np.sqrt(sum(power) / sum(distances)))
    _, torque, angle = views[0].words
    return [PlotData("diagnosis-residual-order", f"Order spectrum of the unmodelled {torque} over motor {angle}",
                     "order [periods per turn]" if rotary else "periods per metre [1/m]",
                     f"amplitude, rigid drive [{views[0].units[1]}]", curves)]


def _order_spectrum_of(view: View, torque: np.ndarray, highest: float, reach: float) -> np.ndarray:
    """Twice |integral of torque exp(-j order angle) over the distance|, at orders from 0 to `highest`.

    The samples are summed in narrow bins of angle first, so that an FFT applies.
    """
    width = max(1.0 / (BINS_PER_ORDER_RADIAN * highest), reach / MAX_ANGLE_BINS)
    size = int(2 ** np.ceil(np.log2(ZERO_PADDING_FACTOR * reach / width + 1.0)))
    weight = np.where(np.isfinite(torque), torque, 0.0) * np.abs(view.speed) * _sample_interval(view)
    place = np.rint((view.angle - view.angle.min()) / width).astype(np.int64)
    found = 2.0 * np.abs(np.fft.rfft(np.bincount(place, weight, size)[:size]))
    return found[:max(2, round(highest * size * width / (2.0 * np.pi)) + 1)]


def _highest_of_intervals(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most MAX_DRAWN_ORDERS points, the highest of each interval, so that no peak is lost."""
    width = -(-len(y) // MAX_DRAWN_ORDERS)
    rows = np.pad(y, (0, -len(y) % width), constant_values=-1.0).reshape(-1, width)
    best = np.argmax(rows, axis=1) + width * np.arange(len(rows))
    return x[best], y[best]


def _missing_torque(view: View, inertia: float, width: float) -> dict[str, np.ndarray]:
    """Missing torque before and after, (n,) with NaN at the ends of runs; "each": samples that a slope spans.

    The slope of a line through the error over `width` seconds; for an angle the slope of that slope.
    """
    step = _sample_interval(view)
    half = max(1, round(0.5 * width / step))
    found = {"each": np.array([2 * half + 1])}
    for which, error in view.errors.items():
        growth = np.full(len(error), np.nan)
        for piece in view.pieces():
            slope = _local_slope(error[piece], half, step)
            growth[piece] = _local_slope(slope, half, step) if view.output.endswith("angle") else slope
        found[which] = inertia * growth
    return found


def _local_slope(y: np.ndarray, half: int, step: float) -> np.ndarray:
    """(n,) least-squares slope over 2 half + 1 neighbours; NaN where some of them are missing."""
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


def _sample_interval(view: View) -> float:
    """Sample interval [s]."""
    return float(np.median(np.diff(view.time)))


def _candidate_plot(one: Round) -> PlotData:
    """Held-out gain with its standard error; one curve (gain, std) per candidate that was fitted."""
    fitted = sorted((c for c in one.candidates if c.gain is not None), key=lambda c: -c.gain)
    return PlotData(
        "diagnosis-candidates", f"Round {one.round}: held-out gain of each cause", "log likelihood gained on "
        "data held out", "", {f"{c.code}: {c.state}": (
            np.array([c.gain]), np.array([c.gain_std if c.gain_std is not None else np.nan])) for c in fitted})
