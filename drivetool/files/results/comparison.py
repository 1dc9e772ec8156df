"""A comparison to disk."""

from __future__ import annotations

from drivetool.files.results.result_file import Inputs, file_sections, finding_sections, tool_section
from drivetool.files.shapes import analysis_shapes as shapes
from drivetool.files.yaml import to_plain, written
from drivetool.identify.several import Comparison


def comparison_file(found: Comparison, inputs: Inputs = ()) -> shapes.ComparisonFile:
    """Cross-tables and scatter over the experiments, as `show` reads them."""
    structures = [{"structure": m.structure, "record": m.record, "noise_parameters": m.noise_parameters,
                   "unstable": m.unstable, "why_not": m.failure} for m in found.models]
    return shapes.ComparisonFile(
        schema=shapes.COMPARISON_SCHEMA, tool=tool_section(), step="compare", outcome=found.outcome,
        structures=to_plain(structures),
        cross=[shapes.CrossSection(structure=s, fitted_on=a, checked_on=b, simulation_fit_percent=to_plain(v))
               for (s, a, b), v in found.cross.items()],
        spread=[written(each, shapes.SpreadSection) for each in found.spread],
        differences=[written(each, shapes.DifferenceSection) for each in found.differences],
        findings=finding_sections(found.findings), data=file_sections(found.data),
        inputs=file_sections(inputs),
        options=to_plain(found.options))
