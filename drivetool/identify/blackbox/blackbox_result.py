"""From a fitted transfer function to the parameters of the drive, with intervals or the reason for none.

Every figure is a number with its gradient over the coefficients, so its standard deviation follows
from their covariance with the exact Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive, Dual
from drivetool.identify.blackbox.blackbox_findings import blackbox_findings, bode, converted_run
from drivetool.identify.blackbox.transfer import VISCOUS, TransferForm, to_physical, why_impossible
from drivetool.identify.estimate import (
    Z95_ONE_SIDED,
    Covariance,
    Estimate,
    Parameter,
    covariance_of,
    fit_percent,
    held_line,
    held_uncertainty,
    line_of,
    std_by_gradient,
    whole_table,
)
from drivetool.identify.noise import filtered
from drivetool.identify.outcome import (
    CORRELATED,
    estimate_from_outcome,
    outcome_figures,
    record_plots,
    still_correlated,
)
from drivetool.identify.problem import Point, Problem, solve
from drivetool.identify.setup import Options, Outcome, reverses, traces_of
from drivetool.quantity import name_of, names_of

# Log likelihood that the shaft must gain over one rigid body. Chance gains 6 on average and at most
# 16 in 360 records of mere noise; the resonance of a 2 s record in heavy noise gains 28 and more.
MIN_BLACKBOX_SHAFT_GAIN = 20.0
# Idle torque over the largest torque of the record. A choice: the motor could not overcome it.
MAX_IDLE_TORQUE_RATIO = 3.0
NOT_SEPARABLE_TEXT = "friction and idle torque cannot be separated in this record"


@dataclass(frozen=True)
class PhysicalModel:
    """The meaning of the coefficients: the model, its drive, and the options of the user."""

    form: TransferForm
    drive: Drive
    options: Options

    @property
    def names(self) -> dict[str, str]:
        """Key of `to_physical` -> parameter of the drive that takes it."""
        bodies, one = self.drive.bodies, self.form.order == 1
        found = {"motor": name_of(bodies[0], "inertia")}
        if not one:
            shaft = self.drive.shafts[0]
            found |= {"load": name_of(bodies[1], "inertia"), "stiffness": name_of(shaft, "stiffness"),
                      "damping": name_of(shaft, "damping")}
        owner = bodies[0] if one else "total"
        if VISCOUS in self.form.names:
            found[VISCOUS] = name_of(owner, "viscous")
        idle = ["total.idle_torque", *names_of(bodies, "idle_torque")]
        if not any(n in self.drive.values or n in self.options.hold for n in idle):
            found["offset"] = name_of(owner, "idle_torque")
        return found


@dataclass(frozen=True)
class Uncertainty:
    """Covariance (k, k) of the coefficients, for numbers with gradients over them; lost: (k,) not identifiable."""

    covariance: np.ndarray
    lost: np.ndarray

    def std(self, number: Dual) -> float | None:
        """Standard deviation; None where the record has no information on the number."""
        lost = np.any(self.lost & (number.d != 0.0))
        return None if lost else std_by_gradient(number.d, self.covariance)

    def figure(self, number: Dual) -> dict[str, float | None]:
        """Value and standard deviation as plain numbers."""
        return {"value": float(number.v), "std": self.std(number)}


def estimate_of(physical: PhysicalModel, outcome: Outcome, gain: float) -> Estimate:
    """The Estimate of a black-box fit.

    gain  log likelihood over that of a model of one body; infinite if there is no shaft
    """
    form, drive, task = physical.form, physical.drive, outcome.task
    c = form.seeds(outcome.solution.point.values)
    uncertainty = uncertainty_of(physical, outcome)
    numbers, lack = converted(physical, outcome, c, uncertainty, gain)
    lines = parameters(physical, numbers, uncertainty, lack[0] if lack else "")
    after = drive.with_values({p.name: p.value for p in lines if np.isfinite(p.value)
                               and p.name in physical.names.values()})
    traces = traces_of(task.experiments, task.roles)
    runs = simulated(form, outcome)
    figures = outcome_figures(outcome, traces, runs)
    run = None if lack else converted_run(replace(task, drive=after))
    if run is not None:
        y = np.concatenate([t.outputs[:, 0] for t in traces])
        figures["converted_simulation_fit_percent"] = fit_percent(y, run)
    detail = details(form, c, numbers, uncertainty)
    own = blackbox_findings(replace(task, drive=after), lines, lack, detail, traces, runs)
    return estimate_from_outcome(
        "blackbox", after, lines, _covariance(physical, lines, numbers, uncertainty), outcome, fit=figures,
        details={**detail, "log_likelihood_gain_of_the_shaft": gain if np.isfinite(gain) else None},
        findings=[*own, *([CORRELATED] if still_correlated(outcome) else [])],
        exhibits=(*record_plots(outcome, traces, runs), bode(form, outcome, drive)))


def uncertainty_of(physical: PhysicalModel, outcome: Outcome) -> Uncertainty:
    """Covariance of the coefficients, including the uncertainty of the friction that is held."""
    # Friction at its bound of zero may well be larger: the other intervals must not rely on it.
    open_ended = replace(outcome.problem, low=np.full_like(outcome.problem.low, -np.inf))
    covariance, inflation, free = covariance_of(open_ended, outcome.solution)
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    known, form = physical.options.known, physical.form
    name = "total.viscous" if form.order > 1 else name_of(physical.drive.bodies[0], "viscous")
    held = known is not None and name in known.names and name in physical.drive.values
    if held and outcome.fit is not None and VISCOUS not in form.names:
        i, problem, point = known.names.index(name), outcome.problem, outcome.solution.point
        gains = [f.gains for f in filtered(problem, point, outcome.fit.noise)]
        extended = replace(form, names=(*form.names, VISCOUS))
        problem = replace(problem, build=extended.build, names=extended.names)
        point = replace(point, values=np.append(point.values, form.viscous))
        if outcome.fit.noise.memory is None:
            covariance = covariance + held_uncertainty(
                problem, problem.normal(point, gains), Covariance((VISCOUS,), known.matrix[i:i + 1, i:i + 1]))
    return Uncertainty(covariance, ~np.isfinite(inflation) & free)


def converted(physical: PhysicalModel, outcome: Outcome, c: Mapping[str, Dual], uncertainty: Uncertainty,
              gain: float) -> tuple[dict[str, Dual], tuple[str, ...]]:
    """(physical numbers, ()), or (numbers still identifiable, (reason, code)) if there is no conversion."""
    form = physical.form
    friction = _friction_numbers(physical, outcome, c, uncertainty)
    if not gain >= MIN_BLACKBOX_SHAFT_GAIN:
        return friction, ("the oscillation of the shaft is not significant: one rigid body explains the record as "
                          "well", "shaft-not-identifiable")
    if reason := why_impossible({n: d.v for n, d in c.items()}):
        return {}, (reason, "no-conversion")
    numbers = to_physical(form, c) | friction
    for key, name in physical.names.items():
        low, high = physical.drive.quantity(name).bounds
        value = numbers[key].v if key in numbers else low
        if value > high or (value < low and key not in ("damping", VISCOUS)):
            return {}, (f"{name} is estimated as {value:.4g}, which is not physical",
                        "no-conversion")
    return numbers, ()


def _friction_numbers(physical: PhysicalModel, outcome: Outcome, c: Mapping[str, Dual],
                uncertainty: Uncertainty) -> dict[str, Dual]:
    """Idle torque and friction; empty if the record does not identify them at all."""
    largest = max(float(np.abs(t.inputs[:, 0]).max()) for t in outcome.problem.traces)
    std = uncertainty.std(c["offset"])
    if std is None or std > largest or abs(c["offset"].v) > MAX_IDLE_TORQUE_RATIO * largest:
        return {}
    return {"offset": c["offset"] - _known_coulomb(physical.drive, outcome), VISCOUS: c[VISCOUS]}


def _known_coulomb(drive: Drive, outcome: Outcome) -> float:
    """Known Coulomb friction referred to the motor, which the offset of a record in one direction contains."""
    referred = drive.referred_to_motor("coulomb")
    if not referred or reverses(outcome.task.experiments):
        return 0.0
    t = max(outcome.problem.traces, key=lambda t: t.size)
    y = t.outputs[np.isfinite(t.outputs[:, 0]), 0]
    motion = y[-1] - y[0] if outcome.task.roles.outputs[0].endswith("angle") else y.mean()
    return float(referred * np.sign(motion))


def parameters(physical: PhysicalModel, numbers: Mapping[str, Dual], uncertainty: Uncertainty,
               lack: str) -> tuple[Parameter, ...]:
    """One line per value of the drive."""
    drive, lines = physical.drive, []
    for key, name in physical.names.items():
        if key in numbers:
            line = _converted_parameter(physical, key, name, numbers[key], uncertainty.std(numbers[key]))
        else:
            line = line_of(drive, name, drive.values.get(name, float("nan"))).without_interval(
                lack or NOT_SEPARABLE_TEXT, "not-identifiable")
        if name in physical.options.hold:
            found = f"; the black box gives {line.value:.4g}" if line.status == "fitted" else ""
            line = held_line(drive, name, f"held at its value{found}; the other values do not depend on it")
        lines.append(line)
    return whole_table(lines, drive)


def _converted_parameter(
        physical: PhysicalModel, key: str, name: str, number: Dual, std: float | None) -> Parameter:
    """One converted value."""
    value, drive = float(number.v), physical.drive
    line = line_of(drive, name, value)
    if key in ("damping", VISCOUS) and value <= 0.0:
        return line.beyond_bound(0.0, None if std is None else Z95_ONE_SIDED * std,
                                 f"estimated as {value:.4g}, but damping cannot be negative")
    if std is None:
        return line.without_interval("the record has no information on this parameter", "not-identifiable")
    if key != "offset" and std > value:
        return line.without_interval(f"its standard deviation ({std:.2g}) is larger than itself",
                                     "not-identifiable")
    return line.with_interval(std, drive.quantity(name).bounds)


def _covariance(physical: PhysicalModel, lines: tuple[Parameter, ...], numbers: Mapping[str, Dual],
                uncertainty: Uncertainty) -> Covariance | None:
    """Of the parameters that have an interval."""
    fitted = {p.name for p in lines if p.std is not None}
    keys = [k for k, name in physical.names.items() if name in fitted]
    if not keys:
        return None
    jacobian = np.array([numbers[k].d for k in keys])
    return Covariance(tuple(physical.names[k] for k in keys), jacobian @ uncertainty.covariance @ jacobian.T)


def details(form: TransferForm, c: Mapping[str, Dual], numbers: Mapping[str, Dual],
            uncertainty: Uncertainty) -> dict[str, object]:
    """Coefficients, poles, zeros and the conversion error."""
    found: dict[str, object] = {
        "model": "b / (s + p)" if form.order == 1 else "(b2 s^2 + b1 s + b0) / ((s + p) (s^2 + a2 s + a1))",
        "coefficients": {n: uncertainty.figure(c[n]) for n in form.names} | {"p": uncertainty.figure(form.pole(c))}}
    if form.order == 1:
        return found
    if c["a1"].v > 0.0:
        found["resonance"] = _oscillation(c["a2"], c["a1"], uncertainty)
        roots = sorted(np.roots([1.0, c["a2"].v, c["a1"].v]), key=lambda r: (r.real, r.imag))
        found["poles_rad_s"] = [[0.0 - form.pole(c).v, 0.0], *([float(r.real), float(r.imag)] for r in roots)]
    if c["b2"].v * c["b0"].v > 0.0:
        found["anti_resonance"] = _oscillation(c["b1"] / c["b2"], c["b0"] / c["b2"], uncertainty)
    if c["b0"].v * c["a1"].v > 0.0:
        found["total_inertia_at_motor"] = uncertainty.figure(c["a1"] / c["b0"])
    if "left_over" in numbers:
        error = numbers["left_over"]
        std = uncertainty.std(error)
        found["left_over"] = {"b1": c["b1"].v, "b1_from_parameters": c["b1"].v - error.v, "std": std,
                              "in_std": error.v / std if std else None}
    return found


def _oscillation(linear: Dual, constant: Dual, uncertainty: Uncertainty) -> dict[str, dict[str, float | None]]:
    """Frequency and damping ratio of s^2 + linear s + constant."""
    w = float(np.sqrt(constant.v))
    frequency = Dual(w, constant.d / (2.0 * w))
    numbers = {"rad_s": frequency, "hz": frequency / (2.0 * np.pi), "damping_ratio": linear / (2.0 * frequency)}
    return {name: uncertainty.figure(number) for name, number in numbers.items()}


def simulated(form: TransferForm, outcome: Outcome) -> list[np.ndarray]:
    """Free runs of the fitted transfer function with fitted start states."""
    task, values = outcome.task, outcome.solution.point.values
    problem = replace(
        with_fixed_parameters(outcome.problem, values), traces=traces_of(task.experiments, task.roles))
    starts = tuple(form.rest(t) for t in problem.traces)
    found = solve(problem, Point(np.empty(0), starts), max_iterations=20).point.starts
    plants = problem.plants(values, False)
    return [p.outputs(t, s) for p, t, s in zip(plants, problem.traces, found, strict=True)]


def with_fixed_parameters(problem: Problem, values: np.ndarray) -> Problem:
    """The problem with its parameters fixed, so that only the start states are left."""
    none = np.empty(0)
    return replace(
        problem, names=(), low=none, high=none, size=none,
        build=lambda _, trace, gradient, memory: problem.build(values, trace, gradient, memory))
