"""From a fitted transfer function to the parameters of the drive, with intervals or the reason why not.

Every figure is a number with its gradient over the coefficients, so its standard deviation follows
from their covariance with the exact Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive, Dual
from drivetool.identify.blackbox.blackbox_findings import bode, converted_run, findings_of, lacking
from drivetool.identify.blackbox.transfer import VISCOUS, Form, impossible, to_physical
from drivetool.identify.estimate import (
    Z95,
    Covariance,
    Estimate,
    Parameter,
    covariance_of,
    fit_percent,
    held_uncertainty,
)
from drivetool.identify.noise import filtered
from drivetool.identify.outcome import (
    CORRELATED,
    how_it_ended,
    noise_figures,
    one_step_percent,
    record_exhibits,
    still_correlated,
)
from drivetool.identify.problem import Point, Problem, solve
from drivetool.identify.setup import Options, Outcome, reverses, traces_of
from drivetool.logs import sources

ONE_SIDED = 1.645
IMPLAUSIBLE = 3.0  # idle torque over the largest torque of the record
UNTOLD = "friction and idle torque cannot be told apart in this record"


@dataclass(frozen=True)
class Physical:
    """What the coefficients stand for: the model, the drive it is of, and what the user asked."""

    form: Form
    drive: Drive
    options: Options

    @property
    def names(self) -> dict[str, str]:
        """Key of `to_physical` -> parameter of the drive that takes it."""
        bodies, one = self.drive.bodies, self.form.order == 1
        found = {"motor": f"{bodies[0]}.inertia"}
        if not one:
            shaft = self.drive.shafts[0]
            found |= {"load": f"{bodies[1]}.inertia", "stiffness": f"{shaft}.stiffness",
                      "damping": f"{shaft}.damping"}
        owner = bodies[0] if one else "total"
        if VISCOUS in self.form.names:
            found[VISCOUS] = f"{owner}.viscous"
        idle = ["total.idle_torque", *(f"{b}.idle_torque" for b in bodies)]
        if not any(n in self.drive.values or n in self.options.hold for n in idle):
            found["offset"] = f"{owner}.idle_torque"
        return found


@dataclass(frozen=True)
class Uncertain:
    """Numbers with gradients, and the covariance (k, k) of what the gradients are over."""

    covariance: np.ndarray
    lost: np.ndarray

    def std(self, number: Dual) -> float | None:
        """Standard deviation; None where the record says nothing about the number."""
        if np.any(self.lost & (number.d != 0.0)):
            return None
        variance = number.d @ self.covariance @ number.d
        return float(np.sqrt(variance)) if np.isfinite(variance) and variance > 0.0 else None

    def figure(self, number: Dual) -> dict[str, float | None]:
        """Value and standard deviation as plain numbers."""
        return {"value": float(number.v), "std": self.std(number)}


def estimate_of(physical: Physical, outcome: Outcome, gain: float) -> Estimate:
    """The Estimate of a black-box fit.

    gain  log likelihood over that of a model of one body; infinite if there is no shaft
    """
    form, drive, task = physical.form, physical.drive, outcome.task
    c = form.seeds(outcome.solution.point.values)
    sure = uncertain(physical, outcome)
    numbers, lack = converted(physical, outcome, c, sure, gain)
    lines = parameters(physical, numbers, sure, lack[0] if lack else "")
    after = drive.with_values({p.name: p.value for p in lines if np.isfinite(p.value)
                               and p.name in physical.names.values()})
    traces = traces_of(task.experiments, task.roles)
    runs = simulated(form, outcome)
    y, s = (np.concatenate([a[:, 0] for a in arrays]) for arrays in ([t.outputs for t in traces], runs))
    run = None if lack else converted_run(replace(task, drive=after))
    figures = {
        "simulation_fit_percent": fit_percent(y, s), "one_step_fit_percent": one_step_percent(outcome, y),
        "rmse": float(np.sqrt(np.nanmean((y - s) ** 2))), "n": int(np.isfinite(y).sum()),
        **({"converted_simulation_fit_percent": fit_percent(y, run)} if run is not None else {})}
    figured = details(form, c, numbers, sure)
    noise, more = noise_figures(outcome)
    own = findings_of(replace(task, drive=after), lines, lack, figured, traces, runs)
    return Estimate(
        "blackbox", after, lines, how_it_ended(outcome), figures, _covariance(physical, lines, numbers, sure),
        noise, {**figured, "log_likelihood_gain_of_the_shaft": gain if np.isfinite(gain) else None,
                "starts": list(outcome.starts), "outputs": list(task.roles.outputs)},
        (*own, *more, *([CORRELATED] if still_correlated(outcome) else [])), sources(task.experiments), {},
        (*record_exhibits(outcome, traces, runs), bode(form, outcome, drive)))


def uncertain(physical: Physical, outcome: Outcome) -> Uncertain:
    """Covariance of the coefficients, with what the friction that is held adds to it."""
    # Friction at its bound of zero may well be larger: the others' intervals must not rely on it.
    open_ended = replace(outcome.problem, low=np.full_like(outcome.problem.low, -np.inf))
    covariance, inflation, free = covariance_of(open_ended, outcome.solution)
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    known, form = physical.options.known, physical.form
    name = "total.viscous" if form.order > 1 else f"{physical.drive.bodies[0]}.viscous"
    held = known is not None and name in known.names and name in physical.drive.values
    if held and outcome.fit is not None and VISCOUS not in form.names:
        i, problem, point = known.names.index(name), outcome.problem, outcome.solution.point
        gains = [f.gains for f in filtered(problem, point, outcome.fit.noise)]
        wide = replace(form, names=(*form.names, VISCOUS))
        problem = replace(problem, build=wide.build, names=wide.names)
        point = replace(point, values=np.append(point.values, form.viscous))
        if outcome.fit.noise.memory is None:
            covariance = covariance + held_uncertainty(
                problem, problem.normal(point, gains), Covariance((VISCOUS,), known.matrix[i:i + 1, i:i + 1]))
    return Uncertain(covariance, ~np.isfinite(inflation) & free)


def converted(physical: Physical, outcome: Outcome, c: Mapping[str, Dual], sure: Uncertain,
              gain: float) -> tuple[dict[str, Dual], tuple[str, ...]]:
    """(physical numbers, ()), or (what can still be told, (reason, code)) if there is no conversion."""
    form = physical.form
    values = {n: d.v for n, d in c.items()}
    kept = _resistance(physical, outcome, c, sure)
    lack = lacking(gain)
    if lack:
        return kept, (lack, "shaft-not-excited")
    reason = impossible(values)
    if reason:
        return {}, (reason, "impossible-conversion")
    numbers = to_physical(form, c) | kept
    for key, name in physical.names.items():
        low, high = physical.drive.quantity(name).bounds
        value = numbers[key].v if key in numbers else low
        if value > high or (value < low and key not in ("damping", VISCOUS)):
            return {}, (f"{name} comes out as {value:.4g}, which is not physical",
                        "impossible-conversion")
    return numbers, ()


def _resistance(physical: Physical, outcome: Outcome, c: Mapping[str, Dual],
                sure: Uncertain) -> dict[str, Dual]:
    """Idle torque and friction; nothing if the record does not tell them at all."""
    largest = max(float(np.abs(t.inputs[:, 0]).max()) for t in outcome.problem.traces)
    std = sure.std(c["offset"])
    if std is None or std > largest or abs(c["offset"].v) > IMPLAUSIBLE * largest:
        return {}
    return {"offset": c["offset"] - _coulomb(physical.drive, outcome), VISCOUS: c[VISCOUS]}


def _coulomb(drive: Drive, outcome: Outcome) -> float:
    """Known Coulomb friction felt at the motor, which the offset of a one-way record contains."""
    felt = drive.felt("coulomb")
    if not felt or reverses(outcome.task.experiments):
        return 0.0
    t = max(outcome.problem.traces, key=lambda t: t.size)
    y = t.outputs[np.isfinite(t.outputs[:, 0]), 0]
    way = y[-1] - y[0] if outcome.task.roles.outputs[0].endswith("angle") else y.mean()
    return float(felt * np.sign(way))


def parameters(physical: Physical, numbers: Mapping[str, Dual], sure: Uncertain,
               lack: str) -> tuple[Parameter, ...]:
    """One line per value of the drive."""
    drive, lines = physical.drive, {}
    for key, name in physical.names.items():
        start = drive.values.get(name)
        if key in numbers:
            line = _line(physical, key, name, numbers[key], sure.std(numbers[key]))
        else:
            value = float("nan") if start is None else start
            line = Parameter(name, value, drive.unit(name), start, status="not-identifiable",
                             reason=lack or UNTOLD)
        if name in physical.options.hold:
            found = f"; the black box gives {line.value:.4g}" if line.status == "fitted" else ""
            line = Parameter(name, drive.value(name), drive.unit(name), start, status="held",
                             reason=f"held at its value{found}; the other values do not depend on it")
        lines[name] = line
    for name, value in drive.values.items():
        lines.setdefault(name, Parameter(name, float(value), drive.unit(name), float(value), status="held",
                                         reason="as given; not fitted in this step"))
    return tuple(lines[n] for n in drive.quantities if n in lines)


def _line(physical: Physical, key: str, name: str, number: Dual, std: float | None) -> Parameter:
    """One converted value."""
    drive, value = physical.drive, float(number.v)
    common = (drive.unit(name), drive.values.get(name))
    low, high = drive.quantity(name).bounds
    if key in ("damping", VISCOUS) and value <= 0.0:
        upper = (0.0, max(0.0, value + ONE_SIDED * std)) if std is not None else None
        return Parameter(name, 0.0, *common, None, upper, "at-bound",
                         f"came out as {value:.4g}, and no damping is below zero")
    if std is None:
        return Parameter(name, value, *common, status="not-identifiable",
                         reason="the record says nothing about it")
    if key != "offset" and std > value:
        return Parameter(name, value, *common, status="not-identifiable",
                         reason=f"its standard deviation ({std:.2g}) is larger than itself")
    return Parameter(name, value, *common, std, (max(value - Z95 * std, low), min(value + Z95 * std, high)))


def _covariance(physical: Physical, lines: tuple[Parameter, ...], numbers: Mapping[str, Dual],
                sure: Uncertain) -> Covariance | None:
    """Of the parameters that have an interval."""
    fitted = {p.name for p in lines if p.std is not None}
    keys = [k for k, name in physical.names.items() if name in fitted]
    if not keys:
        return None
    jacobian = np.array([numbers[k].d for k in keys])
    return Covariance(tuple(physical.names[k] for k in keys), jacobian @ sure.covariance @ jacobian.T)


def details(form: Form, c: Mapping[str, Dual], numbers: Mapping[str, Dual],
            sure: Uncertain) -> dict[str, object]:
    """Coefficients, poles, zeros and what the conversion left over."""
    found: dict[str, object] = {
        "model": "b / (s + p)" if form.order == 1 else "(b2 s^2 + b1 s + b0) / ((s + p) (s^2 + a2 s + a1))",
        "coefficients": {n: sure.figure(c[n]) for n in form.names} | {"p": sure.figure(form.pole(c))}}
    if form.order == 1:
        return found
    if c["a1"].v > 0.0:
        resonance, damping = _oscillation(c["a2"], c["a1"])
        found["resonance"] = {"rad_s": sure.figure(resonance), "hz": sure.figure(resonance / (2.0 * np.pi)),
                              "damping_ratio": sure.figure(damping)}
        roots = sorted(np.roots([1.0, c["a2"].v, c["a1"].v]), key=lambda r: (r.real, r.imag))
        found["poles_rad_s"] = [[0.0 - form.pole(c).v, 0.0], *([float(r.real), float(r.imag)] for r in roots)]
    if c["b2"].v * c["b0"].v > 0.0:
        notch, damping = _oscillation(c["b1"] / c["b2"], c["b0"] / c["b2"])
        found["anti_resonance"] = {"rad_s": sure.figure(notch), "hz": sure.figure(notch / (2.0 * np.pi)),
                                   "damping_ratio": sure.figure(damping)}
    if c["b0"].v * c["a1"].v > 0.0:
        found["total_inertia_at_motor"] = sure.figure(c["a1"] / c["b0"])
    if "left_over" in numbers:
        left = numbers["left_over"]
        std = sure.std(left)
        found["left_over"] = {"b1": c["b1"].v, "b1_from_parameters": c["b1"].v - left.v, "std": std,
                              "in_std": left.v / std if std else None}
    return found


def _oscillation(linear: Dual, constant: Dual) -> tuple[Dual, Dual]:
    """(frequency, damping ratio) of s^2 + linear s + constant."""
    w = float(np.sqrt(constant.v))
    frequency = Dual(w, constant.d / (2.0 * w))
    return frequency, linear / (2.0 * frequency)


def simulated(form: Form, outcome: Outcome) -> list[np.ndarray]:
    """Free runs of the fitted transfer function, only the start states fitted to them."""
    task, values = outcome.task, outcome.solution.point.values
    problem = replace(fixed(outcome.problem, values), traces=traces_of(task.experiments, task.roles))
    starts = tuple(form.rest(t) for t in problem.traces)
    found = solve(problem, Point(np.empty(0), starts), most=20).point.starts
    plants = problem.plants(values, False)
    return [p.outputs(t, s) for p, t, s in zip(plants, problem.traces, found, strict=True)]


def fixed(problem: Problem, values: np.ndarray) -> Problem:
    """The problem with its parameters fixed, so that only the start states are left."""
    none = np.empty(0)
    return replace(
        problem, names=(), low=none, high=none, size=none,
        build=lambda _, trace, gradient, memory: problem.build(values, trace, gradient, memory))
