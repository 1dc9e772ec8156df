"""Spectra to disk: the YAML summary, and the curves as Parquet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa

from drivetool.files.disk import write_whole
from drivetool.files.results.parquet_file import parquet_bytes
from drivetool.files.results.result_file import file_sections, finding_sections, tool_section
from drivetool.files.shapes import analysis_shapes as shapes
from drivetool.files.yaml import to_plain, written
from drivetool.identify.frequency import Response, Spectrum

CURVE_COLUMNS = ("frequency", "magnitude", "phase", "real", "imaginary", "noise_std", "total_std", "spread_std",
    "coherence")


def spectra_file(spectrum: Spectrum, curves: str | None = None) -> shapes.SpectraFile:
    """The summary of a frequency response; curves: name of the Parquet file, if there is one."""
    m = spectrum.mean
    return shapes.SpectraFile(
        schema=shapes.SPECTRA_SCHEMA, tool=tool_section(), step="spectra", outcome=spectrum.outcome,
        input=spectrum.input, output=spectrum.output, unit=spectrum.unit, settings=to_plain(spectrum.settings),
        lines=len(m.frequency), first_hz=float(m.frequency[0]), last_hz=float(m.frequency[-1]),
        coherence=to_plain({"median": float(np.median(m.coherence)), "least": float(m.coherence.min()),
                         "share_below_half": float(np.mean(m.coherence < 0.5))}),
        uncertainty=to_plain({"noise": _relative_std(m.noise, m.g), "with_distortion": _relative_std(m.total, m.g),
                           "over_runs": None if spectrum.spread is None else _relative_std(spectrum.spread**2,
                                                                                           m.g)}),
        peaks=[written(peak, shapes.PeakSection) for peak in spectrum.peaks],
        distortion=[written(each, shapes.DistortionSection) for each in spectrum.distortion],
        feedback=to_plain({"share": spectrum.feedback.share, "p": spectrum.feedback.p}), curves=curves,
        findings=finding_sections(spectrum.findings), data=file_sections(spectrum.data),
        options=to_plain(spectrum.options))


def _relative_std(variance: np.ndarray, g: np.ndarray) -> float | None:
    """Median of std over magnitude; None where there is none."""
    known = np.isfinite(variance)
    return float(np.median(np.sqrt(np.maximum(variance[known], 0.0)) / np.abs(g[known]))) if known.any() else None


def curves_bytes(spectrum: Spectrum) -> bytes:
    """All curves as a Parquet file: run ("all" or a recording), then CURVE_COLUMNS; NaN where there is none.

    Variances are of the complex value, E|error|^2; each of its two parts has half of it.
    """
    parts = [("all", spectrum.mean, spectrum.spread)]
    parts += [(name, r, None) for name, r in spectrum.runs] if len(spectrum.runs) > 1 else []
    units = {"frequency": "Hz", "phase": "rad", "coherence": "1"}
    run = [name for name, r, _ in parts for _ in r.frequency]
    table = np.hstack([_curve_columns(r, spread) for _, r, spread in parts])
    fields = [pa.field("run", pa.string())] + [
        pa.field(name, pa.float64(), metadata={"unit": units.get(name, spectrum.unit)}) for name in CURVE_COLUMNS]
    return parquet_bytes(pa.table([pa.array(run), *table], schema=pa.schema(fields)))


def _curve_columns(r: Response, spread: np.ndarray | None) -> np.ndarray:
    """(9, n) in the order of CURVE_COLUMNS."""
    missing = np.full(len(r.frequency), np.nan)
    return np.array([
        r.frequency, np.abs(r.g), np.angle(r.g), r.g.real, r.g.imag, np.sqrt(np.maximum(r.noise, 0.0)),
        np.sqrt(np.maximum(r.total, 0.0)), missing if spread is None else spread, r.coherence])


def write_curves(path: str | Path, spectrum: Spectrum) -> None:
    """The Parquet file, whole or not at all."""
    write_whole(path, curves_bytes(spectrum))
