"""Inverse dynamics of a motor's body: the torque regressed on what its motion asks for."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import NotEnoughData
from drivetool.identify.fit import apart
from drivetool.identify.laws import Law
from drivetool.identify.motion import (
    BLOCKS,
    Equations,
    Motion,
    Motions,
    Rows,
    begins,
    behind,
    change_of,
    covariance_of,
    equations,
    first_body,
    foretold,
    influence_of,
    inverse_of,
    motion_of,
    motions_of,
    stands,
    turns,
)
from drivetool.identify.problem import Normal, Point, solve
from drivetool.identify.setup import as_recorded, replaced
from drivetool.logs import Experiment

FEWEST = 2 * BLOCKS  # samples of a fit: blocks of one say nothing of each other
REMEMBERED = 0.5  # of the record that may show how a chain began; more, and most of it would be left out
UNEVEN = 0.618  # of a step; multiples of the golden section fall nowhere twice
LINEAR = 1e-6  # of the residual, by which the torque may miss a straight line over a parameter
ENOUGH = 1e-16  # of the residual's power; instruments as many as parameters leave nothing to be seen


@dataclass(frozen=True)
class Inverse:
    """The torque over the motion, as it was recorded.

    drive      with start values; free: its k free parameters
    inputs     roles of torques beside the motor's
    seen       the measured motion of the motor
    foreseen   what the reference foretells of it, per recording; None: there is no reference
    fitted     numbers that were fitted to foresee it
    lead       per recording (n,) whether the state in which a chain began still shows; empty: nowhere
    laws       torques on the motor's body over the measured motion, and over the foreseen one; the last names of
               `free` are their factors
    """

    drive: Drive
    free: tuple[str, ...]
    experiments: tuple[Experiment, ...]
    inputs: tuple[str, ...]
    seen: Motions
    foreseen: tuple[Motion, ...] | None = None
    fitted: int = 0
    lead: tuple[np.ndarray, ...] = ()
    laws: tuple[tuple[Law, ...], tuple[Law, ...]] = ((), ())

    @property
    def own(self) -> tuple[str, ...]:
        """The free parameters of the drive itself."""
        return tuple(n for n in self.free if n not in self.drive.known_torques)

    @property
    def kept(self) -> int:
        """Every how many samples are kept: the filter leaves as many independent values."""
        return self.seen.each[0].smoothing.window

    def with_motion(self, foreseen: bool = False) -> list[Equations]:
        """The equations of every recording at the drive's values, by the measured motion or the foreseen one."""
        motions = self.foreseen if foreseen and self.foreseen else self.seen.each
        quiet = [stands(m.slow) for m in self.seen.each]
        if self.foreseen:  # a body may stand where its reference moves
            quiet = [q | stands(m.slow) for q, m in zip(quiet, self.foreseen, strict=True)]
        laws = self.laws[1 if foreseen and self.foreseen else 0]
        return [self._equations(i, m, q, laws) for i, (m, q) in enumerate(zip(motions, quiet, strict=True))]

    def _equations(self, i: int, motion: Motion, standing: np.ndarray, laws: Sequence[Law]) -> Equations:
        e, more = self.experiments[i], None
        drive, free = as_recorded(self.drive, self.free, e.number)
        torques = {role: e.signals[role] for role in self.inputs}
        if drive.shafts:
            more, torques = behind(drive, free, e, motion, torques), {}
        columns = np.column_stack([np.empty((e.size, 0)), *(law.columns[i] for law in laws)])
        torques |= dict(zip(drive.known_torques, np.nan_to_num(columns).T, strict=True))
        body = first_body(drive)
        found = equations(e, body, free, self.seen, motion, standing, torques, more)
        dry = f"{body.bodies[0]}.coulomb"
        if dry in free or body.value(dry):
            found = replace(found, used=found.used & ~turns(motion))
        return replace(found, used=found.used & ~self.lead[i]) if self.lead else found

    def led_in(self) -> Inverse:
        """The same without the samples that the state shows in which a chain began.

        raises  NotEnoughData: that is most of them, as of a load that rattles or rings on
        """
        if not self.drive.shafts:
            return self
        lead = [begins(as_recorded(self.drive, (), e.number)[0], e, m, {r: e.signals[r] for r in self.inputs})
                for e, m in zip(self.experiments, self.seen.each, strict=True)]
        share = float(np.mean(np.concatenate(lead)))
        if share > REMEMBERED:
            raise NotEnoughData(
                "a chain behind the motor that forgets how it began, for --criterion inverse",
                f"one that at the start values still shows it after {100.0 * share:.0f} % of the record",
                "Use --criterion auto, whose filter follows the shaft, or record longer.")
        return replace(self, lead=tuple(lead))

    def rows(self) -> list[Rows]:
        """Equations at even times with their instruments; without a reference they are their own."""
        found, measured = [], self.with_motion()
        others = self.with_motion(foreseen=True) if self.foreseen else measured
        for own, other in zip(measured, others, strict=True):
            used = own.used & other.used
            r, x, z = (np.where(used.reshape(-1, *[1] * (v.ndim - 1)), v, 0.0)[::self.kept]
                       for v in (own.residual, own.slopes, other.slopes))
            found.append(Rows(r, x, z))
        count = count_of(found)
        if count < FEWEST:
            raise NotEnoughData(
                f"at least {FEWEST} independent samples in which the motor moves", f"{count}",
                "Record longer, or a motion that is no standstill.")
        return found

    def at(self, values: np.ndarray) -> Inverse:
        """The same with other values of the free parameters."""
        return replace(self, drive=replaced(self.drive, self.free, values))

    def alone(self, values: np.ndarray) -> Inverse:
        """The same of the drive without laws, with values of its own free parameters."""
        own = {n: v for n, v in self.drive.values.items() if n not in self.drive.known_torques}
        drive = replaced(replace(self.drive, values=own, known_torques=()), self.own, values)
        return replace(self, drive=drive, free=self.own, laws=((), ()))


@dataclass(frozen=True)
class Solved:
    """A fit.

    at          the record at the fitted values; rows: its equations there
    covariance  (k, k) under stationary errors; influence: (BLOCKS, k) shares of the error
    inverse     (k, k) from what the instruments see to a change of the parameters; zero of one on its bound
    """

    at: Inverse
    rows: tuple[Rows, ...]
    covariance: np.ndarray
    influence: np.ndarray
    inverse: np.ndarray
    steps: int
    converged: bool

    @property
    def values(self) -> np.ndarray:
        """(k,) of the free parameters."""
        return np.array([self.at.drive.value(n) for n in self.at.free], float)


def recorded(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], sensor: str,
             inputs: Sequence[str], lead: tuple[np.ndarray, ...] | None = None) -> Inverse:
    """The measured motion of a body, smoothed in the widest band that its sensor's noise allows.

    drive     sums of friction over its bodies are shared out first: the motion is that of one body
    sensor    role; lead: see Inverse; None: as long as the chain of the drive remembers how it began
    raises    NotEnoughData: the first body has no sensor, or 50 values of the sensor in a row are not there
    """
    if not sensor.startswith(f"{drive.bodies[0]}_"):
        raise NotEnoughData(f"the speed or angle of the {drive.bodies[0]} for --criterion inverse", sensor,
                            "Log it, or take --criterion auto.")
    seen = motions_of(experiments, sensor)
    found = Inverse(apart(drive), tuple(free), tuple(experiments), tuple(inputs), seen)
    return found.led_in() if lead is None else replace(found, lead=lead)


def in_narrower_band(record: Inverse, sensor: str, by: float) -> Inverse:
    """The same in a band that is narrower by a factor; instruments are to be foretold again."""
    seen = record.seen
    each = tuple(motion_of(e, sensor, replace(m.smoothing, cutoff=m.smoothing.cutoff / by), seen.top)
                 for e, m in zip(record.experiments, seen.each, strict=True))
    lag = min(m.smoothing.window for m in each) if seen.lag else 0
    return replace(record, seen=replace(seen, each=each, lag=lag), foreseen=None, fitted=0)


def with_instruments(record: Inverse, sensor: str, reference: str) -> Inverse:
    """The same with the motion that the reference foretells as instrument."""
    made, count = foretold(record.experiments, sensor, reference)
    return replace(record, fitted=count, foreseen=tuple(
        motion_of(e, sensor, m.smoothing, record.seen.top) for e, m in zip(made, record.seen.each, strict=True)))


def strength(record: Inverse) -> float:
    """First-stage F: what is foreseen of the acceleration per fitted number, over what is not per value left.

    source  Staiger and Stock 1997
    """
    own, other = (np.concatenate([m.acceleration for m in each])[::record.kept]
                  for each in (record.seen.each, record.foreseen or ()))
    known = np.isfinite(own) & np.isfinite(other)
    left, whole = float(np.sum((own - other)[known] ** 2)), float(np.sum(own[known] ** 2))
    degrees = max(int(np.count_nonzero(known)) - record.fitted, 1)
    return (whole - left) / record.fitted / max(left / degrees, 1e-300)


def count_of(rows: Sequence[Rows]) -> int:
    """The samples that are used."""
    return sum(int(np.count_nonzero(r.residual)) for r in rows)


def solved(record: Inverse) -> Solved:
    """Fit the free parameters, inside their bounds: at once where the torque is linear in them, else by steps."""
    values = np.array([record.drive.value(n) for n in record.free], float)
    rows = record.rows()
    problem = Torque(record, count_of(rows))
    bends = np.zeros(len(values), bool)
    if _bends(record, rows, values, problem, ~bends):
        bends = np.array([_bends(record, rows, values, problem, one) for one in np.eye(len(values), dtype=bool)])
    change, inverse = _inside(rows, values, problem, bends)
    there, steps, converged = record.at(np.clip(values + change, problem.low, problem.high)), 1, True
    if problem.rows(there) is None:  # it runs away there
        converged = False
    else:
        record = there
    if bends.any():
        values = np.array([record.drive.value(n) for n in record.free], float)
        solution = solve(replace(problem, record=record), Point(values, ()), enough=ENOUGH * problem.power)
        values = solution.point.values
        record, steps, converged = record.at(values), solution.iterations, solution.converged
        within = np.flatnonzero((values > problem.low) & (values < problem.high))
        inverse = np.zeros_like(inverse)
        inverse[np.ix_(within, within)] = inverse_of([_of(r, within) for r in record.rows()])
    rows = record.rows()
    shares = influence_of(rows, inverse)
    return Solved(record, tuple(rows), covariance_of(rows, inverse), shares, inverse, steps, converged)


def _bends(record: Inverse, rows: Sequence[Rows], values: np.ndarray, problem: Torque, of: np.ndarray) -> bool:
    """Whether the torque is no straight line over the parameters `of` (k,), moved together."""
    up = np.where(values == 0.0, problem.size, np.abs(values))
    # Not all in proportion: along that the torque of a chain without dry friction and gaps is a straight line.
    up *= 0.5 + UNEVEN * np.arange(1, len(values) + 1) % 1.0
    up = np.where(of, np.minimum(up, problem.high - values), 0.0)
    after = problem.rows(record.at(values + up))
    if after is None:  # a chain that runs away is no straight line
        return True
    off = sum(float(np.sum((b.residual - b.slopes @ up - a.residual) ** 2))
              for b, a in zip(rows, after, strict=True))
    return off > LINEAR**2 * sum(float(np.sum(b.residual**2)) for b in rows)


@dataclass(frozen=True)
class Torque:
    """The fit as a problem for `least_squares.solve`: of the residual, or of what the instruments see of it.

    count  samples used at the start: at values where fewer are, the chain has run away, and the cost is infinite
    """

    record: Inverse
    count: int

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters."""
        return self.record.free

    @property
    def low(self) -> np.ndarray:
        """(k,) lower bounds."""
        return np.array([self.record.drive.quantity(n).bounds[0] for n in self.names])

    @property
    def high(self) -> np.ndarray:
        """(k,) upper bounds."""
        return np.array([self.record.drive.quantity(n).bounds[1] for n in self.names])

    @property
    def size(self) -> np.ndarray:
        """(k,) typical sizes."""
        torque = np.concatenate([e.signals["motor_torque"] for e in self.record.experiments])
        sizes = float(np.sqrt(np.mean(torque**2))) or 1.0, self.record.seen.top or 1.0
        return np.array([self.record.drive.quantity(n).size(*sizes) for n in self.names])

    @property
    def power(self) -> float:
        """Sum of squares of the residual at the start."""
        return sum(float(np.sum(r.residual**2)) for r in self.record.rows())

    def normal(self, point: Point, gains: object = None) -> Normal:
        """Normal equations at a point."""
        seen = self._seen(point)
        if seen is None:
            k = len(self.names)
            return Normal(np.zeros((k, k)), (), (), np.zeros(k), (), np.inf)
        x, r = seen
        return Normal(x.T @ x, (), (), -x.T @ r, (), float(r @ r))

    def cost(self, point: Point, gains: object = None) -> float:
        """Sum of squares that are to be small."""
        if self.record.foreseen:
            seen = self._seen(point)
            return np.inf if seen is None else float(seen[1] @ seen[1])
        rows = self.rows(replace(self.record.at(point.values), free=()))  # least squares ask for no slopes
        return np.inf if rows is None else sum(float(q.residual @ q.residual) for q in rows)

    def moved(self, point: Point, step: np.ndarray, own: Sequence[np.ndarray]) -> Point:
        """The point after a step, inside the bounds."""
        return Point(np.clip(point.values + step, self.low, self.high), ())

    def rows(self, at: Inverse) -> list[Rows] | None:
        """The equations; None where some are no numbers any more."""
        with suppress(NotEnoughData), np.errstate(over="ignore", invalid="ignore"):
            rows = at.rows()
            if count_of(rows) >= self.count:
                return rows
        return None

    def _seen(self, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
        """(slopes, residual): the whole of both, or that part which the instruments see; None as for `_rows`."""
        rows = self.rows(self.record.at(point.values))
        if rows is None:
            return None
        z, x, r = (np.concatenate([getattr(q, n) for q in rows]) for n in ("instruments", "slopes", "residual"))
        if not self.record.foreseen:
            return x, r
        basis = _basis(z)
        return basis.T @ x, basis.T @ r


def _basis(columns: np.ndarray) -> np.ndarray:
    """(n, m) orthonormal columns that span the same, but for what rounding made."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    size[size == 0.0] = 1.0
    left, values, _ = np.linalg.svd(columns / size, full_matrices=False)
    return left[:, values > 1e-10]


def _inside(rows: Sequence[Rows], values: np.ndarray, problem: Torque,
            stays: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """((k,) change, (k, k) inverse) with what would leave its bounds put there and held.

    stays  (k,) what does not move at all
    """
    k, low, high = len(values), problem.low, problem.high
    change, moves = np.zeros(k), np.ones(k, bool) if stays is None else ~stays
    while True:
        i = np.flatnonzero(moves)
        part = [_of(replace(r, residual=r.residual - r.slopes[:, ~moves] @ change[~moves]), i) for r in rows]
        inverse = np.zeros((k, k))
        if len(i):
            inverse[np.ix_(i, i)] = inverse_of(part)
            change[i] = change_of(part, inverse[np.ix_(i, i)])
        out = moves & ((values + change < low) | (values + change > high))
        if not out.any():
            return change, inverse
        change[out] = np.clip(values + change, low, high)[out] - values[out]
        moves &= ~out


def _of(rows: Rows, i: np.ndarray) -> Rows:
    """The equations of some parameters."""
    return Rows(rows.residual, rows.slopes[:, i], rows.instruments[:, i])
