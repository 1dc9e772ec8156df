"""Tables of a parameter or validation file for the terminal, at 80 columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations

import msgspec
from rich.console import Console
from rich.text import Text

from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.tables.diagnosis_table import print_diagnosis
from drivetool.files.tables.number_format import percent, rounded, short
from drivetool.files.tables.table import Column, Row, Table, lines, numbers, short_labels
from drivetool.files.yaml import escape_unprintable, units
from drivetool.quantity import RPM_PER_RAD_S

_FIT_LABELS = {"simulation_fit_percent": "simulation fit", "one_step_fit_percent": "one-step fit",
           "rmse": "rmse of the simulation", "n": "samples"}
_SEVERITY_STYLES = {"failure": "bold red", "warning": "yellow", "note": "cyan"}  # the worst first
# Parameters that were held are dimmed; those at a bound or not identifiable stand out.
_ROW_STYLES = {"held": "dim", "at-bound": "yellow", "not-identifiable": "yellow"}
# Correlations that are stated: from this size on the two values are hardly known apart; and how many at most.
LARGE_CORRELATION, MAX_CORRELATIONS = 0.9, 10


def print_estimate(file: shapes.ParameterFile, console: Console) -> None:
    """The diagnosis if there is one, parameters, the correlated ones, why some have no +-, and the fit figures.

    file     its parameters as sections, not bare numbers
    console  where to; colours only on a terminal
    """
    if file.diagnosis is not None:
        print_diagnosis(file.diagnosis, console)
    correlations = _correlation_lines(file.covariance)
    console.print(_parameter_table(file.parameters), lines(filter(None, [_interval_scope(file)]), "dim"),
                  lines(correlations, "yellow"))
    reasons = {name: entry.reason for name, entry in file.parameters.items()
            if entry.reason not in ("", shapes.IF_COMPLETE) and entry.status != "held"}
    console.print(lines((f"{name}: {reason}" for name, reason in reasons.items()), "dim"))
    if any(entry.reason == shapes.IF_COMPLETE for entry in file.parameters.values()):
        console.print(lines([shapes.IF_COMPLETE], "yellow"))
    if reasons or correlations:
        console.print()
    if file.derived is not msgspec.UNSET:
        console.print(_derived_table(file.derived), "")
    console.print(lines(_fit_lines(file.fit)))
    if file.starts is not None and file.starts.tried > 1:
        count = file.starts.agreed or "none"
        console.print(lines([f"{count} of {file.starts.tried} starts converged to these values"]))


def without_unidentified(file: shapes.ParameterFile) -> shapes.ParameterFile:
    """The file to print: what no recording identifies has a reason in the place of a value."""
    return file.replace(parameters={n: entry if entry.status != "not-identifiable" else entry.replace(
        value=None, reason=f"{entry.reason or 'no recording identifies it'} (its value: show --all)")
        for n, entry in file.parameters.items()})


def _interval_scope(file: shapes.ParameterFile) -> str:
    """What the +- refers to: one recording, or the machine."""
    if file.step not in ("greybox", "backlash") or all(p.std is None for p in file.parameters.values()):
        return ""
    if len(file.data) == 1:
        return "+- within this record; it excludes the variation between recordings"
    if any(p.repeatability is not msgspec.UNSET for p in file.parameters.values()):
        return f"+- includes the variation between {len(file.data)} recordings; repeat: its standard deviation"
    return f"+- within these {len(file.data)} recordings"


def _correlation_lines(covariance: shapes.CovarianceSection | None) -> list[str]:
    """'motor.inertia and load.inertia: -0.97', the largest first; how many were left out."""
    if covariance is None:
        return []
    matrix = covariance.matrix
    found = {(one, two): matrix[i][j] / math.sqrt(matrix[i][i] * matrix[j][j])
             for (i, one), (j, two) in combinations(enumerate(covariance.names), 2)
             if matrix[i][i] > 0.0 and matrix[j][j] > 0.0}
    large = sorted(((abs(r), *pair, r) for pair, r in found.items() if abs(r) > LARGE_CORRELATION), reverse=True)
    shown = [f"  {one} and {two}: {r:.2f}" for _, one, two, r in large[:MAX_CORRELATIONS]]
    return [*[f"correlations above {LARGE_CORRELATION:g} in size:"][:len(large)], *shown,
            *[f"  and {len(large) - len(shown)} others"][:len(large) - len(shown)]]


def print_both(files: Sequence[shapes.ParameterFile], paths: Sequence[str], hashes: Sequence[str],
               console: Console) -> None:
    """Two parameter files side by side, the second one in the units of the first.

    hashes  SHA-256 of each file: values fitted by one from the other, or from what both read, are not independent
    raises  BadParameters: a parameter in units of different dimensions
    """
    first, second = (file.parameters for file in files)
    sources = [{own, *(entry.sha256 for entry in (*file.data, *file.inputs))}
               for file, own in zip(files, hashes, strict=True)]
    common = sources[0] & sources[1]
    rows = [_both_row(name, first.get(name), second.get(name), not common) for name in {**first, **second}]
    labels = short_labels(paths)
    heads = [title for path in paths for title in (labels[path], "+- (std)")]
    console.print(Table([Column("parameter", least=24), *numbers(*heads), Column("unit", fold=False),
                         *numbers("difference / std", rank=-1)], rows))
    note = "the files share a recording or a parameter file, hence a difference has no std"
    console.print(lines([note] if common else [], "dim"))


def _both_row(name: str, one: shapes.ParameterSection | None, two: shapes.ParameterSection | None,
              independent: bool) -> Row:
    """Value and +- of both; the difference, second less first, over the joint standard deviation."""
    missing = shapes.ParameterSection(value=None)
    unit = next((each.unit for each in (one, two) if each and each.unit), "")
    (value, std), (other, other_std) = (
        [number and units.conversion_factor(each.unit or unit, unit, name) * number
         for number in (each.value, each.std)] for each in (one or missing, two or missing))
    joint = independent and None not in (value, std, other, other_std) and math.hypot(std, other_std)
    ratio = (other - value) / joint if joint else None
    return Row((name, *rounded(value, std), *rounded(other, other_std), unit, short(ratio, 2)))


def print_validation(file: shapes.ValidationFile, console: Console) -> None:
    """One row per model and record, the cross table if there are several of both, the verdict."""
    for output in dict.fromkeys(check.output for check in file.checks):
        checks = [check for check in file.checks if check.output == output]
        console.print(*_validation_tables(checks))
    console.print(lines([file.verdict], "green" if file.passed else "bold red"))


def _validation_tables(checks: Sequence[shapes.CheckSection]) -> list[Table]:
    """Of one output: the checks, their errors by start state, and every model on every record."""
    models, files = (short_labels(getattr(check, field) for check in checks) for field in ("model", "file"))
    rows = [(check, models[check.model], files[check.file]) for check in checks]
    names, unit = [Column("model"), Column("record", least=14)], checks[0].unit
    title, figures = _check_figures(checks[0], checks[0])
    mark = {True: Text("met", "green"), False: Text("missed", "bold red")}
    found = [Table([*names, *numbers(*figures), Column("limits", fold=False, rank=-1)], [
        Row((*labels, *_check_figures(check, checks[0])[1].values(), mark[check.passed]))
        for check, *labels in rows], title, 2)]
    if any(check.measured_start_rmse is not None for check in checks):
        found.append(Table([*names, *numbers("start state fitted", "start state measured")], [
            Row((*labels, short(check.rmse), short(check.measured_start_rmse))) for check, *labels in rows],
            f"rmse of the free runs, {unit}", 2))
    if len(models) > 1 and len(files) > 1:
        fits = {(check.model, check.file): check.simulation_fit_percent for check in checks}
        found.append(Table([Column("model"), *numbers(*files.values())], [
            Row((label, *(short(fits.get((model, name))) for name in files))) for model, label in models.items()],
            "simulation fit %: model (row) on record (column)"))
    return found


def _check_figures(check: shapes.CheckSection, first: shapes.CheckSection) -> tuple[str, dict[str, str]]:
    """Title of a table and the figures of a check by head: of a free run, a required torque or a coast-down.

    first  of the checks in the table, which says of what they are
    """
    rmse, fit = f"rmse {first.unit}", short(check.simulation_fit_percent)
    if first.sensor_rmse is msgspec.UNSET and first.rmse_percent is None:
        return f"checked on {first.output}", {
            "simulation fit %": fit, "one-step fit %": short(check.one_step_fit_percent), rmse: short(check.rmse),
            "largest correlation": short(check.max_correlation, 2),
            "lags outside %": "-" if check.lags_outside_percent is None else f"{check.lags_outside_percent:.0f}"}
    if first.sensor_rmse is msgspec.UNSET:
        return "required torque (inverse dynamics)", {
            "torque fit %": fit, rmse: short(check.rmse), "rmse over rms %": short(check.rmse_percent)}
    sensor, counts, mean = (None if value is msgspec.UNSET else value
                            for value in (check.sensor_rmse, check.rmse_counts, check.nrmse_mean))
    figures = {rmse: short(check.rmse, 3), "sensor noise": short(sensor, 3)}
    if first.output != "motor_speed":
        figures |= {"count /sqrt(12)": f"{counts:.3f}" if counts is not None and counts < 10.0 else short(counts),
                    "fit %": short(check.simulation_fit_percent, 6)}
        return f"coast-downs: {first.output}", figures
    if first.unit == "rad/s":
        figures["rmse rpm"] = short(check.rmse and check.rmse * RPM_PER_RAD_S, 3)
    return f"coast-downs: {first.output}", figures | {
        "NRMSE range %": short(check.nrmse and 100.0 * check.nrmse, 3),
        "NRMSE mean %": short(100.0 * (mean or 0.0), 3),
        "R2": "-" if check.r2 is None else f"{check.r2:.6f}"}


def print_findings(findings: Sequence[shapes.FindingSection], console: Console) -> None:
    """By severity, each with what to do about it."""
    for finding in sorted(findings, key=lambda finding: [*_SEVERITY_STYLES].index(finding.severity)):
        text = escape_unprintable(" ".join(filter(None, (f" {finding.code}: {finding.text}", finding.action))))
        console.print(Text.assemble((finding.severity, _SEVERITY_STYLES[finding.severity]), text),
                      soft_wrap=not console.is_terminal)


def _parameter_table(parameters: Mapping[str, shapes.ParameterSection]) -> Table:
    """Parameter, value, unit, +- (one std), %, scatter between recordings, interval, start, status."""
    entries = parameters.values()
    repeated = any(entry.repeatability is not msgspec.UNSET for entry in entries)
    bounded = any(entry.ci95 for entry in entries)
    columns = [Column("parameter", least=24), *numbers("value"), Column("unit", fold=False),
               *numbers("+- (std)", "%"), *numbers(*["ci95"] * bounded, rank=1),
               *numbers(*["repeat"] * repeated, "start"), Column("status", rank=-1)]
    rows = [Row((
        name, value, entry.unit or "", std, percent(entry.value, entry.std),
        *[" .. ".join(rounded(end, entry.std)[0] for end in entry.ci95) if entry.ci95 else "-"] * bounded,
        *[short(None if entry.repeatability is msgspec.UNSET else entry.repeatability, 2)] * repeated,
        short(entry.start), entry.status.replace("not-", "not ")),
        _ROW_STYLES.get(entry.status, ""))
        for name, entry in parameters.items() for value, std in [rounded(entry.value, entry.std)]]
    return Table(columns, rows)


def _derived_table(figures: Mapping[str, shapes.DerivedSection]) -> Table:
    """The derived figures: figure, value, unit, +- (one std), %."""
    # A sum of parameters keeps their names.
    rows = [Row((f"  {name if '.' in name else name.replace('_', ' ')}", value, entry.unit,
                 *(("", "") if entry.std is None else (f"+- {std}", f"{percent(entry.value, entry.std)} %"))))
            for name, entry in figures.items() for value, std in [rounded(entry.value, entry.std)]]
    return Table([Column(least=24), *numbers(""), Column(fold=False), *numbers("", "")], rows)


def _fit_lines(fit: Mapping[str, float | int | str | None]) -> list[str]:
    """The fit figures, simulation and one-step named as such."""
    labels = {key: _FIT_LABELS.get(key, key.removesuffix("_percent").replace("_", " ")) for key in fit}
    width = max((len(label) for label in labels.values()), default=0) + 2
    return [f"{labels[key]:<{width}}{value if isinstance(value, str) else short(value, 6)}"
            f"{' %' if key.endswith('_percent') and value is not None else ''}" for key, value in fit.items()]
