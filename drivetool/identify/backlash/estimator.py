"""Backlash: the half gap of a shaft, from a record that opens it.

The likelihood has several optima across a gap, so several starting values are tried. "The gap
was not crossed" and "not distinguishable from zero, at most x" are answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption, Finding
from drivetool.identify.channels import doubted_channels, torque_timing
from drivetool.identify.estimate import Z95, Estimate, Exhibit, Parameter, covariance_of, without_untold
from drivetool.identify.fit import (
    Contact,
    again,
    apart,
    contact,
    fit_apart,
    fit_task,
    frozen,
    looks_coloured,
    split_totals,
)
from drivetool.identify.greybox import ALL, chosen, expanded
from drivetool.identify.identifiability import (
    LEVEL95,
    Profile,
    fit_light,
    from_below,
    judged,
    loosened,
    never_crossed,
    profile,
    unbounded,
)
from drivetool.identify.laws import explained
from drivetool.identify.noise import Noise, filtered, fit_ratio, minus_log_likelihood
from drivetool.identify.outcome import compose, unsettled
from drivetool.identify.problem import Point
from drivetool.identify.setup import (
    Options,
    Outcome,
    Roles,
    Task,
    at_rates,
    first_states,
    known_states,
    led_in,
    only_in_greybox,
    roles_of,
    shared_by_some,
)
from drivetool.identify.shaft_torque import (
    BothLaws,
    as_in_file,
    both_laws,
    both_laws_from,
    details_of,
    friction_told,
    has_sides,
    laws_told,
    with_frictions,
)
from drivetool.identify.starts import AT_ONCE, agrees
from drivetool.logs import Experiment
from drivetool.logs.samples import measured

# Half gaps to look at, over the twist that the torque of the record makes.
SCAN = np.geomspace(0.01, 300.0, 205)
VALLEYS = 3  # of the scan from which fits start
SPREAD = [0.5, 2.0]  # further shares to start from
WIDE = 0.3  # relative std beyond which the curvature is not trusted


def backlash(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Half gap of the shafts; linear parameters are held unless freed, or told again by contacts with a sensor.

    experiments  records whose shaft torque changes sign
    drive        inertias, stiffness, damping and friction from the steps before
    options      hold, free, criterion, starts, segment, start
    returns      Estimate of <shaft>.half_gap [rad], interval by curvature, or by profile likelihood
                 where that is wide
    raises       BadOption: a drive without shaft; BadParameters: a value is missing
    source       Tallfors 2005, sec. 5.6 and ch. 6; Nordin, Galic, Gutman 1997
    """
    if not drive.shafts:
        raise BadOption("a drive with a shaft", f"the {drive.name} drive", "Use --drive two-mass.")
    only_in_greybox(options.free)
    drive.require(drive.missing(), "a backlash fit")
    experiments = [led_in(measured(e), drive, options.free) for e in at_rates("backlash", experiments, options)]
    roles = roles_of(experiments, drive)
    if options.criterion == "inverse":
        return _by_inverse(experiments, drive, options, roles)
    if {ALL, *TOTALS} & set(options.free) or has_sides(drive, roles, options):
        drive = with_frictions(drive, roles, options)
    asked, options = options, expanded(options, drive, experiments)
    gaps = [f"{s}.half_gap" for s in drive.shafts]
    free = shared_by_some(chosen(drive, gaps, options), drive, experiments)
    gaps = [g for g in gaps if g in free]
    task = Task(drive, free, roles, tuple(experiments), known_states(options.start, drive, free, roles))
    closed = {g: contact(task.at({g: 0.0}), drive.shafts.index(g.split(".")[0])) for g in gaps}
    shut = [g for g in gaps if not closed[g].reverses]
    if shut:
        return _not_crossed(task, drive, shut, closed, options)
    loose, least = loosened(task, asked), {}
    laws = both_laws(task, asked)
    if laws is not None:
        white = friction_told(laws.outcome, drive, options, asked)
    elif loose is None:
        white = fit_apart(task, options, asked, _starts(task, gaps, options))
        white = friction_told(white, drive, options, asked)
    else:
        white, least = _with_linear(loose, gaps, options, asked)
    if laws is None and not least:
        laws, white = _by_better_law(white, asked)
    fit = explained(white, options, bool(least))
    outcome, explanation = fit.outcome, fit.explanation
    profiles = {g: _profile(outcome, g) for g in gaps if outcome.fit is not None
                and not unsettled(outcome) and g not in least and _wide(outcome, g)}
    estimate = compose("backlash", drive, outcome, explanation.findings if explanation else (),
                       {"contact": _counts(outcome, drive, gaps), **(details_of(laws) if laws else {})},
                       known=options.known, explanation=explanation)
    estimate = as_in_file(estimate, outcome, options, free, explanation)
    estimate = replace(estimate, findings=(*torque_timing(white), *doubted_channels(task, outcome.drive),
                                           *laws_told(laws, outcome, free, not unsettled(outcome)),
                                           *estimate.findings))
    for name, found in profiles.items():
        estimate = _by_profile(estimate, name, found)
    for name, low in least.items():
        estimate = from_below(estimate, name, low)
    estimate = _one_sided_contact(without_ambiguous(estimate, outcome, gaps), outcome, gaps)
    if fit.alone:
        estimate = replace(estimate, explanation=fit.alone)
    return judged(estimate, outcome, gaps, loose and [n for n in loose.free if n not in task.free])


def _by_better_law(white: Outcome, asked: Options) -> tuple[BothLaws | None, Outcome]:
    """Both laws of the gap from where a fit led, and the fit by the other law where that leads.

    Of a fit that may be astray neither law would be the machine's.
    """
    laws = None if unsettled(white) else both_laws_from(white, asked)
    other = laws is not None and laws.outcome.drive.damping_law != white.drive.damping_law
    return laws, laws.outcome if laws is not None and other else white


def _by_inverse(experiments: Sequence[Experiment], drive: Drive, options: Options, roles: Roles) -> Estimate:
    """The fit of the torque that the motion asks for."""
    from drivetool.identify.inverse import greybox_by_inverse

    drive = apart(drive)
    free = chosen(drive, [f"{s}.half_gap" for s in drive.shafts], expanded(options, drive, experiments))
    free = shared_by_some(free, drive, experiments)
    return replace(greybox_by_inverse(experiments, drive, free, roles, options), step="backlash")


def _with_linear(task: Task, gaps: Sequence[str], options: Options, asked: Options,
                 ) -> tuple[Outcome, dict[str, float]]:
    """The fit of a light load, and the least half gap of each gap that was never crossed."""
    outcome, least = fit_light(task, options.known, options), {}
    doubtful = sum(agrees(outcome, s) for s in outcome.starts) < 2
    if not doubtful:
        outcome = split_totals(outcome, asked)
        if unsettled(outcome):  # a few rounds more: the place is confirmed
            outcome = again(outcome.task.at_point(outcome.solution.point), outcome.fit.noise)
    for g in gaps:
        found = never_crossed(outcome, g)
        # Two fits that explain the record equally badly say nothing.
        if found and not (doubtful and looks_coloured(found[0].fit.passes)):
            outcome, least[g] = found
    return outcome, least


def _starts(task: Task, gaps: Sequence[str], options: Options) -> list[dict[str, float]]:
    """Half gaps to start from: the one given, and where a scan of the likelihood has its valleys.

    With the other parameters held, one Kalman pass tells the likelihood of a half gap: cheap
    enough to look everywhere, and the valleys are narrow.
    """
    torque = np.concatenate([e.signals["motor_torque"] for e in task.experiments])
    given = {g: v for g in gaps if (v := task.drive.value(g) or 0.0) > 0.0}
    starts = [given] if given else []
    twist = {g: float(np.nanstd(torque)) / task.drive.value(g.split(".")[0] + ".stiffness") for g in gaps}

    def look(share: float, noise: Noise | None) -> tuple[float, Noise]:
        trial = task.at({g: share * twist[g] for g in gaps})
        problem = trial.problem(free=())
        point = Point(np.empty(0), first_states(trial.drive, task.roles, problem.traces))
        if noise is None:
            noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
        return minus_log_likelihood(filtered(problem, point, noise, keep=False)), noise

    with ThreadPoolExecutor(AT_ONCE) as pool:
        coarse = list(pool.map(lambda share: look(share, None), SCAN[::8]))
        noise = min(coarse, key=lambda pair: pair[0])[1]
        values = np.array([value for value, _ in pool.map(lambda share: look(share, noise), SCAN)])
        lowest = valleys(values)[: 3 * VALLEYS]
        looks = dict(zip(lowest, pool.map(lambda i: look(SCAN[i], None)[0], lowest), strict=True))
    lowest = sorted(lowest, key=looks.__getitem__)[: options.starts or VALLEYS]
    shares = [float(SCAN[i]) for i in lowest]
    if len(task.free) > len(gaps):  # the valleys lie elsewhere once the others move
        shares += SPREAD
    return starts + [{g: share * twist[g] for g in gaps} for share in shares]


def valleys(values: np.ndarray) -> list[int]:
    """Indices of the local minima of (n,) values, the lowest first."""
    padded = np.concatenate(([np.inf], values, [np.inf]))
    local = np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]))
    return [int(i) for i in local[np.argsort(values[local], kind="stable")]]


def _wide(outcome: Outcome, name: str) -> bool:
    covariance, _, free = covariance_of(outcome.problem, outcome.solution)
    j = outcome.problem.names.index(name)
    value = outcome.solution.point.values[j]
    return not free[j] or not np.sqrt(covariance[j, j]) < WIDE * value


def _profile(outcome: Outcome, name: str) -> Profile:
    covariance, _, _ = covariance_of(outcome.problem, outcome.solution)
    j = outcome.problem.names.index(name)
    std, value = np.sqrt(covariance[j, j]), outcome.solution.point.values[j]
    step = std if np.isfinite(std) and std > 0.0 else max(value, 10.0 * outcome.problem.size[j])
    return profile(outcome, name, float(step))


def _by_profile(estimate: Estimate, name: str, found: Profile) -> Estimate:
    """Replace the interval of a half gap by that of its profile."""
    line = next(p for p in estimate.parameters if p.name == name)
    low = found.low if found.low is not None else 0.0
    at_zero = found.low is None
    findings = list(estimate.findings)
    if found.high is None:
        new, finding = unbounded(line, low)
        findings.append(finding)
    elif at_zero:
        new = replace(line, std=None, ci95=(0.0, found.high), status="at-bound" if line.value <= 0.0 else "fitted",
                      reason="not distinguishable from zero; the interval is one-sided")
        findings.append(Finding(
            "note", "half-gap-not-distinguishable",
            f"{name} is not distinguishable from zero; it is at most {found.high:.3g} {line.unit}.",
            {"at_most": found.high}, "Smaller torque steps around zero shaft torque show smaller gaps.", name))
    else:
        # What the explanations disagree in is beyond the profile, which is of one of them.
        apart = Z95 * (line.std_structure or 0.0)
        low = line.value - np.hypot(line.value - low, apart)
        high = line.value + np.hypot(found.high - line.value, apart)
        new = replace(line, ci95=(max(low, 0.0), high), status="fitted",
                      std=line.std if line.std is not None else (high - low) / (2.0 * Z95))
    findings = without_untold(findings, {name})
    curve = Exhibit("profile", f"Profile likelihood of {name}", f"{name} [{line.unit}]",
                    "rise of -log likelihood", {
                        "profile": (found.values, found.rise),
                        "95 % level": (found.values[[0, -1]], np.full(2, LEVEL95))})
    parameters = tuple(new if p.name == name else p for p in estimate.parameters)
    return replace(estimate, parameters=parameters, findings=tuple(findings),
                   exhibits=(*estimate.exhibits, curve))


def without_ambiguous(estimate: Estimate, outcome: Outcome, gaps: Sequence[str]) -> Estimate:
    """No interval where a start ended at quite another gap that is as likely."""
    rivals = [s["reached"] for s in outcome.starts
              if s.get("minus_log_likelihood_above_best", np.inf) < LEVEL95 and "reached" in s]
    lines, findings = list(estimate.parameters), list(estimate.findings)
    for g in gaps:
        i = next(i for i, p in enumerate(lines) if p.name == g)
        value, width = lines[i].value, 4.0 * (lines[i].std or 0.0) + 0.02 * lines[i].value
        others = [r[g] for r in rivals if abs(r[g] - value) > width]
        if lines[i].status != "fitted" or not others:
            continue
        low, high = min([value, *others]), max([value, *others])
        lines[i] = replace(lines[i], std=None, ci95=None, status="not-identifiable",
                           reason=f"half gaps from {low:.3g} to {high:.3g} explain the record equally well")
        findings.append(Finding(
            "warning", "half-gap-ambiguous",
            f"Half gaps from {low:.3g} to {high:.3g} {lines[i].unit} explain this record equally well.",
            {"low": low, "high": high}, "Record torque steps that cross the gap both ways.", g))
    return replace(estimate, parameters=tuple(lines), findings=tuple(findings))


def _counts(outcome: Outcome, drive: Drive, gaps: Sequence[str]) -> dict[str, dict[str, float]]:
    """How often each gap opened and how often it was crossed, at the estimate."""
    task = outcome.task.at_point(outcome.solution.point)
    found = {}
    for g in gaps:
        c = contact(task, drive.shafts.index(g.split(".")[0]))
        found[g] = {"opened": c.opened, "crossed": c.crossed, "open_percent": 100.0 * c.open_share}
    return found


def _one_sided_contact(estimate: Estimate, outcome: Outcome, gaps: Sequence[str]) -> Estimate:
    """A gap that opened but never reached its other side is known only from below."""
    findings = list(estimate.findings)
    for g in gaps:
        counts = estimate.details["contact"][g]
        value = next(p.value for p in estimate.parameters if p.name == g)
        if value > 0.0 and counts["opened"] > 0 and counts["crossed"] == 0:
            findings.append(Finding(
                "warning", "gap-not-crossed",
                f"The gap opened {counts['opened']} times but its other side was never reached: {g} is known "
                f"only from below.", counts, "Record torque steps of both signs.", g))
    return replace(estimate, findings=tuple(findings))


def _not_crossed(task: Task, drive: Drive, shut: Sequence[str], closed: dict[str, Contact],
                 options: Options) -> Estimate:
    """The answer for a record whose shaft torque keeps its sign: nothing is fitted."""
    rest = tuple(n for n in task.free if n not in shut)
    held = replace(task, free=rest)
    outcome = fit_task(held, options, [{}]) if rest else frozen(held)
    findings, lines = [], []
    for g in shut:
        c = closed[g]
        findings.append(Finding(
            "warning", "gap-not-opened",
            f"The shaft torque stays between {c.least:.3g} and {c.most:.3g} {drive.torque_unit} and never changes "
            f"sign: this record does not open the gap, and says nothing about {g}.",
            {"least_shaft_torque": c.least, "largest_shaft_torque": c.most},
            "Record alternating torque steps larger than the idle torque.", g))
        value = drive.value(g) or 0.0
        lines.append(Parameter(g, value, drive.unit(g), value, status="not-identifiable",
                               reason="the gap was not opened in this record"))
    estimate = compose("backlash", drive, outcome, findings, known=options.known)
    kept = [p for p in estimate.parameters if p.name not in shut]
    order = {n: i for i, n in enumerate(drive.quantities)}
    lines = sorted([*kept, *lines], key=lambda p: order[p.name])
    return replace(estimate, parameters=tuple(lines))
