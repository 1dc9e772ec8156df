"""Frequency response from torque to a sensor, with coherence and uncertainty.

By Welch, or over whole periods where the excitation repeats; several recordings are runs of one experiment.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import (
    Job,
    check_common_units,
    check_outputs,
    collected_findings,
    common as cli,
    is_input,
    noted_options,
    open_all,
)
from drivetool.cli.output import deliver, recordings_drawn_on_failure, say

if TYPE_CHECKING:
    from drivetool.identify.frequency import SpectraOptions

EXAMPLE = "drivetool spectra chirp.parquet --length 1 --out spectra.yaml"

# How spectra are averaged.
MethodName = StrEnum("MethodName", ("auto", "welch", "periodic"))
# Which noise the estimate assumes.
EstimatorName = StrEnum("EstimatorName", ("h1", "h2", "h3", "hv", "indirect"))
Method = Annotated[MethodName, typer.Option(
    "--method", help="Welch's frames, whole periods, or periods where there are some.")]
EstimatorKind = Annotated[EstimatorName | None, typer.Option(
    "--estimator", help="h1 noise at the output, h2 at the input, h3 their mean, hv their geometric mean, indirect "
    "over a reference_* role in closed loop. Default: indirect where there is a reference, else h1.")]
Window = Annotated[str, typer.Option("--window", metavar="NAME", help="Of Welch's frames, as SciPy calls it.")]
Length = Annotated[float | None, typer.Option(
    "--length", metavar="S", min=0.0, help="Of a frame. Default: 16 frames of half overlap in the record.")]
Overlap = Annotated[float, typer.Option("--overlap", metavar="SHARE", help="Of neighbouring frames.")]
Period = Annotated[float | None, typer.Option(
    "--period", metavar="S", min=0.0, help="Of the excitation. Default: found.")]
Skip = Annotated[int | None, typer.Option(
    "--skip", metavar="N", min=0, help="Periods left out at the start. Default: one, if three are left.")]
Output = Annotated[str | None, typer.Option(
    "--output", metavar="ROLE", help="Sensor. Default: the motor's speed, else its angle as speed.")]
Curves = Annotated[str | None, typer.Option(
    "--curves", metavar="FILE", help="Parquet file for all lines. Default: beside --out x.yaml as "
    "x.curves.parquet; without --out there is none.")]


def command(
    logs: cli.Logs, map: cli.Map = None, condition: cli.Condition = None, method: Method = MethodName.auto,
    estimator: EstimatorKind = None, window: Window = "hann", length: Length = None, overlap: Overlap = 0.5,
    period: Period = None, skip: Skip = None, output: Output = None, band: cli.Band = None,
    curves: Curves = None, out: cli.Out = None, json: cli.Json = False, plot: cli.Plot = None,
    strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.identify.frequency import SpectraOptions

    job = Job("spectra", logs, (), map, None, (), out, json, plot, strict, quiet, condition or ())
    return run(job, SpectraOptions(method.value, estimator.value if estimator else None, window, length, overlap,
                                   period, skip, output, band), curves)


def run(job: Job, options: SpectraOptions, curves: str | None = None) -> int:
    """Open, estimate, deliver; the exit code."""
    from drivetool.files.results import spectra_file, write_curves
    from drivetool.identify.frequency import reference_of, spectra

    if curves is None and job.out not in (None, "-"):
        curves = _curves_path(job, job.out)
    check_outputs(job, curves=curves)
    opened = open_all(job)
    check_common_units(opened.experiments)
    with recordings_drawn_on_failure(job, opened.experiments):
        spectrum = spectra(opened.experiments, options)
    used = {"motor_torque", spectrum.output, *reference_of(opened.experiments[0])}
    spectrum = replace(spectrum, options=noted_options(job, asdict(options)),
                       findings=collected_findings(opened, spectrum.findings, used, None, job.step))
    if curves:
        write_curves(curves, spectrum)
        if not job.quiet:
            say(job.step, f"wrote {curves}")
    return deliver(job, spectra_file(spectrum, Path(curves).name if curves else None), spectrum.exhibits)


def _curves_path(job: Job, path: str) -> str:
    """'x.curves.parquet' beside x.yaml: not x.parquet, which may well be a recording."""
    while is_input(job, path := str(Path(path).with_suffix(".curves.parquet"))):
        pass
    return path
