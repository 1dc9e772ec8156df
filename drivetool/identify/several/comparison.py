"""Every structure fitted on every record and validated on all: cross-tables, and figures over experiments.

The papers on the robot axis and on the bus driveline assess their models in this way. A model that explains only
the record it was fitted on is not identified.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, DriveToolError, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.channels import torque_timing
from drivetool.identify.estimate import Estimate, Parameter, PlotData, fit_percent, parameters_of
from drivetool.identify.fit import by_innovations, by_simulation, free_run, with_totals
from drivetool.identify.greybox import default_free
from drivetool.identify.polynomial import (
    DEFAULT_NOISE_ORDER,
    KINDS,
    PemFit,
    Structure,
    chain_parameters,
    conversion,
    data_of,
    figures_of,
    fit_structure,
    polynomial_blackbox,
    ringing_frequencies,
    ringing_frequencies_with_std,
    simulated_fit,
)
from drivetool.identify.setup import Options, Task, roles_of
from drivetool.identify.several.differences import (
    between_machines,
    difference_findings,
    differences,
)
from drivetool.identify.several.sections import DifferenceSection, SpreadSection
from drivetool.logs import Experiment, Source, number_duplicates
from drivetool.quantity import names_of

PHYSICAL = ("physical", "physical-innovations")
STRUCTURES = (*KINDS, *PHYSICAL)
# Simulation-error fit: its std lacks the torque noise, so differences are not tested.
WITHOUT_VALID_STD = "physical"


@dataclass(frozen=True)
class CompareOptions:
    """What is compared.

    structures  in the order of the tables; order of polynomial ones, None: 2 n - 1 for n bodies; noise_order
    machines    name -> its recordings, by their place; empty: each recording for itself
    """

    structures: tuple[str, ...] = ("oe", "bj")
    order: int | None = None
    noise_order: int | None = None
    machines: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __post_init__(self):
        for name in self.structures:
            if name not in STRUCTURES:
                raise BadOption("a known structure", f"'{name}'", "Correct --structure.", STRUCTURES)


@dataclass(frozen=True)
class FittedStructure:
    """A structure fitted on one record.

    fit       polynomial models; None for physical ones
    drive     with its values, physical models
    lines     parameters of the drive, where they follow
    figures   name -> (value, std or None, unit)
    why       why there is no fit; empty if there is one
    findings  of the fit about the recording
    """

    structure: str
    record: str
    fit: PemFit | None = None
    drive: Drive | None = None
    lines: tuple[Parameter, ...] = ()
    figures: Mapping[str, tuple[float, float | None, str]] = field(default_factory=dict)
    unstable: bool = False
    noise_parameters: int = 0
    failure: str = ""
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """cross: (structure, fitted on, checked on) -> fit [%] or None; spread: scatter per structure and figure.

    differences  of figures whose std holds, between records
    """

    models: tuple[FittedStructure, ...]
    cross: Mapping[tuple[str, str, str], float | None]
    spread: tuple[SpreadSection, ...]
    differences: tuple[DifferenceSection, ...]
    outcome: str
    findings: tuple[Finding, ...]
    data: tuple[Source, ...]
    options: Mapping[str, object] = field(default_factory=dict)
    exhibits: tuple[PlotData, ...] = ()


def compare(experiments: Sequence[Experiment], drive: Drive, options: CompareOptions) -> Comparison:
    """Cross-tables and spreads.

    experiments  each is fitted on its own and serves to check the fits on the others
    drive        how many bodies; its ratios. Values serve as start of the physical structures, else those
                 of output error do
    returns      Comparison
    raises       NotEnoughData: fewer than two recordings
    source       Ostring et al. 2003, tables 2-6; the bus driveline paper's table of means
    """
    if len(experiments) < 2:
        raise NotEnoughData("at least two recordings to compare", f"{len(experiments)}", "Name another log file.")
    names = number_duplicates([e.name for e in experiments])
    models = [fitted_structure(structure, name, e, drive, options, experiments)
              for structure in options.structures for name, e in zip(names, experiments, strict=True)]
    cross = {(m.structure, m.record, name): _validation_fit_percent(m, e) for m in models
             for name, e in zip(names, experiments, strict=True)}
    machines = {name: [names[i] for i in places] for name, places in options.machines.items()}
    figures = {s: {m.record: compared_figures(m) for m in models if m.structure == s}
               for s in dict.fromkeys(m.structure for m in models)}
    differences_found = [
        between_machines(s, of_records, machines) if machines else differences(s, of_records)
        for s, of_records in figures.items() if s != WITHOUT_VALID_STD]
    return Comparison(
        tuple(models), cross, tuple(scatter_over_records(models, names)),
        tuple(d for each in differences_found for d in each),
        _best_structure_sentence(cross),
        (*_comparison_findings(models, cross),
         *(f for each in differences_found for f in difference_findings(each, bool(machines)))),
        tuple(e.source for e in experiments), {}, _bode_plots(models, experiments[0].step))


def fitted_structure(structure: str, name: str, e: Experiment, drive: Drive, options: CompareOptions,
             compared: Sequence[Experiment]) -> FittedStructure:
    """One fit; a failure is an entry of the table, not the end of it.

    compared  all recordings that are compared: a parameter identifiable from one of them is free in each
    """
    try:
        if structure in PHYSICAL:
            return _fit_physical(structure, name, e, drive, compared)
        order = options.order or 2 * len(drive.bodies) - 1
        noise = DEFAULT_NOISE_ORDER if options.noise_order is None else options.noise_order
        return _fit_polynomial(structure, name, e, drive, order, noise)
    except DriveToolError as error:
        return FittedStructure(structure, name, failure=str(error))


def _fit_polynomial(structure: str, name: str, e: Experiment, drive: Drive, order: int,
                    noise: int) -> FittedStructure:
    data = data_of([e])
    fit = fit_structure(data.stretches, Structure(structure, order, noise, data.extra))
    f = figures_of(fit, data.step)
    figures = {f"{kind} {i}": (pair.rad_s, f.std(pair.d_rad_s), "rad/s")
               for kind, pairs in (("notch", f.notches), ("resonance", f.resonances))
               for i, pair in enumerate(pairs, 1)}
    found, covariance, _ = conversion(drive, f, data.extra)
    if covariance is not None:  # of the drive itself, as for the physical models, not of its samples
        figures |= {n: (w, std, "rad/s")
                    for n, (w, std) in ringing_frequencies_with_std(drive, found, covariance).items()}
    return FittedStructure(structure, name, fit, None, chain_parameters(drive, found), figures, bool(f.unstable),
                 fit.structure.noise_parameters)


def _fit_physical(structure: str, name: str, e: Experiment, drive: Drive,
                  compared: Sequence[Experiment]) -> FittedStructure:
    """The grey box without its hold-out trials: one fit by its criterion."""
    start = drive if not drive.missing() else _with_start_values(drive, e)
    parts = names_of(start.bodies, "viscous")
    start = with_totals(start, (), parts)
    # Friction of each body, at its own speed: with K = 0 this is the output-error model.
    start = start.with_values({p: start.value(p) or 0.0 for p in parts})
    free = tuple(n for n in start.quantities if n in {*default_free(start, compared), *parts}
                 and n != "total.viscous"
                )
    task = Task(start, free, roles_of([e], start), (e,))
    outcome = by_simulation(task, 0.0, [{}]) if structure == "physical" else by_innovations(task, [{}])
    lines, _, _ = parameters_of(outcome.problem, outcome.solution, start, outcome.drive)
    figures = {name: (w, None, "rad/s") for name, w in ringing_frequencies(outcome.drive).items()}
    counted = 0 if outcome.fit is None else outcome.fit.noise.parameters
    return FittedStructure(structure, name, None, outcome.drive, lines, figures, False, counted,
                 findings=tuple(torque_timing(outcome)))


def _with_start_values(drive: Drive, e: Experiment) -> Drive:
    """The drive with the values that output error finds."""
    estimate: Estimate = polynomial_blackbox([e], drive, Options(structure="oe", order=2 * len(drive.bodies) - 1))
    if estimate.drive.missing():
        raise NotEnoughData(f"start values of a chain of {len(drive.bodies)} bodies",
                            "none from an output-error model", "Give them with --params or --set.")
    return estimate.drive


def _validation_fit_percent(m: FittedStructure, e: Experiment) -> float | None:
    """Fit [%] of a free run over a record, its start values adjusted; None where there is none."""
    if m.fit is not None:
        data = data_of([e])
        return simulated_fit(m.fit, data.step, data.stretches)
    if m.drive is None:
        return None
    problem, _, runs = free_run(Task(m.drive, (), roles_of([e], m.drive), (e,)))
    y = np.concatenate([t.outputs[:, 0] for t in problem.traces])
    return fit_percent(y, np.concatenate([r[:, 0] for r in runs]))


def scatter_over_records(models: Sequence[FittedStructure], records: Sequence[str]) -> list[SpreadSection]:
    """Mean and scatter of every figure that all records have."""
    found = []
    for structure in dict.fromkeys(m.structure for m in models):
        mine = {m.record: compared_figures(m) for m in models if m.structure == structure}
        for name in dict.fromkeys(n for figures in mine.values() for n in figures):
            entries = [mine.get(r, {}).get(name) for r in records]
            values = np.array([x[0] for x in entries if x is not None and np.isfinite(x[0])])
            if len(values) < len(records):
                continue  # the mean of those that happen to be above a bound would be no mean
            std = float(values.std(ddof=1))
            unit = next(x[2] for x in entries if x is not None)
            found.append(SpreadSection(
                structure, name, unit, tuple(x and float(x[0]) for x in entries),
                tuple(x and x[1] for x in entries), float(values.mean()), std, std / float(np.sqrt(len(values)))))
    return found


def compared_figures(m: FittedStructure) -> dict[str, tuple[float, float | None, str]]:
    """Pole and zero pairs, then the parameters that the fit identifies."""
    lines = {p.name: (p.value, p.std, p.unit) for p in m.lines if p.status == "fitted"}
    return dict(m.figures) | lines


def _bode_plots(models: Sequence[FittedStructure], step: float) -> tuple[PlotData, ...]:
    """The responses of the polynomial models over each other, one picture per structure."""
    found = []
    for structure in dict.fromkeys(m.structure for m in models if m.fit is not None):
        mine = [m for m in models if m.structure == structure and m.fit is not None]
        pairs = [v for m in mine for n, (v, _, _) in m.figures.items() if n.startswith(("notch", "resonance"))]
        low, high = (0.2 * min(pairs), 3.0 * max(pairs)) if pairs else (0.02 / step, 0.5 / step)
        hz = np.geomspace(low, min(high, 0.9 * np.pi / step), 400) / (2.0 * np.pi)
        curves = {m.record: (hz, np.abs(figures_of(m.fit, step).response(hz)[0])) for m in mine}
        found.append(PlotData("bode", f"{structure}: fitted on each record", "frequency [Hz]", "magnitude", curves))
    return tuple(found)


def _best_structure_sentence(cross: Mapping[tuple[str, str, str], float | None]) -> str:
    """Which structure simulates the other records best."""
    scores = {}
    for structure in dict.fromkeys(s for s, _, _ in cross):
        others = [v for (s, a, b), v in cross.items() if s == structure and a != b]
        if others and all(v is not None for v in others):
            scores[structure] = float(np.mean(others))
    if not scores:
        return "no structure can be simulated on all other records"
    best = max(scores, key=scores.get)
    return (f"{best} has the best simulation fit on records it was not fitted on: {scores[best]:.1f} % on average"
            + "".join(f", {s} {v:.1f} %" for s, v in scores.items() if s != best))


def _comparison_findings(models: Sequence[FittedStructure],
                         cross: Mapping[tuple[str, str, str], float | None]) -> list[Finding]:
    found = []
    for m in models:
        found += [f.replace(text=f"{m.structure} on {m.record}: {f.text}") for f in m.findings]
        if m.failure or m.unstable:
            what = m.failure or "the model is unstable and is not simulated"
            found.append(Finding("warning", "unstable-estimate" if m.unstable else "no-fit",
                                 f"{m.structure} on {m.record}: {what}.", {}, "Leave it out, or change the order."))
    for structure in dict.fromkeys(m.structure for m in models):
        found += _moving_notch_findings(structure, [m for m in models if m.structure == structure])
    return found


def _moving_notch_findings(structure: str, models: Sequence[FittedStructure]) -> list[Finding]:
    """A first notch that differs between records by more than its standard deviations: not one linear drive."""
    known = {m.record: x for m in models if (x := m.figures.get("notch 1")) is not None and x[1] is not None}
    if len(known) < 2:
        return []
    low, high = (f(known, key=lambda r: known[r][0]) for f in (min, max))
    shift, std = known[high][0] - known[low][0], float(np.hypot(known[high][1], known[low][1]))
    if shift < 4.0 * std or shift < 0.003 * known[high][0]:
        return []
    return [Finding(
        "warning", "parameters-differ",
        f"{structure}: the first anti-resonance is {known[low][0]:.4g} rad/s on {low} and "
        f"{known[high][0]:.4g} on {high}, {shift / std:.0f} standard deviations apart. No single linear model "
        "describes both records.", {"low": known[low][0], "high": known[high][0], "std": std},
        "A lower anti-resonance at a lower amplitude points to backlash: compare amplitudes, and excite odd lines "
        "only.")]
