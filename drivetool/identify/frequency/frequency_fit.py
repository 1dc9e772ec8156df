"""The physical parameters fitted to a measured frequency response.

Two weightings: maximum likelihood, each line by its measured variance; and the one of practice,
V = sum (coherence/f) |ln G - ln G^|^2, which weights anti-resonances as much as resonances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.estimate import (
    Estimate,
    PlotData,
    covariance_of,
    estimate_from_fit,
    fit_percent,
    parameters_of,
)
from drivetool.identify.frequency.estimator import SpectraOptions, spectra
from drivetool.identify.frequency.frf import Response
from drivetool.identify.frequency.periodic import smoothed_lines
from drivetool.identify.frequency.spectrum import Spectrum
from drivetool.identify.problem import Normal, Point, Solution, solve
from drivetool.identify.setup import NONLINEAR, HeldResponse, KnownStart, Options, refuse_transmission_loss
from drivetool.logs import Experiment
from drivetool.quantity import quantity_of

# Chi-square per degree of freedom from which the residual is model error, not noise. A choice: without
# model error it is near one.
MAX_CHI_SQUARE = 2.0
MIN_LINE_STD = 1e-6  # least relative std of a line: noise-free data would get infinite weights
TOTAL_VISCOUS = "total.viscous"
# Lines over which the residual is smoothed and may be correlated. A choice: model errors are broad
CORRELATED_LINES = 11
REWEIGHTING_ROUNDS = 4  # of reweighting. A choice: each needs one fit, and the weights settle


@dataclass(frozen=True)
class LineProblem:
    """The fit as a least-squares problem for `least_squares.solve`.

    model     the response over the free parameters; measured (n,) complex
    weight    (n,) of the residual; logarithm: whether it is ln G - ln G^ or G - G^
    shared    spectral lines that carry the same information
    """

    model: HeldResponse
    measured: np.ndarray
    weight: np.ndarray
    logarithm: bool
    shared: float
    low: np.ndarray
    high: np.ndarray
    size: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters."""
        return self.model.names

    @property
    def count(self) -> int:
        """Real numbers that count as independent."""
        return max(int(2.0 * len(self.measured) / self.shared), len(self.names) + 1)

    @property
    def unknowns(self) -> int:
        """Free parameters."""
        return len(self.names)

    def residual(self, values: np.ndarray, gradient: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """((n,) complex weighted residual, (n, k) its derivatives)."""
        g, slopes = self.model.at(values, gradient)
        scale = self.weight / np.sqrt(self.shared)
        if not self.logarithm:
            return (g - self.measured) * scale, slopes * scale[:, None]
        r = np.log(np.abs(g / self.measured)) + 1j * np.angle(g / self.measured)
        return r * scale, slopes / g[:, None] * scale[:, None]

    def normal(self, point: Point, gains: object = None) -> Normal:
        """Normal equations at a point."""
        r, j = self.residual(point.values)
        return Normal((j.conj().T @ j).real, (), (), (j.conj().T @ r).real, (), float(np.sum(np.abs(r) ** 2)))

    def cost(self, point: Point, gains: object = None) -> float:
        """Sum of squares."""
        with np.errstate(all="ignore"):
            cost = float(np.sum(np.abs(self.residual(point.values, False)[0]) ** 2))
        return cost if np.isfinite(cost) else np.inf

    def moved(self, point: Point, step: np.ndarray, own: Sequence[np.ndarray]) -> Point:
        """The point after a step, inside the bounds."""
        return Point(np.clip(point.values + step, self.low, self.high), ())


def line_weights(r: Response, weighting: str) -> tuple[np.ndarray, bool]:
    """((n,) weights, whether they are of logarithms)."""
    if weighting == "coherence":
        return np.sqrt(r.coherence / r.frequency), True
    # The complex error has the variance; each of its two parts half of it.
    floor = (MIN_LINE_STD * np.abs(r.g)) ** 2
    return np.sqrt(2.0 / np.maximum(np.where(np.isfinite(r.variance), r.variance, np.inf), floor)), False


def problem_of(drive: Drive, free: Sequence[str], output: str, step: float, r: Response, weighting: str,
               ) -> LineProblem:
    """The problem of fitting free parameters to a response."""
    known, (weight, logarithm) = [drive.quantity(n) for n in free], line_weights(r, weighting)
    return LineProblem(
        HeldResponse(drive, tuple(free), output, step, r.frequency), r.g, weight, logarithm, r.bins,
        np.array([q.bounds[0] for q in known]), np.array([q.bounds[1] for q in known]),
        np.array([q.size(1.0, float(np.median(np.abs(r.g)))) for q in known]))


def fit_lines(drive: Drive, free: Sequence[str], output: str, step: float, r: Response, weighting: str,
              ) -> tuple[LineProblem, Solution]:
    """The best values; always by logarithms first, which converge from far."""
    start = Point(np.array([float(drive.value(n)) for n in free]), ())
    problem = problem_of(drive, free, output, step, r, "coherence")
    solution = solve(problem, start, max_iterations=200, relative=1e-10)
    if weighting == "coherence":
        return problem, solution
    problem = problem_of(drive, free, output, step, r, weighting)
    return problem, solve(problem, solution.point, max_iterations=200, relative=1e-12)


def with_residual_variance(r: Response, g: np.ndarray) -> Response:
    """The response with the residual of a model, smoothed over neighbours, as part of its variance.

    Friction makes distortion that repeats every period, which the scatter over periods does not contain. Lines
    weighted by that scatter alone would bias the fit to where the noise happens to be lowest.
    """
    relative = np.abs(r.g - g) ** 2 / np.abs(g) ** 2
    smooth = smoothed_lines(relative, CORRELATED_LINES // 2)
    return replace(r, total=smooth * np.abs(g) ** 2 + np.where(np.isfinite(r.noise), r.noise, 0.0))


def noise_covariance(problem: LineProblem, solution: Solution, r: Response) -> np.ndarray:
    """(k, k) covariance of a fit, however weighted, from the variances of the lines."""
    _, j = problem.residual(solution.point.values)
    error = np.maximum(np.where(np.isfinite(r.variance), r.variance, 0.0), (MIN_LINE_STD * np.abs(r.g)) ** 2)
    if problem.logarithm:
        error = error / np.abs(r.g) ** 2
    inner = ((j.conj() * (0.5 * error * problem.weight**2)[:, None]).T @ j).real
    inverse = _inverse(solution.normal.shared)
    return inverse @ inner @ inverse


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix whose rows differ in size."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-13, hermitian=True) / np.outer(size, size)


def sandwich(problem: LineProblem, solution: Solution) -> np.ndarray:
    """(k, k) covariance from the residual itself, which may be correlated on neighbouring lines.

    source  Newey and West 1987, along the frequency axis
    """
    r, j = problem.residual(solution.point.values)
    scores = (j.conj() * r[:, None]).real
    inner = scores.T @ scores
    for lag in range(1, min(CORRELATED_LINES, len(r) - 1) + 1):
        part = scores[lag:].T @ scores[:-lag]
        inner += (1.0 - lag / (CORRELATED_LINES + 1.0)) * (part + part.T)
    inverse = _inverse(solution.normal.shared)
    # Each residual stands for `shared` lines with the same information: their scores add up coherently.
    return inverse @ inner @ inverse * problem.shared * problem.count / max(problem.count - problem.unknowns, 1)


def greybox_by_frequency(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], options: Options,
                         ) -> Estimate:
    """Physical parameters from the frequency response of the records.

    experiments  motor_torque and the motor's speed or angle; exact variances need a periodic excitation
    drive        start values; gaps count as closed
    free         parameter names
    options      weighting: variance (maximum likelihood) or coherence; band
    returns      Estimate; details: lines, weighting, chi-square
    raises       NotEnoughData: fewer excited lines than parameters
    source       bus driveline paper, the log criterion; Pintelon and Schoukens 2012, sec. 9.11, for
                 the maximum-likelihood one
    """
    if options.start != KnownStart():
        raise BadOption("a criterion in time for --start", "frequency, which has no start state",
                        "Leave --start out, or take --criterion innovations.")
    if any(e.sha256 in drive.records.values() for e in experiments):
        raise BadOption("a criterion in time for recordings that differ", "frequency, which averages them",
                        "Leave --record out, or take --criterion innovations.")
    refuse_transmission_loss(drive, free, "--criterion frequency")
    names = tuple(n for n in free if quantity_of(n) not in NONLINEAR)
    if not names:
        raise BadOption("a free parameter of the linear response", "none", "Free an inertia or stiffness.")
    s = spectra(experiments, SpectraOptions(band=options.band))
    r, output = s.mean, "motor_speed"
    good = (r.coherence >= 0.5) & (np.abs(r.g) > 0.0)
    if good.sum() < len(names) + 2:
        raise NotEnoughData(f"at least {len(names) + 2} excited lines with a coherence above 0.5",
                            f"{int(good.sum())}", "Excite more lines, widen --band, or hold parameters.")
    r = r.at(good)
    drive, names = _friction_in_parts(drive, names, output, experiments[0].step, r, options)
    problem, solution = fit_lines(drive, names, output, experiments[0].step, r, options.weighting)
    likely = problem_of(drive, names, output, experiments[0].step, r, "variance")
    best = solve(likely, solution.point, max_iterations=200, relative=1e-12)
    chi = best.cost / max(likely.count - likely.unknowns, 1)
    if chi >= MAX_CHI_SQUARE and options.weighting == "variance":
        for _ in range(REWEIGHTING_ROUNDS):
            g, _ = problem.model.at(solution.point.values, False)
            problem = problem_of(
                drive, names, output, experiments[0].step, with_residual_variance(r, g), "variance")
            solution = solve(problem, solution.point, max_iterations=200, relative=1e-12)
    after = replace(drive, values={**drive.values, **dict(zip(names, map(float, solution.point.values),
        strict=True))})
    extra = None
    if chi >= MAX_CHI_SQUARE or options.weighting == "coherence":
        plain = covariance_of(problem, solution)[0]
        meat = sandwich(problem, solution) if chi >= MAX_CHI_SQUARE else noise_covariance(problem, solution, r)
        extra = np.where(np.isfinite(plain), meat - plain, 0.0)
    lines, covariance, more = parameters_of(problem, solution, drive, after, extra)
    figures = {"chi_square_per_degree": float(chi), "lines": len(r.frequency),
               "log_fit_percent": _log_fit(problem, solution), "n": int(sum(e.size for e in experiments))}
    return estimate_from_fit(
        "greybox", experiments, after, lines, covariance,
        outcome=f"{'converged' if solution.converged else 'stopped'} after {solution.iterations} iterations on "
        f"{len(r.frequency)} lines from {r.frequency[0]:.4g} to {r.frequency[-1]:.4g} Hz, weighted by "
        f"{options.weighting}",
        fit=figures,
        details={"criterion": "frequency", "weighting": options.weighting, "spectra": dict(s.settings)},
        findings=(*s.findings, *more, *_residual_findings(chi, options)), exhibits=(picture(problem, solution, s),))


def _friction_in_parts(drive: Drive, names: tuple[str, ...], output: str, step: float, r: Response,
                       options: Options) -> tuple[Drive, tuple[str, ...]]:
    """The drive with its friction sum replaced by the parts, where they explain the lines clearly better.

    A sum split by inertia is a guess.
    """
    if TOTAL_VISCOUS not in names or TOTAL_VISCOUS in options.free:
        return drive, names
    _, solution = fit_lines(drive, names, output, step, r, "variance")
    found = dict(zip(names, map(float, solution.point.values), strict=True))
    split_drive = replace(drive, values={n: found.get(n, v) for n, v in drive.values.items() if n != TOTAL_VISCOUS})
    parts = split_drive.parts(TOTAL_VISCOUS, found[TOTAL_VISCOUS])
    split_drive = split_drive.with_values(parts)
    more = tuple(n for n in drive.quantities if n in {*names, *parts} - {TOTAL_VISCOUS})
    problem, other = fit_lines(split_drive, more, output, step, r, "variance")
    better = solution.cost - other.cost > 10.0 * max(1.0, other.cost / problem.count)
    return (split_drive, more) if better else (drive, names)


def _log_fit(problem: LineProblem, solution: Solution) -> float:
    """Share of the logarithmic response that is explained [%]."""
    g, _ = problem.model.at(solution.point.values, False)
    return fit_percent(np.log(np.abs(problem.measured)), np.log(np.abs(g)))


def _residual_findings(chi: float, options: Options) -> list[Finding]:
    if chi < MAX_CHI_SQUARE:
        return []
    return [Finding(
        "warning", "response-not-explained", f"The residual of the response is {np.sqrt(chi):.2g} times the "
        "measured noise: distortion, leakage or a missing body. Weights and intervals are computed from the "
        "residual and are valid only if it is random over frequency.", {"chi_square_per_degree": float(chi)},
        "Look at the picture of the response; try one more body, or several runs with other phases.")]


def picture(problem: LineProblem, solution: Solution, s: Spectrum) -> PlotData:
    """Measured lines and the model through them."""
    f = problem.model.frequency
    dense = np.geomspace(f[0], f[-1], 600)
    g, _ = replace(problem.model, frequency=dense).at(solution.point.values, False)
    measured, _ = problem.model.at(solution.point.values, False)
    return PlotData("response", "Measured response and the drive fitted to it", "frequency [Hz]",
                   f"magnitude [{s.unit}]", {
                       "measured": (f, np.abs(problem.measured)), "model": (dense, np.abs(g)),
                       "phase measured": (f, np.degrees(np.angle(problem.measured))),
                       "phase model": (f, np.degrees(np.angle(measured)))})
