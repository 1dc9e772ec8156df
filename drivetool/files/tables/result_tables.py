"""Tables of a parameter or validation file for the terminal, at 80 columns."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import PurePath

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.quantity import RPM_PER_RAD_S

_FIT_LABELS = {"simulation_fit_percent": "simulation fit", "one_step_fit_percent": "one-step fit",
           "rmse": "rmse of the simulation", "n": "samples"}
_SEVERITY_STYLES = {"note": "cyan", "warning": "yellow", "failure": "bold red"}
_SEVERITY_ORDER = ("failure", "warning", "note")


def print_estimate(file: shapes.ParameterFile, console: Console) -> None:
    """Parameters, why some have no +-, and the fit figures.

    file     its parameters as sections, not bare numbers
    console  where to; colours only on a terminal
    """
    console.print(parameter_table(file.parameters))
    if interval_scope := _interval_scope(file):
        console.print(Text(f"  {interval_scope}", style="dim"))
    reasons = {name: entry.reason for name, entry in file.parameters.items()
            if entry.reason not in ("", shapes.IF_COMPLETE) and entry.status != "held"}
    for name, reason in reasons.items():
        console.print(Text(f"  {name}: {reason}", style="dim"))
    if any(entry.reason == shapes.IF_COMPLETE for entry in file.parameters.values()):
        console.print(Text(f"  {shapes.IF_COMPLETE}", style="yellow"))
    if reasons:
        console.print()
    if file.derived is not msgspec.UNSET:
        console.print(derived_table(file.derived))
        console.print()
    for line in fit_lines(file.fit):
        console.print(Text(f"  {line}"))
    if file.starts is not None and file.starts.tried > 1:
        count = file.starts.agreed or "none"
        console.print(Text(f"  {count} of {file.starts.tried} starts converged to these values"))


def _interval_scope(file: shapes.ParameterFile) -> str:
    """What the +- refers to: one recording, or the machine."""
    if file.step not in ("greybox", "backlash") or all(p.std is None for p in file.parameters.values()):
        return ""
    if len(file.data) == 1:
        return "+- within this record; it excludes the variation between recordings"
    if any(p.repeatability is not msgspec.UNSET for p in file.parameters.values()):
        return f"+- includes the variation between {len(file.data)} recordings; repeat: its standard deviation"
    return f"+- within these {len(file.data)} recordings"


def print_validation(file: shapes.ValidationFile, console: Console) -> None:
    """One row per model and record, the cross table if there are several of both, the verdict."""
    for output in dict.fromkeys(check.output for check in file.checks):
        checks = [check for check in file.checks if check.output == output]
        console.print(_table_for(checks[0])(checks))
        if any(check.measured_start_rmse is not None for check in checks):
            console.print(start_table(checks))
        models, files = _unique_values(checks, "model"), _unique_values(checks, "file")
        if len(models) > 1 and len(files) > 1:
            console.print(cross_table(checks))
    console.print(Text(f"  {file.verdict}", style="green" if file.passed else "bold red"))


def _table_for(check: shapes.CheckSection) -> Callable[[Sequence[shapes.CheckSection]], Table]:
    """Which table shows checks of this kind."""
    if check.sensor_rmse is not msgspec.UNSET:
        return coast_down_table
    return check_table if check.rmse_percent is None else torque_table


def print_findings(findings: Sequence[shapes.FindingSection], console: Console) -> None:
    """By severity, each with what to do about it."""
    for severity in _SEVERITY_ORDER:
        for finding in findings:
            if finding.severity == severity:
                text = Text.assemble((severity, _SEVERITY_STYLES[severity]), f" {finding.code}: {finding.text}")
                if finding.action:
                    text.append(f" {finding.action}")
                console.print(text, soft_wrap=not console.is_terminal)


def parameter_table(parameters: Mapping[str, shapes.ParameterSection]) -> Table:
    """Parameter, value, unit, +- (one std), %, scatter between recordings, start, status; held ones dimmed."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    table.add_column("parameter", overflow="fold", min_width=min(24, max(map(len, parameters), default=9)))
    repeated = any(entry.repeatability is not msgspec.UNSET for entry in parameters.values())
    for title, side in (("value", "right"), ("unit", "left"), ("+- (std)", "right"), ("%", "right"),
                        *([("repeat", "right")] if repeated else []), ("start", "right")):
        table.add_column(title, justify=side, no_wrap=True)
    table.add_column("status", overflow="fold")
    for name, entry in parameters.items():
        value, std = rounded(entry.value, entry.std)
        scatter = None if entry.repeatability is msgspec.UNSET else entry.repeatability
        cells = (name, value, entry.unit or "", std, percent(entry.value, entry.std),
                 *([short(scatter, 2)] if repeated else []), short(entry.start),
                 entry.status.replace("not-", "not "))
        table.add_row(*map(Text, cells), style=_row_style(entry.status))
    return table


def derived_table(figures: Mapping[str, shapes.DerivedSection]) -> Table:
    """The derived figures: figure, value, unit, +- (one std), %."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False, show_header=False)
    for side in ("left", "right", "left", "right", "right"):
        table.add_column(justify=side)
    for name, entry in figures.items():
        value, std = rounded(entry.value, entry.std)
        known = ("", "") if entry.std is None else (f"+- {std}", f"{percent(entry.value, entry.std)} %")
        table.add_row(*map(Text, (f"  {name.replace('_', ' ')}", value, entry.unit, *known)))
    return table


def check_table(checks: Sequence[shapes.CheckSection]) -> Table:
    """One row per model and record, for one output."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                  title=Text(f"checked on {checks[0].output}"), title_justify="left")
    table.add_column("model", overflow="fold")
    models, files = _model_and_record_labels(checks)
    table.add_column("record", overflow="fold", min_width=min(14, max(map(len, files.values()))))
    for title in ("simulation fit %", "one-step fit %", f"rmse {checks[0].unit}", "largest corr.",
                  "lags out %"):
        table.add_column(title, justify="right", min_width=max(map(len, title.split())))
    table.add_column("limits", no_wrap=True, min_width=6)
    for check in checks:
        cells = (models[check.model], files[check.file], short(check.simulation_fit_percent),
                 short(check.one_step_fit_percent), short(check.rmse), short(check.max_correlation, 2),
                 "-" if check.lags_outside_percent is None else f"{check.lags_outside_percent:.0f}")
        mark = Text("met", "green") if check.passed else Text("missed", "bold red")
        table.add_row(*map(Text, cells), mark)
    return table


def torque_table(checks: Sequence[shapes.CheckSection]) -> Table:
    """The same for the required torque, which has neither one-step predictions nor a start state."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                  title=Text("required torque (inverse dynamics)"), title_justify="left")
    for title in ("model", "record"):
        table.add_column(title, overflow="fold")
    for title in ("torque fit %", f"rmse {checks[0].unit}", "rmse over rms %"):
        table.add_column(title, justify="right", min_width=len(title))
    table.add_column("limits", no_wrap=True, min_width=6)
    models, files = _model_and_record_labels(checks)
    for check in checks:
        cells = (models[check.model], files[check.file], short(check.simulation_fit_percent), short(check.rmse),
                 short(check.rmse_percent))
        table.add_row(*map(Text, cells), Text("met", "green") if check.passed else Text("missed", "bold red"))
    return table


def coast_down_table(checks: Sequence[shapes.CheckSection]) -> Table:
    """The angle of coast-downs in counts, or their speed over its range and over its mean."""
    first, speeds = checks[0], checks[0].output == "motor_speed"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                  title=Text(f"coast-downs: {first.output}"), title_justify="left")
    for title in ("model", "record"):
        table.add_column(title, overflow="fold")
    turns = speeds and first.unit == "rad/s"
    titles = ["rmse rpm"] * turns + ["NRMSE range %", "NRMSE mean %", "R2"] if speeds else [
        "count /sqrt(12)", "fit %"]
    for title in (f"rmse {first.unit}", "sensor noise", *titles):
        table.add_column(title, justify="right", min_width=max(map(len, title.split())))
    table.add_column("limits", no_wrap=True, min_width=6)
    models, files = _model_and_record_labels(checks)
    for c in checks:
        figures = [short(c.rmse, 3), short(_or_none(c.sensor_rmse), 3)]
        if speeds:
            figures += [short(c.rmse and c.rmse * RPM_PER_RAD_S, 3)] * turns
            figures += [short(c.nrmse and 100.0 * c.nrmse, 3), short(100.0 * (_or_none(c.nrmse_mean) or 0.0), 3),
                        "-" if c.r2 is None else f"{c.r2:.6f}"]
        else:
            counts = _or_none(c.rmse_counts)
            figures += [f"{counts:.3f}" if counts is not None and counts < 10.0 else short(counts),
                        short(c.simulation_fit_percent, 6)]
        table.add_row(*map(Text, (models[c.model], files[c.file], *figures)),
                      Text("met", "green") if c.passed else Text("missed", "bold red"))
    return table


def _or_none(value: float | msgspec.UnsetType) -> float | None:
    return None if value is msgspec.UNSET else value


def start_table(checks: Sequence[shapes.CheckSection]) -> Table:
    """Error of the free runs by their start state, one row per model and record, for one output."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                  title=Text(f"rmse of the free runs, {checks[0].unit}"), title_justify="left")
    for title in ("model", "record"):
        table.add_column(title, overflow="fold")
    for title in ("start state fitted", "start state measured"):
        table.add_column(title, justify="right", min_width=len(title))
    models, files = _model_and_record_labels(checks)
    for check in checks:
        cells = (models[check.model], files[check.file], short(check.rmse), short(check.measured_start_rmse))
        table.add_row(*map(Text, cells))
    return table


def cross_table(checks: Sequence[shapes.CheckSection]) -> Table:
    """Simulation fit in % of every model (row) on every record (column)."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                  title=Text("simulation fit %: model (row) on record (column)"),
                  title_justify="left")
    table.add_column("model", overflow="fold")
    models, files = _model_and_record_labels(checks)
    for label in files.values():
        table.add_column(Text(label), justify="right", overflow="fold", min_width=6)
    fits = {(check.model, check.file): check.simulation_fit_percent for check in checks}
    for model, label in models.items():
        table.add_row(Text(label), *(Text(short(fits.get((model, name)))) for name in files))
    return table


def fit_lines(fit: Mapping[str, float | int | str | None]) -> list[str]:
    """The fit figures, simulation and one-step named as such."""
    labels = {key: _FIT_LABELS.get(key, key.removesuffix("_percent").replace("_", " ")) for key in fit}
    width = max((len(label) for label in labels.values()), default=0) + 2
    lines = []
    for key, value in fit.items():
        text = value if isinstance(value, str) else short(value, 6)
        lines.append(f"{labels[key]:<{width}}{text}"
                     f"{' %' if key.endswith('_percent') and value is not None else ''}")
    return lines


def rounded(value: float | None, std: float | None) -> tuple[str, str]:
    """Value and +- to the same digit: two significant ones of the std.

    value, std  None where there is none
    returns     ('0.5871', '0.0012'); '-' where there is none
    """
    if value is None:
        return "-", "-" if std is None else f"{std:.1e}"
    if not std:
        return short(value, 5), "-" if std is None else "0"
    last = int(f"{std:.1e}".partition("e")[2]) - 1  # power of ten of the last digit shown
    if -6 <= last <= 3 and abs(value) < 1e7:
        return f"{round(value, -last):.{max(0, -last)}f}", f"{round(std, -last):.{max(0, -last)}f}"
    first = math.floor(math.log10(abs(value))) if value else last + 1
    return f"{value:.{max(0, first - last)}e}", f"{std:.1e}"


def percent(value: float | None, std: float | None) -> str:
    """The std in % of the value."""
    if not value or std is None:
        return "-"
    share = 100 * std / abs(value)
    return f"{share:.0f}" if 10 <= share < 1e4 else f"{share:#.2g}"


def short(value: float | int | None, digits: int = 4) -> str:
    """A number in a few digits; '-' where there is none."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.{digits}g}"


def _row_style(status: str) -> str:
    """Parameters that were held are dimmed; those at a bound or not identifiable stand out."""
    return {"held": "dim", "at-bound": "yellow", "not-identifiable": "yellow"}.get(status, "")


def _unique_values(checks: Iterable[shapes.CheckSection], field: str) -> list[str]:
    """Models or files, each once, in the order given."""
    return list(dict.fromkeys(getattr(check, field) for check in checks))


def _model_and_record_labels(checks: Sequence[shapes.CheckSection]) -> tuple[dict[str, str], dict[str, str]]:
    """The labels of the models, and of the recordings."""
    return short_labels(check.model for check in checks), short_labels(check.file for check in checks)


def short_labels(names: Iterable[str]) -> dict[str, str]:
    """Name -> label of a file in a table: without folder and suffix, which cost width, where that is unique."""
    stems = {name: PurePath(name).stem for name in dict.fromkeys(names)}
    many = Counter(stems.values())
    return {name: stem if many[stem] == 1 else name for name, stem in stems.items()}
