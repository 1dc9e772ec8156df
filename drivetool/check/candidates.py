"""The causes that diagnose can add to a drive: what each frees, and where its fit starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.diagnosis import State
from drivetool.check.instants import load_steps
from drivetool.check.model import Model, everything, fit
from drivetool.check.scan import half_gaps, likely_large_tips, likely_middles, likely_orders, likely_tips
from drivetool.check.structure import carried, may_have_tip
from drivetool.drive.effects import EFFECTS
from drivetool.drive.effects.load_step import RECORDS, STEPS, TORQUES
from drivetool.identify.engine import Task
from drivetool.identify.noise import filtered, minus_log_likelihood
from drivetool.identify.problem import Point

SLOW = (0.02, 0.06, 0.2, 0.5)  # Stribeck speeds to start from, over the fastest motion
WARM = (0.15, 0.4, 1.0)  # time constants of a drift, over the length of the record
EARLIER = tuple(np.round(np.arange(0.1, 1.01, 0.1), 1).tolist())  # shares of a straight line between torques
QUIETER = 0.1  # torque noise under which a third mass is also looked for, over the base's
HIDING = 20.0  # log likelihood that so quiet a noise must cost, for a louder one to hide anything
LATE = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # delays and lags in samples
ORDERS = (1.0, 2.0)  # of a lag


@dataclass(frozen=True)
class Start:
    """Where the fit of a cause starts: the task with all that is free, and what is worth a first step.

    amplitudes  of the free names, those whose first guess a linear step gives
    steps       of its first fit; more where that begins far from the base
    quiet       the base under a quieter noise, where the fit is to begin; None: it begins under the base's
    """

    task: Task
    amplitudes: tuple[str, ...]
    steps: int = 5
    quiet: Model | None = None


@dataclass(frozen=True)
class Candidate:
    """A cause.

    code     in files and on the command line
    effect   code of the effect in the drive's catalogue, which has law, needs and literature
    starts   (base) -> where to start; empty if the base has it already, or drive or record cannot show it
    nests    codes of causes that are special cases of this one
    trace    (base) -> a start with hardly any of it, where no linear step at the neutral value tells what
             the record resolves; None: there is no such start, or `starts` have amplitudes
    """

    code: str
    effect: str
    starts: Callable[[Model], list[Start]]
    nests: tuple[str, ...] = ()
    trace: Callable[[Model], Start] | None = None


def added(base: Model, values: Mapping[str, float], amplitudes: Sequence[str], held: Sequence[str] = ()) -> Start:
    """The base with more parameters: `values` start them, all but `held` are free."""
    task = base.fitted
    drive = replace(task.drive, values={**task.drive.values, **values})
    new = {n for n in values if n not in held}
    free = tuple(n for n in drive.quantities if n in {*task.free, *new})
    return Start(replace(task, drive=drive, free=free), tuple(amplitudes))


def present(base: Model, name: str) -> bool:
    """Whether a parameter acts in the base or is one of its free ones."""
    drive = base.task.drive
    return name in base.task.free or drive.value(name) not in (None, drive.quantity(name).neutral)


def torque_size(base: Model, owner: str = "") -> float:
    """Spread of the motor torque, or of what the gears make of it at a body or in a shaft."""
    return turns(base, owner) * float(np.std(np.concatenate([t.inputs[:, 0] for t in base.problem.traces])))


def turns(base: Model, owner: str = "") -> float:
    """Of the motor for one of a body, or of the end of a shaft that has its stiffness; one without a name."""
    drive = base.task.drive
    at = drive.shafts.index(owner) + 1 if owner in drive.shafts else drive.bodies.index(owner) if owner else 0
    return abs(drive.turns()[at])


def motion(base: Model, body: str = "") -> tuple[float, float]:
    """(fastest speed of the motor, 98 % quantile, or of a body behind its gears; longest record [s])."""
    return (float(np.quantile(np.abs(np.concatenate(speeds(base))), 0.98)) / turns(base, body),
            max(t.size * t.step for t in base.problem.traces))


def speeds(base: Model) -> list[np.ndarray]:
    """Per trace (n,) the motor's speed, along a line where it was not measured."""
    found = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        y = np.interp(np.arange(len(y)), np.flatnonzero(np.isfinite(y)), y[np.isfinite(y)])
        found.append(np.gradient(y, t.step) if base.task.roles.outputs[0].endswith("angle") else y)
    return found


def travel(base: Model) -> float:
    """The largest way of the motor in a record, from one end to the other."""
    angle = base.task.roles.outputs[0].endswith("angle")
    ways = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        ways.append(float(np.nanmax(y) - np.nanmin(y)) if angle
                    else float(np.ptp(np.cumsum(np.nan_to_num(y)))) * t.step)
    return max(ways)


def ends(base: Model) -> tuple[str, ...]:
    """The bodies at which friction may be told apart: the last one only with more than one body."""
    bodies = base.task.drive.bodies
    return bodies[:1] if len(bodies) == 1 else (bodies[0], bodies[-1])


def _backlash(base: Model) -> list[Start]:
    found = []
    for shaft in base.task.drive.shafts:
        name = f"{shaft}.half_gap"
        if not present(base, name):
            found += [added(base, {name: value}, ()) for value in half_gaps(base, name, torque_size(base, shaft))]
    return found


def _without(base: Model, end: str, suffix: str) -> list[str]:
    """Of the motor, or of the bodies behind it (`end`: motor, load), those on which a friction does not act yet."""
    bodies = base.task.drive.bodies
    return [b for b in (bodies[:1] if end == "motor" else bodies[1:]) if not present(base, f"{b}.{suffix}")]


def _coulomb(end: str) -> Callable[[Model], list[Start]]:
    def starts(base: Model) -> list[Start]:
        found = []
        for body in _without(base, end, "coulomb"):
            name, size = f"{body}.coulomb", torque_size(base, body)
            found += [added(base, {name: 1e-6 * size}, (name,)), added(base, {name: 0.03 * size}, ())]
        return found
    return starts


def _stribeck(end: str) -> Callable[[Model], list[Start]]:
    def starts(base: Model) -> list[Start]:
        found = []
        for body, share in product(_without(base, end, "stribeck"), SLOW):
            size = torque_size(base, body)
            values = {f"{body}.stribeck": 1e-6 * size, f"{body}.stribeck_speed": share * motion(base, body)[0]}
            if not present(base, f"{body}.coulomb"):
                values[f"{body}.coulomb"] = 1e-6 * size
            found.append(added(base, values, [n for n in values if not n.endswith("speed")]))
        return found
    return starts


def _of_bodies(suffix: str) -> Callable[[Model], list[Start]]:
    """One amplitude, on any body."""
    def starts(base: Model) -> list[Start]:
        names = [f"{body}.{suffix}" for body in base.task.drive.bodies]
        if any(present(base, n) for n in names):
            return []
        return [added(base, {n: 0.0}, (n,)) for n in names]
    return starts


def _hardening(base: Model) -> list[Start]:
    found, drive = [], base.fitted.drive
    for shaft in drive.shafts:
        if present(base, f"{shaft}.hardening"):
            continue
        twist = 2.0 * torque_size(base, shaft) / drive.value(f"{shaft}.stiffness")
        for power in (2.0, 1.0):
            names = {f"{shaft}.hardening": 0.0, f"{shaft}.hardening_twist": twist,
                     f"{shaft}.hardening_power": power}
            found.append(added(base, names, (f"{shaft}.hardening",), held=(f"{shaft}.hardening_twist",)))
    return found


def _load_damping(base: Model) -> list[Start]:
    names = [f"{s}.load_damping" for s in base.task.drive.shafts]
    return [added(base, {n: 0.0}, (n,)) for n in names if not present(base, n)]


def _third_mass(base: Model) -> list[Start]:
    if not may_have_tip(base.task.drive):
        return []
    # A resonance that the base lacks may pass for torque noise, under which a third mass gains nothing any more.
    noise = replace(base.noise, ratio=QUIETER * base.noise.ratio)
    quiet = fit("base", base.task, base.problem, base.point, noise, everything(base.problem), rounds=3, renew=False)
    unheard = [] if quiet.value < base.value + HIDING else _thirds(quiet)
    return [Start(task, (), 10) for task in _thirds(base)] + [
        Start(task, (), 10, quiet) for task in unheard]


def _thirds(base: Model) -> list[Task]:
    return [*likely_tips(base), *likely_large_tips(base), *likely_middles(base)]


def _ripple(base: Model) -> list[Start]:
    body = base.task.drive.bodies[0]
    names = [f"{body}.ripple_sine", f"{body}.ripple_cosine"]
    if any(present(base, n) for n in names):
        return []
    return [added(base, {names[0]: 0.0, names[1]: 0.0, f"{body}.ripple_order": order}, names)
            for order in likely_orders(base)]


def _imbalance(base: Model) -> list[Start]:
    body = base.task.drive.bodies[-1]
    names = [f"{body}.imbalance_sine", f"{body}.imbalance_cosine"]
    if any(present(base, n) for n in names) or base.task.drive.motion_unit != "rad":
        return []
    return [added(base, dict.fromkeys(names, 0.0), names)]


def _drift(base: Model) -> list[Start]:
    """Of the motor's friction, or of all alike; with a sensor behind the shaft also of both ends by themselves."""
    drive, size, found = base.task.drive, torque_size(base), []
    dry = any(n.endswith(".coulomb") and present(base, n) for n in drive.quantities)
    owners = (*drive.bodies, "friction")
    if any(present(base, f"{owner}.drift_{kind}") for owner in owners for kind in ("viscous", "coulomb")):
        return []
    apart = any(not role.startswith("motor") for role in base.task.roles.outputs)
    for bodies in [drive.bodies[:1], *([ends(base)] if apart and len(drive.bodies) > 1 else [])]:
        names = [f"{body}.drift_viscous" for body in bodies] + [
            f"{body}.drift_coulomb" for body in bodies
            if (dry and body == drive.bodies[0]) or present(base, f"{body}.coulomb")]
        for share in WARM:
            values = {n: (1e-6 * size if n.endswith("coulomb") else 0.0) for n in names}
            times = {f"{body}.drift_time": share * motion(base)[1] for body in bodies}
            found.append(added(base, {**values, **times}, names))
    if len(drive.bodies) > 1:
        names = ["friction.drift_viscous", *["friction.drift_coulomb"] * dry]
        for share in WARM:
            found.append(added(base, {**dict.fromkeys(names, 0.0), "friction.drift_time": share * motion(base)[1]},
                               names))
    return found


def with_steps(base: Model, instants: Sequence[tuple[float, int]]) -> Start:
    """The base with loads that set in at these instants, in that record alone if its number is not zero."""
    body, values = base.task.drive.bodies[-1], {}
    unused = [step for step in STEPS if not present(base, f"{body}.{step}_torque")]
    for step, (time, record) in zip(unused, instants, strict=False):
        values |= {f"{body}.{step}_torque": 0.0, f"{body}.{step}_time": time}
        values |= {f"{body}.{step}_record": float(record)} if record else {}
    return added(base, values, [n for n in values if n.endswith(TORQUES)],
                 [n for n in values if n.endswith(RECORDS)])


def _load_step(base: Model) -> list[Start]:
    if present(base, f"{base.task.drive.bodies[-1]}.step_torque"):
        return []
    return [with_steps(base, instants) for instants in load_steps(base)]


def _dead_time(base: Model) -> list[Start]:
    name, step = "converter.dead_time", base.problem.traces[0].step
    return [] if present(base, name) else _likeliest(base, [added(base, {name: n * step}, ()) for n in LATE])


def _hold(base: Model) -> list[Start]:
    name = "converter.interpolation"
    if present(base, name):
        return []
    return _likeliest(base, [added(base, {name: share}, (), held=(name,)) for share in EARLIER])


def _lag(owner: str, role: str) -> Callable[[Model], list[Start]]:
    """Of first or of second order: a lag that is taken for one of the other order ends up somewhere else."""
    def starts(base: Model) -> list[Start]:
        name, order = f"{owner}.bandwidth", f"{owner}.order"
        if present(base, name) or (role and role not in base.task.roles.outputs):
            return []
        step = base.problem.traces[0].step
        return [start for each in ORDERS for start in _likeliest(base, [
            added(base, {name: 1.0 / (n * step), order: each}, (), held=(order,)) for n in LATE])]
    return starts


def _hardly_open(base: Model) -> Start:
    """A gap of a hundredth of the twist that the torque makes."""
    shaft = base.task.drive.shafts[0]
    twist = torque_size(base, shaft) / base.fitted.drive.value(f"{shaft}.stiffness")
    return added(base, {f"{shaft}.half_gap": 0.01 * twist}, ())


def _hardly_late(name: str, inverse: bool) -> Callable[[Model], Start]:
    """A delay, or the lag of a bandwidth, of the shortest length that is tried."""
    def trace(base: Model) -> Start:
        time = LATE[0] * base.problem.traces[0].step
        return added(base, {name: 1.0 / time if inverse else time}, ())
    return trace


def _likeliest(base: Model, starts: Sequence[Start]) -> list[Start]:
    """Of starts that differ in one value, the one under which the records are likeliest, all else held."""
    def loss(start: Start) -> float:
        problem = replace(start.task, free=()).problem()
        point = Point(np.empty(0), carried(base, start.task, problem).starts)
        return minus_log_likelihood(filtered(problem, point, base.noise, keep=False))
    return [min(starts, key=loss)]


def _offset(base: Model) -> list[Start]:
    drive = base.task.drive
    name = "total.idle_torque" if len(drive.bodies) > 1 else f"{drive.bodies[0]}.idle_torque"
    parts = [f"{b}.idle_torque" for b in drive.bodies]
    if name in base.task.free or any(p in base.task.free for p in parts):
        return []
    return [added(base, {name: drive.values.get(name, drive.felt("idle_torque"))}, (name,))]


def why_absent(candidate: Candidate, base: Model) -> tuple[State, str]:
    """Why a cause has no starts: the model has it, or this drive or record cannot show it."""
    effect = next((e for e in EFFECTS if e.code == candidate.effect), None)
    if candidate.code == "torque-offset":
        return "in-the-model", "it acts as an idle torque does, which the base has free"
    drive = base.task.drive
    owners = {"coulomb-motor": drive.bodies[:1], "stribeck-motor": drive.bodies[:1]}.get(candidate.code)
    if candidate.code.endswith("-load"):
        owners = drive.bodies[1:]
    names = [n for n in drive.quantities if n.rpartition(".")[2] in effect.present
             and (owners is None or n.rpartition(".")[0] in owners)]
    if any(present(base, n) for n in names):
        return "in-the-model", "it is part of the model already"
    if candidate.code == "third-mass":
        return "not-shown", ("the drive is no two-mass drive, or a third mass would ring too fast for the sampling "
                             "rate")
    return "not-shown", needed(candidate)


def needed(candidate: Candidate) -> str:
    """What a record must contain to show a cause, after one that does not."""
    needs = next((e.needs for e in EFFECTS if e.code == candidate.effect), CAUSES[candidate.code].needs)
    return f"this drive or record cannot show it; needed: {needs}"


CANDIDATES: tuple[Candidate, ...] = (
    Candidate("backlash", "backlash", _backlash, trace=_hardly_open),
    Candidate("coulomb-motor", "coulomb", _coulomb("motor")),
    Candidate("coulomb-load", "coulomb", _coulomb("load")),
    Candidate("stribeck-motor", "stribeck", _stribeck("motor"), nests=("coulomb-motor",)),
    Candidate("stribeck-load", "stribeck", _stribeck("load"), nests=("coulomb-load",)),
    Candidate("asymmetric-friction", "asymmetric-friction", _of_bodies("viscous_asymmetry")),
    Candidate("quadratic-drag", "quadratic-drag", _of_bodies("drag")),
    Candidate("hardening-stiffness", "hardening-stiffness", _hardening),
    Candidate("load-dependent-damping", "load-dependent-damping", _load_damping),
    Candidate("third-mass", "shaft", _third_mass),
    Candidate("torque-ripple", "torque-ripple", _ripple),
    Candidate("imbalance", "imbalance", _imbalance),
    Candidate("dead-time", "dead-time", _dead_time, trace=_hardly_late("converter.dead_time", False)),
    Candidate("torque-hold", "torque-hold", _hold),
    Candidate("converter-lag", "converter-lag", _lag("converter", ""),
              trace=_hardly_late("converter.bandwidth", True)),
    Candidate("speed-filter", "speed-filter", _lag("sensor", "motor_speed"),
              trace=_hardly_late("sensor.bandwidth", True)),
    Candidate("torque-offset", "idle-torque", _offset),
    Candidate("load-step", "load-step", _load_step),
    Candidate("friction-drift", "friction-drift", _drift),
)
