"""Inverse dynamics of a motor's body: the logged torque regressed on the torque that its motion requires."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import NotEnoughData
from drivetool.identify.fit import with_friction_parts
from drivetool.identify.laws import Law
from drivetool.identify.motion import (
    INFLUENCE_BLOCKS,
    Equations,
    Motion,
    Motions,
    Rows,
    at_standstill,
    change_of,
    covariance_of,
    equations,
    first_body,
    influence_of,
    initial_transient,
    inverse_of,
    motion_of,
    motions_of,
    near_reversal,
    predicted_by_reference,
    torque_of_chain,
)
from drivetool.identify.problem import Normal, Point, solve
from drivetool.identify.setup import as_recorded, with_trial_values
from drivetool.logs import Experiment
from drivetool.quantity import name_of

# Samples of a fit: blocks of a single sample have no correlation to estimate.
MIN_REGRESSION_SAMPLES = 2 * INFLUENCE_BLOCKS
# Share of the record that the initial transient of a chain may cover. A choice: above it most of it is lost.
MAX_TRANSIENT_SHARE = 0.5
UNEVEN_STEP = 0.618  # increment of uneven steps: multiples of the golden section, modulo one, never coincide
# Deviation of the torque from a straight line over a parameter, relative to the residual, that counts as linear.
# A choice: far above rounding, far below any effect on the estimate.
LINEARITY_TOLERANCE = 1e-6
# Gain relative to the residual's power that ends the fit: with as many instruments as parameters the cost itself
# goes to zero, and a tolerance relative to it would never be met.
COST_TOLERANCE = 1e-16


@dataclass(frozen=True)
class InverseRegression:
    """The regression of the logged torque on the motion.

    drive      with start values; free: its k free parameters
    inputs     roles of torques beside the motor's
    seen       the measured motion of the motor
    foreseen   the motion that the reference predicts, per recording; None: there is no reference
    fitted     how many numbers were fitted for that prediction
    lead       per recording (n,) whether the initial transient of a chain still counts; empty: nowhere
    laws       torques on the motor's body over the measured motion, and over the predicted one; the last names of
               `free` are their factors
    """

    drive: Drive
    free: tuple[str, ...]
    experiments: tuple[Experiment, ...]
    inputs: tuple[str, ...]
    seen: Motions
    predicted: tuple[Motion, ...] | None = None
    fitted: int = 0
    lead: tuple[np.ndarray, ...] = ()
    laws: tuple[tuple[Law, ...], tuple[Law, ...]] = ((), ())

    @property
    def own(self) -> tuple[str, ...]:
        """The free parameters of the drive itself."""
        return tuple(n for n in self.free if n not in self.drive.known_torques)

    @property
    def kept(self) -> int:
        """Every how many samples one is used: the filter leaves as many independent values."""
        return self.seen.each[0].smoothing.window

    def with_motion(self, predicted: bool = False) -> list[Equations]:
        """The equations of every recording at the drive's values, by the measured motion or the predicted one."""
        motions = self.predicted if predicted and self.predicted else self.seen.each
        standing = [at_standstill(m.slow) for m in self.seen.each]
        if self.predicted:  # a body may stand where its reference moves
            standing = [q | at_standstill(m.slow) for q, m in zip(standing, self.predicted, strict=True)]
        laws = self.laws[1 if predicted and self.predicted else 0]
        return [self._equations(i, m, q, laws) for i, (m, q) in enumerate(zip(motions, standing, strict=True))]

    def _equations(self, i: int, motion: Motion, standing: np.ndarray, laws: Sequence[Law]) -> Equations:
        e, more = self.experiments[i], None
        drive, free = as_recorded(self.drive, self.free, e.number)
        torques = {role: e.signals[role] for role in self.inputs}
        if drive.shafts:
            more, torques = torque_of_chain(drive, free, e, motion, torques), {}
        columns = np.column_stack([np.empty((e.size, 0)), *(law.on_grid(i) for law in laws)])
        torques |= dict(zip(drive.known_torques, np.nan_to_num(columns).T, strict=True))
        body = first_body(drive)
        found = equations(e, body, free, self.seen, motion, standing, torques, more)
        dry = name_of(body.bodies[0], "coulomb")
        if dry in free or body.value(dry):
            found = replace(found, used=found.used & ~near_reversal(motion))
        return replace(found, used=found.used & ~self.lead[i]) if self.lead else found

    def after_transient(self) -> InverseRegression:
        """The same without the samples in the initial transient of a chain.

        raises  NotEnoughData: that is most of them, as of a load that rattles or rings on
        """
        if not self.drive.shafts:
            return self
        transient = [initial_transient(as_recorded(self.drive, (), e.number)[0], e, m,
                                       {r: e.signals[r] for r in self.inputs})
                     for e, m in zip(self.experiments, self.seen.each, strict=True)]
        share = float(np.mean(np.concatenate(transient)))
        if share > MAX_TRANSIENT_SHARE:
            raise NotEnoughData(
                "a drive whose initial transient decays, for --criterion inverse",
                f"a transient of {100.0 * share:.0f} % of the record at the start values",
                "Use --criterion auto, whose filter follows the shaft, or record longer.")
        return replace(self, lead=tuple(transient))

    def rows(self) -> list[Rows]:
        """Equations at even times with their instruments; without a reference they are their own."""
        found, measured = [], self.with_motion()
        others = self.with_motion(predicted=True) if self.predicted else measured
        for own, other in zip(measured, others, strict=True):
            used = own.used & other.used
            r, x, z = (np.where(used.reshape(-1, *[1] * (v.ndim - 1)), v, 0.0)[::self.kept]
                       for v in (own.residual, own.slopes, other.slopes))
            found.append(Rows(r, x, z))
        count = sample_count(found)
        if count < MIN_REGRESSION_SAMPLES:
            raise NotEnoughData(
                f"at least {MIN_REGRESSION_SAMPLES} independent samples in which the motor moves", f"{count}",
                "Record longer, or with less standstill.")
        return found

    def at(self, values: np.ndarray) -> InverseRegression:
        """The same with other values of the free parameters."""
        return replace(self, drive=with_trial_values(self.drive, self.free, values))

    def alone(self, values: np.ndarray) -> InverseRegression:
        """The same of the drive without laws, with values of its own free parameters."""
        own = {n: v for n, v in self.drive.values.items() if n not in self.drive.known_torques}
        drive = with_trial_values(replace(self.drive, values=own, known_torques=()), self.own, values)
        return replace(self, drive=drive, free=self.own, laws=((), ()))


@dataclass(frozen=True)
class InverseFit:
    """A fit.

    at          the record at the fitted values; rows: its equations there
    covariance  (k, k) under stationary errors; influence: (BLOCKS, k) shares of the error
    inverse     (k, k) from instruments times residual to a change of the parameters; zero of one on its bound
    """

    at: InverseRegression
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


def regression_of(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], sensor: str,
             inputs: Sequence[str], transient: tuple[np.ndarray, ...] | None = None) -> InverseRegression:
    """The measured motion of a body, smoothed in the widest band that its sensor's noise allows.

    drive     sums of friction over its bodies are split first: the motion is that of one body
    sensor    role; lead: see Inverse; None: the initial transient of the chain of the drive
    raises    NotEnoughData: the first body has no sensor, or 50 values of the sensor in a row are missing
    """
    if not sensor.startswith(f"{drive.bodies[0]}_"):
        raise NotEnoughData(f"the speed or angle of the {drive.bodies[0]} for --criterion inverse", sensor,
                            "Log it, or take --criterion auto.")
    seen = motions_of(experiments, sensor)
    found = InverseRegression(with_friction_parts(drive), tuple(free), tuple(experiments), tuple(inputs), seen)
    return found.after_transient() if transient is None else replace(found, lead=transient)


def in_narrower_band(record: InverseRegression, sensor: str, by: float) -> InverseRegression:
    """The same in a band that is narrower by a factor; instruments have to be predicted again."""
    seen = record.seen
    each = tuple(motion_of(e, sensor, replace(m.smoothing, cutoff=m.smoothing.cutoff / by), seen.top)
                 for e, m in zip(record.experiments, seen.each, strict=True))
    lag = min(m.smoothing.window for m in each) if seen.lag else 0
    return replace(record, seen=replace(seen, each=each, lag=lag), predicted=None, fitted=0)


def with_instruments(record: InverseRegression, sensor: str, reference: str) -> InverseRegression:
    """The same with the motion that the reference predicts as instrument."""
    made, count = predicted_by_reference(record.experiments, sensor, reference)
    return replace(record, fitted=count, predicted=tuple(
        motion_of(e, sensor, m.smoothing, record.seen.top) for e, m in zip(made, record.seen.each, strict=True)))


def first_stage_f(record: InverseRegression) -> float:
    """First-stage F: predicted power of the acceleration per fitted number over residual power per free value.

    source  Staiger and Stock 1997
    """
    own, other = (np.concatenate([m.acceleration for m in each])[::record.kept]
                  for each in (record.seen.each, record.predicted or ()))
    known = np.isfinite(own) & np.isfinite(other)
    residual, whole = float(np.sum((own - other)[known] ** 2)), float(np.sum(own[known] ** 2))
    degrees = max(int(np.count_nonzero(known)) - record.fitted, 1)
    return (whole - residual) / record.fitted / max(residual / degrees, 1e-300)


def sample_count(rows: Sequence[Rows]) -> int:
    """The samples that are used."""
    return sum(int(np.count_nonzero(r.residual)) for r in rows)


def solve_inverse(record: InverseRegression) -> InverseFit:
    """Fit the free parameters, inside their bounds: at once where the torque is linear in them, else by steps."""
    values = np.array([record.drive.value(n) for n in record.free], float)
    rows = record.rows()
    problem = TorqueProblem(record, sample_count(rows))
    nonlinear = np.zeros(len(values), bool)
    if _is_nonlinear(record, rows, values, problem, ~nonlinear):
        nonlinear = np.array([_is_nonlinear(record, rows, values, problem, one)
                              for one in np.eye(len(values), dtype=bool)])
    change, inverse = _bounded_change(rows, values, problem, nonlinear)
    there, steps = record.at(np.clip(values + change, problem.low, problem.high)), 1
    converged = problem.rows(there) is not None  # else the simulation diverges there
    record = there if converged else record
    if nonlinear.any():
        values = np.array([record.drive.value(n) for n in record.free], float)
        solution = solve(replace(problem, record=record), Point(values, ()),
                         target_cost=COST_TOLERANCE * problem.power)
        values = solution.point.values
        record, steps, converged = record.at(values), solution.iterations, solution.converged
        within = np.flatnonzero((values > problem.low) & (values < problem.high))
        inverse = np.zeros_like(inverse)
        inverse[np.ix_(within, within)] = inverse_of([_columns_of(r, within) for r in record.rows()])
    rows = record.rows()
    shares = influence_of(rows, inverse)
    return InverseFit(record, tuple(rows), covariance_of(rows, inverse), shares, inverse, steps, converged)


def _is_nonlinear(record: InverseRegression, rows: Sequence[Rows], values: np.ndarray, problem: TorqueProblem,
                  of: np.ndarray) -> bool:
    """Whether the torque is nonlinear in the parameters `of` (k,), moved together."""
    up = np.where(values == 0.0, problem.size, np.abs(values))
    # Not all in proportion: in that direction the torque of a chain without dry friction and gaps is linear.
    up *= 0.5 + UNEVEN_STEP * np.arange(1, len(values) + 1) % 1.0
    up = np.where(of, np.minimum(up, problem.high - values), 0.0)
    after = problem.rows(record.at(values + up))
    if after is None:  # a chain that diverges is nonlinear
        return True
    off = sum(float(np.sum((b.residual - b.slopes @ up - a.residual) ** 2))
              for b, a in zip(rows, after, strict=True))
    return off > LINEARITY_TOLERANCE**2 * sum(float(np.sum(b.residual**2)) for b in rows)


@dataclass(frozen=True)
class TorqueProblem:
    """The fit as a problem for `least_squares.solve`: of the residual, or of its projection on the instruments.

    count  samples that are used. While fitting, those at the start: at values where fewer are, the chain diverges,
           and the cost is infinite
    """

    record: InverseRegression
    count: int

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters."""
        return self.record.free

    @property
    def unknowns(self) -> int:
        """Free parameters."""
        return len(self.names)

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
        projected = self._projected(point)
        if projected is None:
            k = len(self.names)
            return Normal(np.zeros((k, k)), (), (), np.zeros(k), (), np.inf)
        x, r = projected
        return Normal(x.T @ x, (), (), -x.T @ r, (), float(r @ r))

    def cost(self, point: Point, gains: object = None) -> float:
        """Sum of squares to be minimised."""
        if self.record.predicted:
            projected = self._projected(point)
            return np.inf if projected is None else float(projected[1] @ projected[1])
        rows = self.rows(replace(self.record.at(point.values), free=()))  # the cost needs no slopes
        return np.inf if rows is None else sum(float(q.residual @ q.residual) for q in rows)

    def moved(self, point: Point, step: np.ndarray, own: Sequence[np.ndarray]) -> Point:
        """The point after a step, inside the bounds."""
        return Point(np.clip(point.values + step, self.low, self.high), ())

    def rows(self, at: InverseRegression) -> list[Rows] | None:
        """The equations; None where some are not finite."""
        with suppress(NotEnoughData), np.errstate(over="ignore", invalid="ignore"):
            rows = at.rows()
            if sample_count(rows) >= self.count:
                return rows
        return None

    def _projected(self, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
        """(slopes, residual): the whole of both, or their projection on the instruments; None as for `rows`."""
        rows = self.rows(self.record.at(point.values))
        if rows is None:
            return None
        z, x, r = (np.concatenate([getattr(q, n) for q in rows]) for n in ("instruments", "slopes", "residual"))
        if not self.record.predicted:
            return x, r
        basis = _orthonormal_basis(z)
        return basis.T @ x, basis.T @ r


def _orthonormal_basis(columns: np.ndarray) -> np.ndarray:
    """(n, m) orthonormal columns of the same span, without directions that are rounding alone."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    size[size == 0.0] = 1.0
    left, values, _ = np.linalg.svd(columns / size, full_matrices=False)
    return left[:, values > 1e-10]


def _bounded_change(rows: Sequence[Rows], values: np.ndarray, problem: TorqueProblem,
            held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((k,) change, (k, k) inverse); a parameter that would leave its bounds is set on them and held.

    held  (k,) parameters that do not move at all
    """
    k, low, high = len(values), problem.low, problem.high
    change, moves = np.zeros(k), ~held
    while True:
        i = np.flatnonzero(moves)
        part = [_columns_of(replace(r, residual=r.residual - r.slopes[:, ~moves] @ change[~moves]), i)
                for r in rows]
        inverse = np.zeros((k, k))
        if len(i):
            inverse[np.ix_(i, i)] = inverse_of(part)
            change[i] = change_of(part, inverse[np.ix_(i, i)])
        out = moves & ((values + change < low) | (values + change > high))
        if not out.any():
            return change, inverse
        change[out] = np.clip(values + change, low, high)[out] - values[out]
        moves &= ~out


def _columns_of(rows: Rows, i: np.ndarray) -> Rows:
    """The equations of some parameters."""
    return Rows(rows.residual, rows.slopes[:, i], rows.instruments[:, i])
