"""The tables of a file of any kind, at 80 columns."""

from __future__ import annotations

from rich.console import Console

from drivetool.files.shapes import (
    ComparisonFile,
    GainsFile,
    InspectionFile,
    ParameterFile,
    Shape,
    SpectraFile,
    TrendsFile,
    ValidationFile,
)
from drivetool.files.tables.analysis_tables import print_comparison, print_spectra
from drivetool.files.tables.gains_table import print_gains
from drivetool.files.tables.inspection_table import print_inspection
from drivetool.files.tables.result_tables import print_estimate, print_validation
from drivetool.files.tables.trends_table import print_trends

_PRINTERS = {ParameterFile: print_estimate, ValidationFile: print_validation, InspectionFile: print_inspection,
             SpectraFile: print_spectra, ComparisonFile: print_comparison, TrendsFile: print_trends}


def print_file(file: Shape, console: Console, per_unit: bool = False) -> None:
    """The tables of a file; colours only on a terminal.

    file      of one of the kinds above, or of gains
    per_unit  gains as figures of the ratings where the file has them
    """
    if isinstance(file, GainsFile):
        print_gains(file, console, per_unit)
    else:
        _PRINTERS[type(file)](file, console)
