"""Whether a two-mass drive has a gap or a third mass that its model lacks: then its fitted stiffness is biased.

All fits of a wrong structure share its error, so their agreement is no test. A likelihood ratio is: the drive with
the gap, or with the third mass, is fitted as well as the one without, under the same noise models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, Verdict, masked
from drivetool.identify.fit import by_noise_continuation, looks_coloured, shaft_torque_row, with_coloured_noise
from drivetool.identify.identifiability import names_joined_by
from drivetool.identify.laws.third_mass import third_mass_names, third_mass_score_test, with_split_load
from drivetool.identify.noise import (
    Fit,
    Noise,
    filtered,
    fit_innovations,
    minus_log_likelihood_at,
    unit_noise_ratio,
)
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task, has_gap
from drivetool.identify.starts import attempt_or_none
from drivetool.quantity import name_of

# Log likelihood that the larger model must gain. A third mass, the richer of the two, gains half a chi-square of
# three degrees at each of about eight distinguishable resonances. That exceeds 12 by chance once in 5000 records
# (Wilks 1938, Bonferroni).
MIN_STRUCTURE_GAIN = 12.0
# Of the gain of torque noise on the load, below which a gap may only imitate that noise. The motor's torque noise
# cannot describe a disturbance of the load, and a gap explains a few per cent of the residual.
MIN_LOAD_NOISE_SHARE = 0.1
# Torque noise of the load over that which moves the motor's sensor by its noise. A choice: from hardly visible to
# dominant, two values a decade.
LOAD_NOISE_RATIOS = np.logspace(-1.5, 2.0, 8)
MOTOR_NOISE_RATIOS = (1.0, 0.2, 0.03)  # over that of the fit, which stands for both; a choice, down to next to none
# Half gaps over the twist of the fit without a gap: a very small one, then those that a gapless fit describes by a
# stiffness of 0.8 and 0.5 times the true one.
SMALL_GAP_SHARE, HIDDEN_GAP_SHARES = 0.03, (0.2, 0.5)
MAX_STRUCTURE_FIT_ITERATIONS = 6  # of a fit, a choice: whether it gains is clear long before its last digits
# Torque noise of the first observer of the continuation across the gap, as in `fit.by_cooling`.
INITIAL_NOISE_RATIO = 10.0
# Frequencies of a third mass over the resonance. A choice: a factor of 1.2 from one to the next, about the
# bandwidth of the damping ratio below.
THIRD_MASS_FREQUENCY_RATIOS = np.geomspace(1.15, 4.0, 8)
# Share and damping ratio of a third mass for the score test. A choice: the small share leaves the motion linear in
# it, the broad resonance is found between two frequencies.
TEST_MASS_SHARE, TEST_DAMPING_RATIO = 0.01, 0.1
# Least and largest share to start a fit from, a choice: below and above, a linear step misleads.
START_MASS_SHARES = (0.05, 0.4)
MAX_THIRD_MASS_FITS = 2  # frequencies that are fitted, a choice: each costs a fit, and one alone may be a side peak


@dataclass(frozen=True)
class MissingStructure:
    """A structure that the model lacks.

    gain  log likelihood of the drive with it over the one without
    task  at the values of the larger drive
    """

    code: str
    gain: float
    task: Task


def find_missing_structure(outcome: Outcome, white: Outcome, rival: Outcome) -> MissingStructure | None:
    """A missing gap or third mass; None where neither is missing, or the drive is not of two masses without a gap.

    outcome  an innovations fit without laws
    white    one with white torque noise, in which coloured noise cannot hide a missing structure
    rival    the likeliest with laws: a gap or a third mass must explain more than all of them
    """
    if not can_be_tested(outcome, white):
        return None
    task, fit = _fit_with_gap(outcome, white)
    gain = _likelihood_gain(outcome, fit, rival)
    if gain > MIN_STRUCTURE_GAIN and gain > MIN_LOAD_NOISE_SHARE * _load_noise_gain(outcome):
        return MissingStructure("gap-left-out", gain, task)
    # A third mass may imitate a gap, but no gap has imitated a third mass: it is tested last.
    task, fit = _fit_with_third_mass(outcome, white, min(outcome.fit.value, rival.fit.value))
    gain = _likelihood_gain(outcome, fit, rival)
    return MissingStructure("mass-left-out", gain, task) if gain > MIN_STRUCTURE_GAIN else None


def can_be_tested(outcome: Outcome, white: Outcome) -> bool:
    """Whether a missing gap and a missing third mass are tested at all."""
    drive = outcome.task.drive
    return (outcome.fit is not None and white.fit is not None and len(drive.bodies) == 2
            and not has_gap(outcome.task) and name_of(drive.shafts[0], "stiffness") in outcome.task.free)


def _likelihood_gain(outcome: Outcome, fit: Fit | None, rival: Outcome) -> float:
    """Log likelihood of the larger drive over the smaller one, which may take the larger one's noise too.

    A gain from noise parameters that converged further in the larger fit is no structure.
    """
    if fit is None:
        return -np.inf
    with_its_noise = minus_log_likelihood_at(outcome.problem, outcome.solution.point, fit.noise)
    return min(outcome.fit.value, rival.fit.value, with_its_noise) - fit.value


def missing_structure(estimate: Estimate, lack: MissingStructure | None) -> Verdict:
    """What a missing gap or third mass biases: the first shaft and the inertias that it joins have no interval."""
    if lack is None:
        return Verdict()
    shaft = estimate.drive.shafts[0]
    finding = missing_gap_finding(lack, shaft) if lack.code == "gap-left-out" else missing_mass_finding(lack)
    what = "a gap" if lack.code == "gap-left-out" else "a third mass"
    return Verdict([finding], masked(estimate, f"{what} is missing in the model and biases all fits",
                                     names=names_joined_by(estimate.drive, shaft)))


def missing_gap_finding(lack: MissingStructure, shaft: str) -> Finding:
    """The finding on a missing gap."""
    drive = lack.task.drive
    half_gap = float(drive.values[name_of(shaft, "half_gap")])
    stiffness = float(drive.values[name_of(shaft, "stiffness")])
    return Finding(
        "warning", "gap-left-out",
        f"The model lacks a gap: with a half gap of about {half_gap:.2g} {drive.motion_unit} in {shaft} the log "
        f"likelihood is higher by {lack.gain:.3g}. Without the gap the stiffness estimate of {shaft} is biased and "
        "gets no interval.",
        {"log_likelihood_gain": lack.gain, "wanted": MIN_STRUCTURE_GAIN, "half_gap": half_gap,
         "stiffness_with_gap": stiffness},
        f"Fit it too: --free {shaft}.half_gap --set {shaft}.half_gap={half_gap:.2g} --set "
        f"{shaft}.stiffness={stiffness:.3g}; if there is no gap, state it with --set {shaft}.half_gap=0.")


def missing_mass_finding(lack: MissingStructure) -> Finding:
    """The finding on a missing third mass."""
    drive = lack.task.drive
    inertia, stiffness, _ = (float(drive.values[n]) for n in third_mass_names(
        replace(drive, bodies=drive.bodies[:-1], shafts=drive.shafts[:-1])))
    load = float(drive.values[name_of(drive.load, "inertia")])
    frequency = float(np.sqrt(stiffness * (1.0 / inertia + 1.0 / load)) / (2.0 * np.pi))
    share = inertia / (inertia + load)
    first = drive.shafts[0]
    return Finding(
        "warning", "mass-left-out",
        f"The model lacks a third mass. About {100.0 * share:.2g} % of the {drive.load}'s inertia on a further "
        f"shaft, with a resonance at {frequency:.3g} Hz, raises the log likelihood by {lack.gain:.3g}. Without the "
        f"third mass the stiffness estimate of {first} is biased and gets no interval.",
        {"log_likelihood_gain": lack.gain, "wanted": MIN_STRUCTURE_GAIN, "share": share, "frequency": frequency,
         "stiffness_with_third_mass": float(drive.values[name_of(first, "stiffness")])},
        "Fit it too with --drive three-mass, or run diagnose; a sensor at the load shows it best.")


def _load_noise_gain(outcome: Outcome) -> float:
    """Log likelihood that torque noise on the load gains, all else as it is."""
    problem, point, noise = outcome.problem, outcome.solution.point, outcome.fit.noise
    natural = unit_noise_ratio(problem, point)
    noises = [replace(noise, others=natural * times, ratio=noise.ratio * share)
              for times in LOAD_NOISE_RATIOS for share in MOTOR_NOISE_RATIOS]
    return outcome.fit.value - min(minus_log_likelihood_at(problem, point, n) for n in noises)


def _fit_with_gap(outcome: Outcome, white: Outcome) -> tuple[Task, Fit | None]:
    """The likeliest drive with a gap."""
    if outcome.task.drive.values.get(name_of(outcome.drive.shafts[0], "half_gap")) == 0.0:
        return outcome.task, None
    torque = float(np.sqrt(np.mean(shaft_torque(outcome) ** 2)))
    start = _with_gap(outcome, torque, SMALL_GAP_SHARE)
    found = [(start, _fit_quickly(start, _start_point_of(start, outcome), outcome.fit.noise, outcome.fit.value))]
    if looks_coloured(white.fit.passes):  # coloured noise may hide a gap entirely
        for share in HIDDEN_GAP_SHARES:
            start = _with_gap(white, torque, share)
            found.append((start, _fit_by_continuation(start)))
    found = [(task, fit) for task, fit in found if fit is not None]
    return _with_coloured_noise(outcome, *min(found, key=lambda f: f[1].value, default=(outcome.task, None)))


def shaft_torque(outcome: Outcome) -> np.ndarray:
    """(n,) [torque unit] of the first shaft over all stretches, by the filter of the drive with a closed gap."""
    task, problem = outcome.fitted, outcome.problem
    plain, spring = shaft_torque_row(task, 0, problem.traces[0].step)
    passes = filtered(problem, outcome.solution.point, outcome.fit.noise)
    return np.concatenate([f.states[:, :plain.nx] @ spring for f in passes])


def _with_gap(outcome: Outcome, torque: float, share: float) -> Task:
    """The task with a half gap of a share of the twist under a torque, and a shaft stiffer by as much."""
    task = outcome.fitted
    half_gap, rigidity = (name_of(task.drive.shafts[0], what) for what in ("half_gap", "stiffness"))
    stiffness = task.drive.values[rigidity]
    return task.at({half_gap: share * torque / stiffness,
                    rigidity: stiffness / (1.0 - share)}).with_free({*task.free, half_gap})


def _fit_with_third_mass(outcome: Outcome, white: Outcome, wanted: float) -> tuple[Task, Fit | None]:
    """The likeliest drive with a third mass behind the load whose innovations are white.

    A third mass that leaves coloured innovations is not what the model lacks: a rich model describes a share of any
    other missing effect.

    wanted  -log likelihood of the fits that it must beat
    """
    for base in (outcome, white) if looks_coloured(outcome.fit.passes) else (outcome,):
        found = [_with_coloured_noise(outcome, task, fit) for task, fit in _third_mass_fits(base, wanted)
                 if fit is not None]
        if not found:
            continue
        task, fit = min(found, key=lambda f: f[1].value)
        if fit.value > wanted - MIN_STRUCTURE_GAIN:
            continue
        if looks_coloured(fit.passes):
            fit = with_coloured_noise(Outcome.of_fit(task, task.problem(), fit)).fit
        if not looks_coloured(fit.passes):
            return task.at_point(fit.point), fit
    return outcome.task, None


def _third_mass_fits(base: Outcome, wanted: float) -> list[tuple[Task, Fit | None]]:
    """Fits from the frequencies at which the score test of a small third mass expects the largest gain.

    wanted  -log likelihood: a fit far above it after two rounds is given up
    """
    plain, step, noise = base.fitted, base.problem.traces[0].step, base.fit.noise
    names, scores = third_mass_names(plain.drive), []
    for frequency_ratio in THIRD_MASS_FREQUENCY_RATIOS:
        task = with_split_load(plain, step, TEST_MASS_SHARE, frequency_ratio, TEST_DAMPING_RATIO)
        if task is None:
            continue
        score = attempt_or_none(lambda task=task: third_mass_score_test(task.problem(),
                                                                        _start_point_of(task, base), noise, names))
        if score is None:
            continue
        gain, growth = score
        scores.append((growth > 0.0, gain, float(np.clip(TEST_MASS_SHARE * (1.0 + growth), *START_MASS_SHARES)),
                       frequency_ratio))
    starts = [with_split_load(plain, step, share, times, TEST_DAMPING_RATIO)
              for _, _, share, times in sorted(scores)[-MAX_THIRD_MASS_FITS:]]
    return [(task, _fit_quickly(task, _start_point_of(task, base), noise, wanted)) for task in starts]


def _start_point_of(task: Task, base: Outcome) -> Point:
    """Start of a larger drive: start states by their names, a third mass as fast as the load."""
    old, new = base.problem.states, task.problem().states
    tip, load = f"{task.drive.bodies[-1]}.speed", f"{base.task.drive.bodies[-1]}.speed"
    source = [old.index(load if n == tip else n) if n in old or n == tip else None for n in new]
    starts = tuple(np.array([0.0 if j is None else start[j] for j in source])
                   for start in base.solution.point.starts)
    return Point(np.array([task.drive.value(n) for n in task.free], float), starts)


def _fit_quickly(task: Task, point: Point, noise: Noise, wanted: float) -> Fit | None:
    return _finite_or_none(attempt_or_none(lambda: fit_innovations(
        task.problem(), point, noise, near_optimum=True, max_rounds=MAX_STRUCTURE_FIT_ITERATIONS, wanted=wanted)))


def _fit_by_continuation(task: Task) -> Fit | None:
    return _finite_or_none(attempt_or_none(lambda: by_noise_continuation(task, task.problem(), None,
                                                                         INITIAL_NOISE_RATIO,
                                                                         MAX_STRUCTURE_FIT_ITERATIONS)))


def _finite_or_none(fit: Fit | None) -> Fit | None:
    """The fit, unless it diverged."""
    return fit if fit is not None and np.isfinite(fit.value) else None


def _with_coloured_noise(outcome: Outcome, task: Task, fit: Fit | None) -> tuple[Task, Fit | None]:
    """The larger drive with coloured noise too, where the smaller one is likelier with it."""
    if fit is None:
        return task, None
    noise = outcome.fit.noise
    if noise.memory is not None and fit.noise.memory is None and fit.value > outcome.fit.value - MIN_STRUCTURE_GAIN:
        refit = _fit_quickly(task, fit.point, noise, outcome.fit.value)
        fit = fit if refit is None or refit.value > fit.value else refit
    return task.at_point(fit.point), fit
