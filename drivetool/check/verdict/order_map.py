"""The order map: what repeats with the motor's angle, over order and speed, in the torque that the base lacks.

A torque of one order has a frequency that moves with the speed. Over the angle it keeps its place, at any speed:
it is an upright ridge. A hum of fixed frequency is a bent one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from scipy.stats import chi2

from drivetool.check.fit import BROKEN, Model, over
from drivetool.check.starts import FOLLOWED, HIGHEST, LINES, asked_for, disturbance_response, innovations, left_by
from drivetool.identify.estimate import Exhibit, HeatMap

FEWEST_TURNS = 8.0  # of the motor: windows of a turn and more tell orders apart, and eight of them make rows
WINDOWS = 16.0  # of a record: long ones resolve orders and lower the noise, short ones resolve the speed
MOST_TURNS = 16.0  # of a window: orders an eighth apart are two ridges, and no motor asks for more
COLUMNS = 1280  # of orders at most: 40 per turn in the longest window
PER_WINDOW = 2.0  # columns per period in a window: half the width of a ridge
LOWEST = 4.0  # periods per window: below, steps of the torque and errors of friction leak in
AROUND = 2.5  # times the highest order marked, up to which the map goes
MOST_WINDOWS = 200  # of a recording, a few in every row; further ones cost time and show nothing new
FINE = 4.0  # cells of the angle per period of the highest order
ROWS = 24  # of speed
CHANCE = 0.01  # share of the cells in which noise alone would be drawn


@dataclass(frozen=True)
class _Windows:
    """Sums over windows of the angle: speed (w,), and over orders (w, columns) power and what noise makes of it."""

    speed: np.ndarray
    power: np.ndarray
    noise: np.ndarray


def order_maps(base: Model, after: Mapping[str, float], units: tuple[str, str]) -> tuple[Exhibit, ...]:
    """An order map per recording in which the motor turns far enough.

    base     the fitted drive before any cause was added. A torque on the motor leaves one-step errors; the steady
             filter says how large, and in which phase, and so turns them back into the torque
    after    values of the drive with the causes: the orders of its ripple are marked
    units    of torque and motion: ("Nm", "rad") or ("N", "m")
    returns  kind diagnosis-order-map: amplitude [Nm or N] over order (periods per turn of the motor, or per metre)
             and speed; NaN where noise alone would be as large. The angle is the integral of the filtered speed,
             which follows every sensor
    source   Fyfe and Munck 1997, Mech. Syst. Signal Process. 11(2), for resampling over the angle
    """
    marked = _marked(base.fitted.drive.values, after)
    found = []
    for name, group in groupby(range(len(base.problem.traces)), lambda i: base.problem.traces[i].name):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                picture = _map_of(over(base, list(group)), name, marked, units)
        except BROKEN:  # a base whose filter runs away has no map
            continue
        found += [picture] if picture is not None else []
    return tuple(found)


def _marked(before: Mapping[str, float], after: Mapping[str, float]) -> list[float]:
    """Orders of a ripple that the base has not, in periods per 2 pi rad, or per 2 pi m."""
    return sorted(v for n, v in after.items() if "ripple" in n and n.endswith("_order") and n not in before)


def _map_of(base: Model, name: str, marked: Sequence[float], units: tuple[str, str]) -> Exhibit | None:
    """The map of one recording; none where the motor hardly turns."""
    z, angles, speeds = innovations(base)
    rotary = units[1] == "rad"
    turn = 2.0 * np.pi if rotary else 1.0
    step = base.problem.traces[0].step
    way = sum(float(np.abs(v).sum()) * step for v in speeds)
    usual, top = np.quantile(np.abs(np.concatenate(speeds)), (FOLLOWED, 1.0))
    if not np.isfinite(way) or way <= 0.0 or usual <= 0.0 or (rotary and way < FEWEST_TURNS * turn):
        return None
    width = min(way / WINDOWS, MOST_TURNS * turn) if rotary else way / WINDOWS
    # Orders count periods in 2 pi; the columns are multiples of a part of what a window resolves.
    spacing = 2.0 * np.pi / width / PER_WINDOW
    count = min(COLUMNS, int(HIGHEST * 2.0 * np.pi / step / usual / spacing))
    if marked:
        count = min(count, int(AROUND * marked[-1] / spacing))
    orders = spacing * np.arange(1, count + 1)
    if count < 2.0 * LOWEST * PER_WINDOW:  # it turns too fast for its sampling rate
        return None
    lines = np.linspace(0.0, HIGHEST / step, LINES + 1)[1:]
    response = disturbance_response(base, lines)
    size = np.maximum(np.linalg.norm(response, axis=1), 1e-300)
    # The phase of the response alone: a torque adds up, and what is noise stays white, so that none leaks.
    phase = response / size[:, None]
    hop = max(0.5 * width, way / MOST_WINDOWS)
    parts = [_windows(asked_for(e, phase, lines, step), angle, speed, (width, hop, orders), (size, lines), step)
             for e, angle, speed in zip(z, angles, speeds, strict=True)]
    every = _Windows(*(np.concatenate([getattr(p, field) for p in parts]) for field in ("speed", "power", "noise")))
    if len(every.speed) == 0:
        return None
    edges = np.linspace(0.0, top, ROWS + 1)
    values = _amplitudes(every, edges)
    values[:, orders < LOWEST * 2.0 * np.pi / width] = np.nan
    per = 1.0 if rotary else 2.0 * np.pi
    x = (orders[0] * (np.arange(count + 1) + 0.5)) / per
    words = ("torque", "order [periods per turn of the motor]") if rotary else ("force", "periods per metre [1/m]")
    return Exhibit(
        "diagnosis-order-map", f"{name}: order map of the {words[0]} that the base lacks", words[1],
        f"motor speed [{units[1]}/s]",
        {f"{order / per:.4g}": (np.full(2, order / per), edges[[0, -1]]) for order in marked},
        HeatMap(x, edges, values, f"amplitude [{units[0]}]"))


def _windows(torque: np.ndarray, angle: np.ndarray, speed: np.ndarray, layout: tuple[float, float, np.ndarray],
             drive: tuple[np.ndarray, np.ndarray], step: float) -> _Windows:
    """Windows of a stretch, Hann over the way: amplitudes squared at every order.

    torque   (n,) one-step errors with the phase of the torque on the motor that makes them
    layout   width of a window, way from one to the next, orders (columns,)
    drive    one-step errors over such a torque (LINES,), of whitened sensors, at frequencies (LINES,) [Hz]
    """
    (width, hop, orders), (size, lines) = layout, drive
    way = np.concatenate(([0.0], np.cumsum(np.abs(speed[:-1]) * step)))
    cells = int(2 ** np.ceil(np.log2(FINE * len(orders))))
    cell = PER_WINDOW * width / cells
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for low in np.arange(0.0, way[-1] - width, hop):
        a, b = np.searchsorted(way, (low, low + width))
        if b - a < 2:
            continue
        weight = np.sin(np.pi * (way[a:b] - low) / width) ** 2 * np.abs(speed[a:b])
        place = np.rint((angle[a:b] - angle[a:b].min()) / cell).astype(int)
        sums = np.fft.rfft(np.bincount(place, weight * torque[a:b], cells)[:cells])[1:len(orders) + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            left = left_by(orders, speed[a:b], np.sqrt(size)[:, None], lines, weight)
            left[orders * np.abs(speed[a:b]).max() > 2.0 * np.pi * lines[-1]] = np.nan  # too fast to follow
            power, noise = 4.0 * (np.abs(sums) / left) ** 2, 4.0 * np.sum(weight**2) / left**2
        found.append((float(np.average(np.abs(speed[a:b]), weights=weight)), power, noise))
    if not found:
        return _Windows(np.empty(0), np.empty((0, len(orders))), np.empty((0, len(orders))))
    return _Windows(*(np.array(part) for part in zip(*found, strict=True)))


def _amplitudes(every: _Windows, edges: np.ndarray) -> np.ndarray:
    """(rows, columns) root of the mean square over the windows of a speed, less noise; NaN within the noise.

    Its size is that of the median cell: a ripple is seen in few of them, and what a missing law leaves is no white
    noise.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = every.power / every.noise
    known = np.isfinite(ratio)
    level = float(np.median(ratio[known])) / np.log(2.0) if known.any() else 1.0
    values = np.full((len(edges) - 1, every.power.shape[1]), np.nan)
    row = np.clip(np.searchsorted(edges, every.speed, "right") - 1, 0, len(values) - 1)
    for k in np.unique(row):
        mine = row == k
        usable = known[mine]
        count = np.maximum(usable.sum(axis=0), 1)
        power, noise = (np.where(usable, part[mine], 0.0).sum(axis=0) / count for part in (
            every.power, level * every.noise))
        seen = power > noise * chi2.isf(CHANCE, 2 * count) / (2 * count)
        values[k] = np.where(seen, np.sqrt(np.maximum(power - noise, 0.0)), np.nan)
    return values
