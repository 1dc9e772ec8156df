"""The registry of finding codes: each code that a finding may have, with its meaning and what to do.

One table per stage of the work. The reference pages print it, and `finding.Finding` refuses a code that it lacks.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from drivetool.finding_codes import checks, fits, records, steady, trends, tuning
from drivetool.finding_codes.code import Code, Severity

# Stage, in words -> its codes.
STAGES: Mapping[str, Mapping[str, Code]] = MappingProxyType({
    "Reading and conditioning a recording": records.CODES,
    "Identification": steady.CODES | fits.CODES,
    "Validation and diagnosis": checks.CODES,
    "Controller tuning": tuning.CODES,
    "Trends over a site": trends.CODES,
})
CODES: Mapping[str, Code] = MappingProxyType(
    {code: entry for table in STAGES.values() for code, entry in table.items()})

# Codes that are read back from a file, or that decide what is written beside them in one: there they are the
# interface. What a run knows itself it hands on as a value.
DOUBTING, SHIFTED, SUMMED = (frozenset(code for code, entry in CODES.items() if entry.says == what)
                             for what in ("doubt", "shift", "sum"))

__all__ = ["CODES", "DOUBTING", "SHIFTED", "STAGES", "SUMMED", "Code", "Severity"]
