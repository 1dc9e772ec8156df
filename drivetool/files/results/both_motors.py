"""Two parameter files as the sides of one drive, and the file of their comparison."""

from __future__ import annotations

import msgspec
import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadParameters
from drivetool.files.results.result_file import Inputs, file_sections, finding_sections, tool_section
from drivetool.files.shapes import analysis_shapes as shapes
from drivetool.files.yaml import Loaded, written
from drivetool.identify.estimate import Covariance
from drivetool.identify.several import Figure, Side, Swap
from drivetool.logs import number_duplicates


def sides_of(first: Loaded, second: Loaded) -> tuple[Side, Side]:
    """Both files as sides.

    first, second  one file each
    raises         BadParameters: no values, a variance that is not positive, or one recording behind both files
    """
    recordings = {entry.sha256: entry.file for entry in first.sources[0].file.data}
    common_records = [recordings[e.sha256] for e in second.sources[0].file.data if e.sha256 in recordings]
    if common_records:
        raise BadParameters("two files fitted to different recordings",
                            f"{common_records[0]} as the source of both",
                            "Identify each side from a recording in which its own motor moves the drive.")
    one, other = number_duplicates([_display_name(loaded) for loaded in (first, second)])
    return _side_of(first, one), _side_of(second, other)


def _display_name(loaded: Loaded) -> str:
    return "standard input" if loaded.sources[0].name == "-" else loaded.sources[0].name


def _side_of(loaded: Loaded, name: str) -> Side:
    drive, file = loaded.stated().start, loaded.sources[0].file
    if not drive.values:
        raise BadParameters("parameters with values", f"none in {name}",
                            "Give a file that greybox, backlash or blackbox wrote.")
    reasons = {n: section.reason for n, section in loaded.sections(drive).items()}
    derived = {} if file.derived is msgspec.UNSET else {
        n: Figure(f.value, f.unit, f.std or None, f.reason) for n, f in file.derived.items()}
    return Side(name, drive, reasons, _full_covariance(loaded, drive, name), derived)


def _full_covariance(loaded: Loaded, drive: Drive, name: str) -> Covariance | None:
    """Of all values with a standard deviation; those in no covariance section count as uncorrelated."""
    known = loaded.covariance(drive) or Covariance((), np.zeros((0, 0)))
    single_stds = {n: std for n, std in loaded.stds(drive).items() if n in drive.values and n not in known.names}
    names = (*known.names, *single_stds)
    matrix = np.zeros((len(names), len(names)))
    k = len(known.names)
    matrix[:k, :k] = 0.5 * (known.matrix + known.matrix.T)
    matrix[range(k, len(names)), range(k, len(names))] = np.square(list(single_stds.values()))
    wrong = [n for n, v in zip(names, np.diag(matrix), strict=True) if not 0.0 < v < np.inf]
    if wrong or not np.isfinite(matrix).all():
        raise BadParameters("variances above zero in the covariance", f"other values in {name}",
                            "Correct it, or delete the whole covariance section.", wrong)
    return Covariance(names, matrix) if names else None


def swap_file(found: Swap, inputs: Inputs = ()) -> shapes.ComparisonFile:
    """The comparison as `show` reads it."""
    return shapes.ComparisonFile(
        schema=shapes.COMPARISON_SCHEMA, tool=tool_section(), step="compare", outcome=found.outcome,
        structures=[], cross=[], spread=[], differences=[], swap=written(found, shapes.SwapSection),
        findings=finding_sections(found.findings), data=[], inputs=file_sections(inputs), options={"swap": True})
