"""The order map: components of the missing torque that repeat with the motor's angle, over order and speed.

A torque of one order has a frequency proportional to speed. Over the angle its order is constant at any speed:
it is an upright ridge. A line of fixed frequency is a bent ridge.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import scipy

from drivetool.check.fit import FIT_ERRORS, Model, over_traces
from drivetool.check.starts import (
    MAX_RIPPLE_FREQUENCY,
    MIN_FOLLOWED_SHARE,
    RESPONSE_FREQUENCIES,
    disturbance_response,
    equivalent_motor_torque,
    innovations,
    response_energy,
)
from drivetool.identify.estimate import HeatMap, PlotData

MIN_MAP_TURNS = 8.0  # of the motor: windows of a turn and more separate orders, and eight of them make rows
WINDOWS_PER_RECORD = 16.0  # of a record: long ones resolve orders and lower the noise, short ones resolve the speed
MAX_WINDOW_TURNS = 16.0  # of a window: it separates orders that differ by an eighth, and no motor needs more
MAX_ORDER_COLUMNS = 1280  # of orders at most: 40 per turn in the longest window
COLUMNS_PER_PERIOD = 2.0  # columns per period in a window: half the width of a ridge
MIN_PERIODS_PER_WINDOW = 4.0  # periods per window: below, steps of the torque and errors of friction leak in
# Times the highest marked order is the end of the map. A choice: its second harmonic is inside.
MAP_TO_MARKED_ORDER = 2.5
MAX_MAP_WINDOWS = 200  # of a recording, a few in every row; further ones cost time and show nothing new
CELLS_PER_PERIOD = 4.0  # cells of the angle per period of the highest order: the Nyquist limit is two
SPEED_ROWS = 24  # of speed. A choice: as many as the plots over speed have bins
# Share of the cells in which noise alone is drawn. A choice: few enough not to look like a ridge.
FALSE_CELL_PROBABILITY = 0.01


@dataclass(frozen=True)
class _WindowSpectra:
    """Sums over windows of the angle: speed (w,), and over orders (w, columns) power and that of noise alone."""

    speed: np.ndarray
    power: np.ndarray
    noise: np.ndarray


def order_maps(base: Model, after: Mapping[str, float], units: tuple[str, str]) -> tuple[PlotData, ...]:
    """An order map per recording in which the motor turns far enough.

    base     the fitted drive before any cause was added. A torque on the motor causes one-step prediction errors;
             the response of the steady-state filter, inverted, turns them back into the torque
    after    values of the drive with the causes: the orders of its ripple are marked
    units    of torque and motion: ("Nm", "rad") or ("N", "m")
    returns  kind diagnosis-order-map: amplitude [Nm or N] over order (periods per turn of the motor, or per metre)
             and speed; NaN where noise alone would be as large. The angle is the integral of the filtered speed,
             which follows every sensor
    source   Fyfe and Munck 1997, Mech. Syst. Signal Process. 11(2), for resampling over the angle
    """
    marked = _marked_orders(base.fitted.drive.values, after)
    found = []
    for name, group in groupby(range(len(base.problem.traces)), lambda i: base.problem.traces[i].name):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                picture = _order_map(over_traces(base, list(group)), name, marked, units)
        except FIT_ERRORS:  # a base whose filter runs away has no map
            continue
        found += [picture] if picture is not None else []
    return tuple(found)


def _marked_orders(before: Mapping[str, float], after: Mapping[str, float]) -> list[float]:
    """Orders of the ripples that the base lacks, in periods per 2 pi rad, or per 2 pi m."""
    return sorted(v for n, v in after.items() if "ripple" in n and n.endswith("_order") and n not in before)


def _order_map(base: Model, name: str, marked: Sequence[float], units: tuple[str, str]) -> PlotData | None:
    """The map of one recording; none where the motor hardly turns."""
    z, angles, speeds = innovations(base)
    rotary = units[1] == "rad"
    turn = 2.0 * np.pi if rotary else 1.0
    step = base.problem.traces[0].step
    distance = sum(float(np.abs(v).sum()) * step for v in speeds)
    usual, top = np.quantile(np.abs(np.concatenate(speeds)), (MIN_FOLLOWED_SHARE, 1.0))
    if not np.isfinite(distance) or distance <= 0.0 or usual <= 0.0 or (rotary and distance < MIN_MAP_TURNS * turn):
        return None
    width = min(distance / WINDOWS_PER_RECORD, MAX_WINDOW_TURNS * turn) if rotary else distance / WINDOWS_PER_RECORD
    # Orders count periods in 2 pi; the columns are multiples of a fraction of the resolution of a window.
    spacing = 2.0 * np.pi / width / COLUMNS_PER_PERIOD
    count = min(MAX_ORDER_COLUMNS, int(MAX_RIPPLE_FREQUENCY * 2.0 * np.pi / step / usual / spacing))
    if marked:
        count = min(count, int(MAP_TO_MARKED_ORDER * marked[-1] / spacing))
    orders = spacing * np.arange(1, count + 1)
    if count < 2.0 * MIN_PERIODS_PER_WINDOW * COLUMNS_PER_PERIOD:  # it turns too fast for its sampling rate
        return None
    lines = np.linspace(0.0, MAX_RIPPLE_FREQUENCY / step, RESPONSE_FREQUENCIES + 1)[1:]
    response = disturbance_response(base, lines)
    size = np.maximum(np.linalg.norm(response, axis=1), 1e-300)
    # Only the phase of the response is inverted: a torque adds up coherently, and white noise stays white.
    phase = response / size[:, None]
    hop = max(0.5 * width, distance / MAX_MAP_WINDOWS)
    parts = [_window_spectra(equivalent_motor_torque(e, phase, lines, step), angle, speed,
                             (width, hop, orders), (size, lines), step)
             for e, angle, speed in zip(z, angles, speeds, strict=True)]
    every = _WindowSpectra(*(
        np.concatenate([getattr(p, field) for p in parts]) for field in ("speed", "power", "noise")))
    if len(every.speed) == 0:
        return None
    edges = np.linspace(0.0, top, SPEED_ROWS + 1)
    values = _cell_amplitudes(every, edges)
    values[:, orders < MIN_PERIODS_PER_WINDOW * 2.0 * np.pi / width] = np.nan
    per = 1.0 if rotary else 2.0 * np.pi
    x = (orders[0] * (np.arange(count + 1) + 0.5)) / per
    words = ("torque", "order [periods per turn of the motor]") if rotary else ("force", "periods per metre [1/m]")
    return PlotData(
        "diagnosis-order-map", f"{name}: order map of the {words[0]} that the base lacks", words[1],
        f"motor speed [{units[1]}/s]",
        {f"{order / per:.4g}": (np.full(2, order / per), edges[[0, -1]]) for order in marked},
        HeatMap(x, edges, values, f"amplitude [{units[0]}]"))


def _window_spectra(
        torque: np.ndarray, angle: np.ndarray, speed: np.ndarray, layout: tuple[float, float, np.ndarray],
        drive: tuple[np.ndarray, np.ndarray], step: float) -> _WindowSpectra:
    """Windows of a segment, Hann over the distance: amplitudes squared at every order.

    torque   (n,) one-step prediction errors with the phase of the motor torque that causes them
    layout   width of a window, distance from one to the next, orders (columns,)
    drive    gain from such a torque to the errors of whitened sensors (m,), at frequencies (m,) [Hz]
    """
    (width, hop, orders), (size, lines) = layout, drive
    distance = np.concatenate(([0.0], np.cumsum(np.abs(speed[:-1]) * step)))
    cells = int(2 ** np.ceil(np.log2(CELLS_PER_PERIOD * len(orders))))
    cell = COLUMNS_PER_PERIOD * width / cells
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for low in np.arange(0.0, distance[-1] - width, hop):
        a, b = np.searchsorted(distance, (low, low + width))
        if b - a < 2:
            continue
        weight = np.sin(np.pi * (distance[a:b] - low) / width) ** 2 * np.abs(speed[a:b])
        place = np.rint((angle[a:b] - angle[a:b].min()) / cell).astype(int)
        sums = np.fft.rfft(np.bincount(place, weight * torque[a:b], cells)[:cells])[1:len(orders) + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = response_energy(orders, speed[a:b], np.sqrt(size)[:, None], lines, weight)
            gain[orders * np.abs(speed[a:b]).max() > 2.0 * np.pi * lines[-1]] = np.nan  # too fast to follow
            power, noise = 4.0 * (np.abs(sums) / gain) ** 2, 4.0 * np.sum(weight**2) / gain**2
        found.append((float(np.average(np.abs(speed[a:b]), weights=weight)), power, noise))
    if not found:
        return _WindowSpectra(np.empty(0), np.empty((0, len(orders))), np.empty((0, len(orders))))
    return _WindowSpectra(*(np.array(part) for part in zip(*found, strict=True)))


def _cell_amplitudes(every: _WindowSpectra, edges: np.ndarray) -> np.ndarray:
    """(rows, columns) root of the mean square over the windows of a speed, less noise; NaN within the noise.

    The noise level is that of the median cell: a ripple covers few cells, and the residual of a missing law is not
    white.
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
        significant = power > noise * scipy.stats.chi2.isf(FALSE_CELL_PROBABILITY, 2 * count) / (2 * count)
        values[k] = np.where(significant, np.sqrt(np.maximum(power - noise, 0.0)), np.nan)
    return values
