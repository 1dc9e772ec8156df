"""Backlash: the half gap of a shaft, from a record that opens it.

With a gap the likelihood has several optima, so the fit is a multi-start one. "The gap was not crossed" and "not
distinguishable from zero, at most x" are results.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption
from drivetool.finding import Finding
from drivetool.identify.channels import suspect_channel_findings, torque_timing
from drivetool.identify.estimate import (
    Z95,
    Estimate,
    PlotData,
    Verdict,
    covariance_of,
    in_order,
    line_of,
)
from drivetool.identify.fit import (
    Contact,
    by_innovations,
    contact_of,
    fit_noise_only,
    fit_task,
    fit_with_friction_split,
    looks_coloured,
    refit,
    split_totals,
    with_friction_parts,
)
from drivetool.identify.greybox import ALL, free_parameters, with_all_expanded
from drivetool.identify.identifiability import (
    HALF_CHI2_95,
    Profile,
    low_inertia,
    never_crossed,
    profile,
    with_uncertain_values_free,
    without_upper_limit,
)
from drivetool.identify.laws import default_fit
from drivetool.identify.noise import Noise, fit_ratio, minus_log_likelihood_at
from drivetool.identify.outcome import compose, not_converged
from drivetool.identify.setup import (
    Options,
    Outcome,
    Roles,
    Task,
    after_transient,
    at_rates,
    first_point,
    known_states,
    refuse_free_torque_constants,
    roles_of,
    shared_free_names,
)
from drivetool.identify.shaft_torque import (
    GapLaws,
    dead_stretch_details,
    fit_gap_laws,
    fit_gap_laws_from,
    friction_of_file,
    gap_law_findings,
    has_sides,
    with_frictions,
    with_identified_friction,
)
from drivetool.identify.starts import PARALLEL_STARTS, search_from_prior, start_agrees
from drivetool.logs import Experiment
from drivetool.logs.samples import without_unmeasured
from drivetool.quantity import names_of, owner_of, with_parts

# Half gaps of the likelihood scan, over the twist by the torque of the record. A choice: steps of 5 %, as the local
# optima are narrow; every eighth one estimates the noise.
HALF_GAP_SCAN = np.geomspace(0.01, 300.0, 205)
MAX_GAP_STARTS = 3  # local optima of the scan from which fits start. A choice: each costs a fit
FURTHER_SHARES = [0.5, 2.0]  # further shares to start from. A choice: on either side of the twist
# Relative std beyond which the interval by curvature would come within 3.3 std of zero.
MAX_CURVATURE_RELATIVE_STD = 0.3


def backlash(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Half gap of the shafts; linear parameters are held unless freed, or identified from contacts with a sensor.

    experiments  records whose shaft torque changes sign
    drive        inertias, stiffness, damping and friction from the steps before
    options      hold, free, criterion, starts, segment, start
    returns      Estimate of <shaft>.half_gap [rad], interval by curvature; by profile likelihood where it is wide
    raises       BadOption: a drive without shaft; BadParameters: a value is missing
    source       Tallfors 2005, sec. 5.6 and ch. 6; Nordin, Galic, Gutman 1997
    """
    if not drive.shafts:
        raise BadOption("a drive with a shaft", f"the {drive.name} drive", "Use --drive two-mass.")
    refuse_free_torque_constants(options.free)
    drive.require(drive.missing(), "a backlash fit")
    experiments = [after_transient(without_unmeasured(e), drive, options.free)
                   for e in at_rates("backlash", experiments, options)]
    roles = roles_of(experiments, drive)
    if options.criterion == "inverse":
        return _by_inverse(experiments, drive, options, roles)
    if {ALL, *TOTALS} & set(options.free) or has_sides(drive, roles, options):
        drive = with_frictions(drive, roles, options)
    requested, options = options, with_all_expanded(options, drive, experiments)
    gaps = names_of(drive.shafts, "half_gap")
    free = shared_free_names(free_parameters(drive, gaps, options), drive, experiments)
    gaps = [g for g in gaps if g in free]
    task = Task(drive, free, roles, tuple(experiments), known_states(options.start, drive, free, roles))
    closed = {g: contact_of(task.at({g: 0.0}), drive.shafts.index(owner_of(g))) for g in gaps}
    if unopened := [g for g in gaps if not closed[g].reverses]:
        return _unopened_estimate(task, drive, unopened, closed, options)
    freed, lower_limits = with_uncertain_values_free(task, requested), {}
    laws = fit_gap_laws(task, requested)
    if laws is not None:
        white = with_identified_friction(laws.outcome, drive, options, requested)
    elif freed is None:
        white = fit_with_friction_split(task, options, requested, _half_gap_starts(task, gaps, options))
        white = with_identified_friction(white, drive, options, requested)
    else:
        white, lower_limits = _fit_low_inertia(freed, gaps, options, requested)
    if laws is None and not lower_limits:
        laws, white = _with_likelier_law(white, requested)
    fit = default_fit(white, options, bool(lower_limits))
    outcome, explanation = fit.outcome, fit.explanation
    profiles = {g: found for g in gaps if outcome.fit is not None and not not_converged(outcome)
                and g not in lower_limits and (found := _profile_if_wide(outcome, g)) is not None}
    # A gap that may be closed has no law.
    opens = all(found.low is not None or found.high is None for found in profiles.values())
    findings = (*torque_timing(white), *suspect_channel_findings(task, outcome.drive),
                *gap_law_findings(laws, outcome, free, not not_converged(outcome), opens),
                *(explanation.findings if explanation else ()))
    return compose(
        "backlash", drive, outcome, options, findings,
        {"contact": _contact_counts(outcome, drive, gaps), **(dead_stretch_details(laws) if laws else {})},
        explanation=explanation, alone=fit.alone, checks=(
            lambda e: friction_of_file(e, outcome, options, free, explanation),
            *(partial(_by_profile, name=name, found=found) for name, found in profiles.items()),
            *(partial(without_upper_limit, name=name, low=low) for name, low in lower_limits.items()),
            lambda e: ambiguous_gaps(e, outcome, gaps),
            lambda e: _uncrossed(e, gaps),
            lambda e: low_inertia(e, outcome, gaps, freed and [n for n in freed.free if n not in free])))


def _with_likelier_law(white: Outcome, requested: Options) -> tuple[GapLaws | None, Outcome]:
    """The laws of the gap from the optimum of a fit, and the fit by another law where that is likelier.

    After a fit that has not converged, none would be the machine's.
    """
    laws = None if not_converged(white) else fit_gap_laws_from(white, requested)
    return laws, laws.outcome if laws and laws.outcome.drive.damping_law != white.drive.damping_law else white


def _by_inverse(experiments: Sequence[Experiment], drive: Drive, options: Options, roles: Roles) -> Estimate:
    """The fit of the required torque."""
    from drivetool.identify.inverse import greybox_by_inverse

    drive = with_friction_parts(drive)
    free = shared_free_names(
        free_parameters(drive, names_of(drive.shafts, "half_gap"), with_all_expanded(options, drive, experiments)),
        drive, experiments)
    return replace(greybox_by_inverse(experiments, drive, free, roles, options), step="backlash")


def _fit_low_inertia(task: Task, gaps: Sequence[str], options: Options, requested: Options,
                 ) -> tuple[Outcome, dict[str, float]]:
    """The fit of a low load inertia, and the lower limit of each gap that was never crossed."""
    outcome, lower_limits = by_innovations(task, [{}], options.seed, options.starts,
                                           search_from_prior(options.known)), {}
    single_start = sum(start_agrees(outcome, s) for s in outcome.starts) < 2
    if not single_start:
        outcome = split_totals(outcome, requested)
        if not_converged(outcome):  # a few rounds more: two starts agree on this optimum
            outcome = refit(outcome.fitted, outcome.fit.noise)
    for g in gaps:
        found = never_crossed(outcome, g)
        # Two fits that explain the record equally badly give no lower limit.
        if found and not (single_start and looks_coloured(found[0].fit.passes)):
            outcome, lower_limits[g] = found
    return outcome, lower_limits


def _half_gap_starts(task: Task, gaps: Sequence[str], options: Options) -> list[dict[str, float]]:
    """Half gaps to start from: the one given, and the local optima of a scan of the likelihood.

    With the other parameters held, one Kalman pass gives the likelihood of a half gap: cheap enough for a dense
    scan, which the narrow optima need.
    """
    torque = np.concatenate([e.signals["motor_torque"] for e in task.experiments])
    given = {g: v for g in gaps if (v := task.drive.value(g) or 0.0) > 0.0}
    starts = [given] if given else []
    twist = {g: float(np.nanstd(torque)) / task.drive.value(with_parts(g, quantity="stiffness")) for g in gaps}

    def likelihood_at(share: float, noise: Noise | None) -> tuple[float, Noise]:
        trial = task.at({g: share * twist[g] for g in gaps})
        problem = trial.problem(free=())
        point = first_point(trial.drive, problem, task.roles)
        if noise is None:
            noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
        return minus_log_likelihood_at(problem, point, noise), noise

    with ThreadPoolExecutor(PARALLEL_STARTS) as pool:
        coarse = list(pool.map(lambda share: likelihood_at(share, None), HALF_GAP_SCAN[::8]))
        noise = min(coarse, key=lambda pair: pair[0])[1]
        values = np.array([value for value, _ in pool.map(
            lambda share: likelihood_at(share, noise), HALF_GAP_SCAN)])
        lowest = local_minima(values)[: 3 * MAX_GAP_STARTS]
        refined = dict(zip(lowest, pool.map(
            lambda i: likelihood_at(HALF_GAP_SCAN[i], None)[0], lowest), strict=True))
    lowest = sorted(lowest, key=refined.__getitem__)[: options.starts or MAX_GAP_STARTS]
    shares = [float(HALF_GAP_SCAN[i]) for i in lowest]
    if len(task.free) > len(gaps):  # the optima shift when the other parameters are free
        shares += FURTHER_SHARES
    return starts + [{g: share * twist[g] for g in gaps} for share in shares]


def local_minima(values: np.ndarray) -> list[int]:
    """Indices of the local minima of (n,) values, the lowest first."""
    padded = np.concatenate(([np.inf], values, [np.inf]))
    local = np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]))
    return [int(i) for i in local[np.argsort(values[local], kind="stable")]]


def _profile_if_wide(outcome: Outcome, name: str) -> Profile | None:
    """The profile of a half gap whose interval by curvature is wide; None of another."""
    covariance, _, free = covariance_of(outcome.problem, outcome.solution)
    j = outcome.problem.names.index(name)
    std, value = np.sqrt(covariance[j, j]), outcome.solution.point.values[j]
    if free[j] and std < MAX_CURVATURE_RELATIVE_STD * value:
        return None
    step = std if np.isfinite(std) and std > 0.0 else max(value, 10.0 * outcome.problem.size[j])
    return profile(outcome, name, float(step))


def _by_profile(estimate: Estimate, name: str, found: Profile) -> Verdict:
    """The interval of a half gap by its profile."""
    unit = estimate.line(name).unit
    curve = PlotData("profile", f"Profile likelihood of {name}", f"{name} [{unit}]", "rise of -log likelihood", {
        "profile": (found.values, found.rise),
        "95 % level": (found.values[[0, -1]], np.full(2, HALF_CHI2_95))})
    return replace(_limits_by_profile(estimate, name, found), exhibits=[curve])


def _limits_by_profile(estimate: Estimate, name: str, found: Profile) -> Verdict:
    """What a profile says of the half gap of that name: no upper limit, no lower one, or both."""
    line, low = estimate.line(name), 0.0 if found.low is None else found.low
    if found.high is None:
        return without_upper_limit(estimate, name, low)
    if found.low is None:
        return Verdict([Finding(
            "note", "gap-not-significant",
            f"{name} is not distinguishable from zero; it is at most {found.high:.3g} {line.unit}.",
            {"at_most": found.high},
            "Record smaller torque steps around zero shaft torque to identify smaller gaps.", name)], [line.replace(
                std=None, ci95=(0.0, found.high), status="at-bound" if line.value <= 0.0 else "fitted",
                reason="not distinguishable from zero; the interval is one-sided")])
    # The profile is of one candidate model: the disagreement between the candidates is added.
    structure = Z95 * (line.std_structure or 0.0)
    low = line.value - np.hypot(line.value - low, structure)
    high = line.value + np.hypot(found.high - line.value, structure)
    return Verdict(lines=[line.replace(ci95=(max(low, 0.0), high), status="fitted",
                                       std=line.std if line.std is not None else (high - low) / (2.0 * Z95))])


def ambiguous_gaps(estimate: Estimate, outcome: Outcome, gaps: Sequence[str]) -> Verdict:
    """No interval where a start converged to a different gap that is as likely."""
    rivals = [s["reached"] for s in outcome.starts
              if s.get("minus_log_likelihood_above_best", np.inf) < HALF_CHI2_95 and "reached" in s]
    findings, lines = [], []
    for g in gaps:
        line = estimate.line(g)
        value, width = line.value, 4.0 * (line.std or 0.0) + 0.02 * line.value
        others = [r[g] for r in rivals if abs(r[g] - value) > width]
        if line.status != "fitted" or not others:
            continue
        low, high = min([value, *others]), max([value, *others])
        lines.append(line.without_interval(
            f"half gaps from {low:.3g} to {high:.3g} explain the record equally well", "not-identifiable"))
        findings.append(Finding(
            "warning", "gap-ambiguous",
            f"Half gaps from {low:.3g} to {high:.3g} {line.unit} explain this record equally well.",
            {"low": low, "high": high}, "Record torque steps that cross the gap both ways.", g))
    return Verdict(findings, lines)


def _contact_counts(outcome: Outcome, drive: Drive, gaps: Sequence[str]) -> dict[str, dict[str, float]]:
    """How often each gap opened and how often it was crossed, at the estimate."""
    task, found = outcome.fitted, {}
    for g in gaps:
        c = contact_of(task, drive.shafts.index(owner_of(g)))
        found[g] = {"opened": c.opened, "crossed": c.crossed, "open_percent": 100.0 * c.open_share}
    return found


def _uncrossed(estimate: Estimate, gaps: Sequence[str]) -> Verdict:
    """A finding where a gap opened but never reached its other side: it has only a lower bound."""
    findings = []
    for g in gaps:
        counts = estimate.details["contact"][g]
        if estimate.line(g).value > 0.0 and counts["opened"] > 0 and counts["crossed"] == 0:
            findings.append(Finding(
                "warning", "gap-not-crossed",
                f"The gap opened {counts['opened']} times but its other side was never reached: {g} has only a "
                f"lower bound.", counts, "Record torque steps of both signs.", g))
    return Verdict(findings)


def _unopened_estimate(task: Task, drive: Drive, unopened: Sequence[str], closed: dict[str, Contact],
                 options: Options) -> Estimate:
    """The estimate for a record whose shaft torque keeps its sign: the half gap is not fitted."""
    held = task.with_held(unopened)
    outcome = fit_task(held, options, [{}]) if held.free else fit_noise_only(held)
    findings, lines = [], []
    for g in unopened:
        c = closed[g]
        findings.append(Finding(
            "warning", "gap-not-opened",
            f"The shaft torque stays between {c.least:.3g} and {c.most:.3g} {drive.torque_unit} and never changes "
            f"sign: the gap does not open in this record, and {g} is not identifiable.",
            {"least_shaft_torque": c.least, "largest_shaft_torque": c.most},
            "Record alternating torque steps larger than the idle torque.", g))
        line = line_of(drive, g, drive.value(g) or 0.0)
        lines.append(line.replace(start=line.value).without_interval("the gap was not opened in this record",
                                                                     "not-identifiable"))
    estimate = compose("backlash", drive, outcome, options, findings)
    return replace(estimate, parameters=in_order((*estimate.parameters, *lines), drive))
