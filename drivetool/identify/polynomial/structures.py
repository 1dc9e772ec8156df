"""Black box by a polynomial structure: oe, bj, arx, armax, innovations.

Discrete-time prediction-error models as the literature compares them. The figures of the drive (poles,
notches, resonances, and by a continued fraction inertias and stiffnesses) come with intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, NotEnoughData
from drivetool.identify.estimate import Z95, Estimate, PlotData, estimate_from_fit, fit_percent, record_picture
from drivetool.identify.frequency import SpectraOptions, spectra
from drivetool.identify.polynomial.data import PolynomialData, data_of
from drivetool.identify.polynomial.frequency_oe import fit_to_response
from drivetool.identify.polynomial.pem_figures import ModelFigures, figures_of
from drivetool.identify.polynomial.pem_fit import PemFit, fit_structure
from drivetool.identify.polynomial.pem_model import KINDS, POLYNOMIALS, Prediction, Stretch, Structure
from drivetool.identify.polynomial.realise import chain_parameters, conversion, ringing_frequencies_with_std
from drivetool.identify.polynomial.structure_findings import bodies_advice, model_findings
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import HELD_OUT_SHARE, Options, refuse_other_free
from drivetool.logs import Experiment

TRIED_ORDERS = (1, 3, 5, 7)  # a chain of n bodies has 2 n - 1 states from torque to speed
# Of the least residual, up to which the lowest order is taken; a choice against noise in the score.
MAX_SIMPLER_RESIDUAL_RATIO = 1.05
DEFAULT_NOISE_ORDER = 2  # a choice: one resonance of the noise, for which the poles need a pair


def polynomial_blackbox(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """A polynomial model, its figures, and start values of the drive where they follow.

    experiments  motor_torque and motor_speed or motor_angle (then the mean speed of each interval),
                 fitted together, each stretch with start values of its own
    drive        a chain of any length; its converter and dead time take no part
    options      structure; order: None to choose by held-out score; noise_order of C and D
    returns      Estimate; details: polynomials, poles, zeros, resonances, notches
    raises       BadOption: unknown structure or an order below one; NotEnoughData
    source       Ostring et al. 2003, sec. 6; Ljung 1999
    """
    kind = options.structure
    if kind not in KINDS:
        raise BadOption("a known structure", f"'{kind}'", "Correct --structure.", KINDS)
    if (options.order is not None and options.order < 1) or (options.noise_order or 0) < 0:
        raise BadOption("an order of at least 1", f"{options.order}", "Correct --order or --noise-order.")
    if options.criterion == "frequency" and kind != "oe":
        raise BadOption("structure oe for a fit in the frequency domain", kind,
                        "Use --structure oe: a frequency response has no noise model.")
    drive.require(options.hold, "holding them (--hold)")
    refuse_other_free("blackbox --structure", options.free, ())
    data = data_of(experiments)
    _check_changes(data)
    noise = DEFAULT_NOISE_ORDER if options.noise_order is None else options.noise_order
    order, table = choose_order(data, kind, noise) if options.order is None else (options.order, [])
    fit = fit_structure(data.stretches, Structure(kind, order, noise, data.extra))
    if options.criterion != "frequency":
        return _structure_estimate(experiments, drive, data, figures_of(fit, data.step), table, options.hold)
    if data.extra:
        raise BadOption("a motor speed for a polynomial model in the frequency domain", "an angle",
                        "Log the speed, or use greybox --criterion frequency.")
    fit, chi = fit_to_response(fit, spectra(experiments, SpectraOptions(band=options.band)).mean, data.step,
                                options.weighting)
    estimate = _structure_estimate(experiments, drive, data, figures_of(fit, data.step), table, options.hold)
    return replace(estimate, fit={**estimate.fit, "chi_square_per_degree": chi},
                   details={**estimate.details, "criterion": "frequency", "weighting": options.weighting})


def choose_order(data: PolynomialData, kind: str, noise: int) -> tuple[int, list[dict]]:
    """The order by its simulation of the held-out end of every stretch, and the scores of all orders."""
    train, rest = data.parts(1.0 - HELD_OUT_SHARE)
    table, reason = [], None
    for order in TRIED_ORDERS:
        try:
            fit = fit_structure(train.stretches, Structure(kind, order, noise, data.extra))
            score = simulated_fit(fit, data.step, rest.stretches)
        except NotEnoughData as error:
            reason = error
            continue
        table.append({"order": order, "held_out_simulation_fit_percent": score})
    known = [row for row in table if row["held_out_simulation_fit_percent"] is not None]
    if not known:
        raise reason or NotEnoughData("a stable model of any order", "none on the first part of the record",
                                      "Give --order, or excite more.")
    least = min(100.0 - row["held_out_simulation_fit_percent"] for row in known)
    good = [row for row in known
            if 100.0 - row["held_out_simulation_fit_percent"] <= MAX_SIMPLER_RESIDUAL_RATIO * least + 0.05]
    return good[0]["order"], table


def simulated_fit(fit: PemFit, step: float, stretches: Sequence[Stretch]) -> float | None:
    """Fit [%] of free runs over stretches, only their start values adjusted; None if it is unstable."""
    if figures_of(fit, step).unstable:
        return None
    pairs = [simulate_on(fit, s) for s in stretches if len(s.y) >= 3 * (fit.structure.order + 1)]
    if not pairs:
        raise NotEnoughData("a stretch long enough for cross-validation", "only shorter ones", "Record longer.")
    return _fit_of_pairs(pairs)


def _fit_of_pairs(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Fit [%] over all pairs of measured and simulated."""
    return fit_percent(*(np.concatenate(each) for each in zip(*pairs, strict=True)))


def simulate_on(fit: PemFit, stretch: Stretch) -> tuple[np.ndarray, np.ndarray]:
    """(measured, simulated) of a free run; the start values are fitted."""
    s, values = fit.structure, fit.values
    free = replace(s, kind="oe")
    stand_in = np.concatenate([values[s.part("B")], values[s.part(s.dynamics)]])
    mean_u, mean_y = stretch.u.mean(), stretch.y.mean()
    moved = replace(stretch, u=stretch.u - mean_u, y=stretch.y - mean_y)
    problem = Prediction(free, (moved,), np.ones(len(stand_in)), np.ones(len(stand_in), bool))
    point = solve(problem, Point(stand_in, problem.zeros()), max_iterations=5, damping=1e-9).point
    return stretch.y, problem.simulated(stand_in, point.starts[0], moved) + mean_y


def _check_changes(data: PolynomialData) -> None:
    """Raise NotEnoughData unless torque and output change."""
    if all(np.ptp(s.u) == 0.0 for s in data.stretches):
        raise NotEnoughData("a motor torque that changes", "a constant one", "Record while the drive is excited.")
    if all(np.ptp(s.y) == 0.0 for s in data.stretches):
        raise NotEnoughData(f"a {data.role.replace('_', ' ')} that changes", "a constant one",
                            "Check the channel, or whether the drive was blocked.")


def _structure_estimate(experiments: Sequence[Experiment], drive: Drive, data: PolynomialData,
                        figures: ModelFigures,
                        table: list[dict], hold: Sequence[str]) -> Estimate:
    fit = figures.fit
    found, covariance, why = conversion(drive, figures, data.extra)
    own = {} if covariance is None else {
        "drive_rad_s": {n: {"value": w, "std": std}
                        for n, (w, std) in ringing_frequencies_with_std(drive, found, covariance).items()}}
    lines = chain_parameters(drive, found, hold)
    fitted = {p.name: p.value for p in lines if p.status in ("fitted", "at-bound", "not-identifiable")}
    after = drive.with_values({n: v for n, v in fitted.items() if n in found})
    pairs = [] if figures.unstable else [simulate_on(fit, s) for s in data.stretches]
    e = np.concatenate([fit.problem.errors(fit.values, a, d) for a, d in zip(
        fit.solution.point.starts, fit.problem.stretches, strict=True)])
    measured = np.concatenate([d.y for d in fit.problem.stretches])
    simulation = _fit_of_pairs(pairs) if pairs else None
    s = fit.structure
    return estimate_from_fit(
        "blackbox", experiments, after, lines, covariance,
        outcome=f"{s.kind} of order {s.order}: {'converged' if fit.solution.converged else 'stopped'} after "
        f"{fit.solution.iterations} iterations" + (f"; {why}" if why else ""),
        fit={"simulation_fit_percent": simulation, "one_step_fit_percent": fit_percent(measured, measured - e),
         "rmse": float(np.sqrt(np.mean(np.concatenate([a - b for a, b in pairs]) ** 2))) if pairs else None,
         "n": int(fit.problem.count), "parameters": len(s.names), "noise_parameters": s.noise_parameters},
        noise={f"one_step_std.{data.role}": fit.sigma}, details=_model_details(figures, table) | own,
        findings=(*bodies_advice(drive, s.kind, s.order, table), *model_findings(figures, data, why, simulation)),
        exhibits=_model_plots(figures, data, pairs, experiments[0]))


def _model_details(f: ModelFigures, table: list[dict]) -> dict[str, object]:
    """Polynomials, roots and pairs as plain numbers."""
    s, values = f.fit.structure, f.fit.values

    def as_pairs(roots) -> list:
        return [[r.s.real, r.s.imag] for r in roots]

    return {
        "structure": s.kind, "order": s.order, "noise_order": s.noise if s.noise_parameters else 0, "step": f.step,
        "polynomials_over_1/q": {p: s.polynomial(p, values).tolist() for p in POLYNOMIALS[s.kind]},
        "poles_rad_s": as_pairs(f.poles), "zeros_rad_s": as_pairs(f.zeros),
        "resonances": [f.pair(p) for p in f.resonances], "notches": [f.pair(p) for p in f.notches],
        "unstable": f.unstable, "errors_white_p": f.fit.whiteness_p, "errors_std": f.fit.sigma,
        **({"orders": table} if table else {})}


def _model_plots(f: ModelFigures, data: PolynomialData, pairs: Sequence[tuple[np.ndarray, np.ndarray]],
                 e: Experiment,
                ) -> tuple[PlotData, ...]:
    """Measured and simulated; the response with its 95 % region."""
    s, found = f.fit.structure, []
    for run, (y, x) in zip(data.stretches, pairs, strict=False):
        time = np.arange(len(y)) * data.step
        found.append(record_picture(f"{run.name}: {s.kind} of order {s.order}, free run",
                                    f"motor speed [{e.motion_unit}/s]", time, y, x))
    pole = [abs(r.s) for r in f.poles if r.s.imag > 0.0] or [0.1 / data.step]
    low, high = 0.05 * min(pole), min(3.0 * max(pole), 0.9 * np.pi / data.step)
    hz = np.geomspace(low, max(high, 2.0 * low), 400) / (2.0 * np.pi)
    g, std = f.response(hz)
    size = np.abs(g)
    found.append(PlotData("response", f"{s.kind} of order {s.order} with its 95 % region", "frequency [Hz]",
        f"magnitude [{e.motion_unit}/s/{e.torque_unit}]", {
        "magnitude": (hz, size), "band low": (hz, np.maximum(size - Z95 * std, 0.05 * size)),
        "band high": (hz, size + Z95 * std), "phase": (hz, np.degrees(np.angle(g)))}))
    return tuple(found)
