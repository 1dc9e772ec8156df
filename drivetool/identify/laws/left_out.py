"""Whether a two-mass drive has a gap or a third mass that its model lacks: then its stiffness is no stiffness.

All fits of a wrong structure share its error, so their agreement says nothing. What does is a likelihood ratio: the
drive with the gap, or with the third mass, is fitted beside the one without, under the same noise models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import Estimate
from drivetool.identify.fit import by_cooling, coloured, looks_coloured, spring_of
from drivetool.identify.identifiability import not_of_shaft
from drivetool.identify.laws.third_mass import grown, split_off, tip_names
from drivetool.identify.noise import Fit, Noise, filtered, fit_innovations, minus_log_likelihood, natural_ratio
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task, has_gap
from drivetool.identify.starts import attempted

# Log likelihood that the longer model must gain. That of a third mass, the richer of the two, is half a chi-square
# of three degrees at each of about eight resonances that a record tells apart: it is above 12 by chance once in
# 5000 records (Wilks 1938, Bonferroni).
GAIN = 12.0
# Of what torque noise on the load gains, below which a gap may be its shadow: a disturbance of the load is no noise
# of the motor's torque, and a gap takes up a few per cent of what that leaves.
SHADOW = 0.1
LOAD_NOISE = np.logspace(-1.5, 2.0, 8)  # over that which moves the motor's sensor by its noise
MOTOR_NOISE = (1.0, 0.2, 0.03)  # over that of the fit, which has had to be both
# Half gaps over the twist that the fit without a gap has: one that is next to none, then those that it hides in a
# stiffness of 0.8 and 0.5 times the true one.
NEXT_TO_NONE, HIDDEN = 0.03, (0.2, 0.5)
ROUNDS = 6  # of a fit: whether it gains is clear long before its last digits
HOT = 10.0  # torque noise of the first observer of a way in across the gap, as `engine.by_cooling` has it
TIMES = np.geomspace(1.15, 4.0, 8)  # frequencies of a third mass over the resonance, a factor of 1.2 apart
TRACE, BROAD = 0.01, 0.1  # share and damping ratio of a third mass that hardly changes the motion
SPLIT = (0.05, 0.4)  # least and largest share to start a fit from
PROMISING = 2  # frequencies that are worth a fit


@dataclass(frozen=True)
class Lack:
    """What the model lacks.

    gain  log likelihood of the drive that has it over the one that has not
    task  at the values of the longer drive
    """

    code: str
    gain: float
    task: Task


def lack_of(outcome: Outcome, white: Outcome, rival: Outcome) -> Lack | None:
    """A gap or a third mass; None where the model lacks neither, or the drive is no plain two-mass one.

    outcome  an innovations fit without laws
    white    one with white torque noise, in which a lack has not passed for noise with a memory
    rival    the likeliest with laws: a gap or a third mass must explain more than all of them
    """
    if not can_be_asked(outcome, white):
        return None
    task, fit = _gap(outcome, white)
    gain = _gained(outcome, fit, rival)
    if gain > GAIN and gain > SHADOW * _of_load_noise(outcome):
        return Lack("gap-left-out", gain, task)
    # A third mass may imitate a gap, but no gap has imitated a third mass: it is asked last.
    task, fit = _third_mass(outcome, white, min(outcome.fit.value, rival.fit.value))
    gain = _gained(outcome, fit, rival)
    return Lack("mass-left-out", gain, task) if gain > GAIN else None


def can_be_asked(outcome: Outcome, white: Outcome) -> bool:
    """Whether the record is asked for a gap and a third mass at all."""
    drive = outcome.task.drive
    if outcome.fit is None or white.fit is None or len(drive.bodies) != 2 or has_gap(outcome.task):
        return False
    return f"{drive.shafts[0]}.stiffness" in outcome.task.free


def _gained(outcome: Outcome, fit: Fit | None, rival: Outcome) -> float:
    """Log likelihood of a longer drive over the shorter one, where that may have the longer one's noise too.

    Noise figures that went a little further in the longer fit are no structure.
    """
    if fit is None:
        return -np.inf
    passes = filtered(outcome.problem, outcome.solution.point, fit.noise, keep=False)
    return min(outcome.fit.value, rival.fit.value, minus_log_likelihood(passes)) - fit.value


def without_shaft(estimate: Estimate, lack: Lack | None, shaft: str) -> Estimate:
    """The estimate with the finding, and without intervals of the shaft and of the inertias that it joins."""
    if lack is None:
        return estimate
    finding = gap_left_out(lack, shaft) if lack.code == "gap-left-out" else mass_left_out(lack)
    what = "a gap" if lack.code == "gap-left-out" else "a third mass"
    estimate = not_of_shaft(estimate, shaft, f"{what} is left out, and its error is in all fits")
    return replace(estimate, findings=(*estimate.findings, finding))


def gap_left_out(lack: Lack, shaft: str) -> Finding:
    """What is said of a gap."""
    drive = lack.task.drive
    half_gap = float(drive.values[f"{shaft}.half_gap"])
    stiffness = float(drive.values[f"{shaft}.stiffness"])
    return Finding(
        "warning", "gap-left-out",
        f"The model lacks a gap: with a half gap of about {half_gap:.2g} {drive.motion_unit} in {shaft} the record "
        f"is likelier by {lack.gain:.3g} in log likelihood. Without it the stiffness is no stiffness of {shaft}, "
        "and gets no interval.",
        {"log_likelihood_gain": lack.gain, "wanted": GAIN, "half_gap": half_gap, "stiffness_with_gap": stiffness},
        f"Fit it too: --free {shaft}.half_gap --set {shaft}.half_gap={half_gap:.2g} --set "
        f"{shaft}.stiffness={stiffness:.3g}; if there is none, say --set {shaft}.half_gap=0.")


def mass_left_out(lack: Lack) -> Finding:
    """What is said of a third mass."""
    drive = lack.task.drive
    inertia, stiffness, _ = (float(drive.values[n]) for n in tip_names(_short(drive)))
    load = float(drive.values[f"{drive.load}.inertia"])
    frequency = float(np.sqrt(stiffness * (1.0 / inertia + 1.0 / load)) / (2.0 * np.pi))
    share = inertia / (inertia + load)
    first = drive.shafts[0]
    return Finding(
        "warning", "mass-left-out",
        f"The model lacks a third mass: with about {100.0 * share:.2g} % of the {drive.load}'s inertia on a shaft "
        f"of its own, at {frequency:.3g} Hz, the record is likelier by {lack.gain:.3g} in log likelihood. Without "
        f"it the stiffness is no stiffness of {first}, and gets no interval.",
        {"log_likelihood_gain": lack.gain, "wanted": GAIN, "share": share, "frequency": frequency,
         "stiffness_with_third_mass": float(drive.values[f"{first}.stiffness"])},
        "Fit it too with --drive three-mass, or run diagnose; a sensor at the load shows it best.")


def _short(drive: Drive) -> Drive:
    return replace(drive, bodies=drive.bodies[:-1], shafts=drive.shafts[:-1])


def _of_load_noise(outcome: Outcome) -> float:
    """Log likelihood that torque noise on the load gains, all else as it is."""
    problem, point, noise = outcome.problem, outcome.solution.point, outcome.fit.noise
    natural = natural_ratio(problem, point)
    noises = [replace(noise, others=natural * times, ratio=noise.ratio * share)
              for times in LOAD_NOISE for share in MOTOR_NOISE]
    return outcome.fit.value - min(minus_log_likelihood(filtered(problem, point, n, keep=False)) for n in noises)


def _gap(outcome: Outcome, white: Outcome) -> tuple[Task, Fit | None]:
    """The likeliest drive with a gap."""
    if outcome.task.drive.values.get(f"{outcome.drive.shafts[0]}.half_gap") == 0.0:
        return outcome.task, None
    size = float(np.sqrt(np.mean(shaft_torque(outcome) ** 2)))
    begun = _opened(outcome, size, NEXT_TO_NONE)
    found = [(begun, _fitted(begun, _point(begun, outcome), outcome.fit.noise, outcome.fit.value))]
    if looks_coloured(white.fit.passes):  # of noise with a memory a gap may leave nothing to be seen
        for share in HIDDEN:
            begun = _opened(white, size, share)
            found.append((begun, _cooled(begun)))
    found = [(task, fit) for task, fit in found if fit is not None]
    return _with_noise_of(outcome, *min(found, key=lambda f: f[1].value, default=(outcome.task, None)))


def shaft_torque(outcome: Outcome) -> np.ndarray:
    """(n,) [torque unit] of the first shaft over all stretches, filtered, closed."""
    task, problem = outcome.task.at_point(outcome.solution.point), outcome.problem
    plain, spring = spring_of(task, 0, problem.traces[0].step)
    passes = filtered(problem, outcome.solution.point, outcome.fit.noise)
    return np.concatenate([f.states[:, :plain.nx] @ spring for f in passes])


def _opened(outcome: Outcome, torque: float, share: float) -> Task:
    """The task with a gap that takes a share of the twist which a torque makes, and so much stiffer a shaft."""
    task = outcome.task.at_point(outcome.solution.point)
    shaft = task.drive.shafts[0]
    stiffness = task.drive.values[f"{shaft}.stiffness"]
    names = {*task.free, f"{shaft}.half_gap"}
    return replace(task.at({f"{shaft}.half_gap": share * torque / stiffness,
                            f"{shaft}.stiffness": stiffness / (1.0 - share)}),
                   free=tuple(n for n in task.drive.quantities if n in names))


def _third_mass(outcome: Outcome, white: Outcome, wanted: float) -> tuple[Task, Fit | None]:
    """The likeliest drive with a third mass behind the load that leaves no correlation.

    What leaves some is not what the model lacks: a rich enough model takes up a share of any other lack.

    wanted  -log likelihood of the fits that it must beat
    """
    for base in (outcome, white) if looks_coloured(outcome.fit.passes) else (outcome,):
        found = [_with_noise_of(outcome, task, fit) for task, fit in _split(base, wanted)
                 if fit is not None]
        if not found:
            continue
        task, fit = min(found, key=lambda f: f[1].value)
        if fit.value > wanted - GAIN:
            continue
        if looks_coloured(fit.passes):
            fit = coloured(Outcome(task, task.problem(), fit.solution, fit, (), fit.converged)).fit
        if not looks_coloured(fit.passes):
            return task.at_point(fit.point), fit
    return outcome.task, None


def _split(base: Outcome, wanted: float) -> list[tuple[Task, Fit | None]]:
    """From the frequencies at which a trace of a third mass promises most as it grows.

    wanted  -log likelihood: what is far above it after two rounds is given up
    """
    plain, step, noise = base.task.at_point(base.solution.point), base.problem.traces[0].step, base.fit.noise
    names, looks = tip_names(plain.drive), []
    for times in TIMES:
        task = split_off(plain, step, TRACE, times, BROAD)
        if task is None:
            continue
        led = attempted(lambda task=task: grown(task.problem(), _point(task, base), noise, names))
        if led is None:
            continue
        gain, growth = led
        looks.append((growth > 0.0, gain, float(np.clip(TRACE * (1.0 + growth), *SPLIT)), times))
    begun = [split_off(plain, step, share, times, BROAD) for _, _, share, times in sorted(looks)[-PROMISING:]]
    return [(task, _fitted(task, _point(task, base), noise, wanted)) for task in begun]


def _point(task: Task, base: Outcome) -> Point:
    """Where a longer drive begins: start states by their names, a third mass as fast as the load."""
    old, new = base.problem.states, task.problem().states
    tip, load = f"{task.drive.bodies[-1]}.speed", f"{base.task.drive.bodies[-1]}.speed"
    source = [old.index(load if n == tip else n) if n in old or n == tip else None for n in new]
    starts = tuple(np.array([0.0 if j is None else start[j] for j in source])
                   for start in base.solution.point.starts)
    return Point(np.array([task.drive.value(n) for n in task.free], float), starts)


def _fitted(task: Task, point: Point, noise: Noise, wanted: float) -> Fit | None:
    return _finite(attempted(lambda: fit_innovations(
        task.problem(), point, noise, arrived=True, most=ROUNDS, wanted=wanted)))


def _cooled(task: Task) -> Fit | None:
    return _finite(attempted(lambda: by_cooling(task, task.problem(), None, HOT, ROUNDS)))


def _finite(fit: Fit | None) -> Fit | None:
    """The fit, unless it ran away."""
    return fit if fit is not None and np.isfinite(fit.value) else None


def _with_noise_of(outcome: Outcome, task: Task, fit: Fit | None) -> tuple[Task, Fit | None]:
    """The longer drive under noise with a memory too, where the shorter one is likelier by such noise."""
    if fit is None:
        return task, None
    noise = outcome.fit.noise
    if noise.memory is not None and fit.noise.memory is None and fit.value > outcome.fit.value - GAIN:
        further = _fitted(task, fit.point, noise, outcome.fit.value)
        fit = fit if further is None or further.value > fit.value else further
    return task.at_point(fit.point), fit
