"""From a diagnosis to the parameter file that it writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from drivetool.check.outcome import CandidateResult, Diagnosis, Gain, State
from drivetool.drive import Drive
from drivetool.files.results.result_file import Inputs, estimate_file, parameter_section
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import to_plain, written
from drivetool.identify.estimate import Parameter

# Whether a cause that ended in this state is detectable in the record; None: unknown.
_DETECTABLE: Mapping[State, bool | None] = {"not-shown": False, "failed": None, "in-the-model": None}


def diagnosis_file(diagnosis: Diagnosis, inputs: Inputs = ()) -> shapes.ParameterFile:
    """The parameter file of the extended drive, with the diagnosis.

    inputs  (name, sha256) of the parameter files that were read
    """
    file = estimate_file(diagnosis.estimate, inputs)
    return msgspec.structs.replace(
        file, step="diagnose", outcome=diagnosis.sentence, diagnosis=diagnosis_section(diagnosis))


def diagnosis_section(diagnosis: Diagnosis) -> shapes.DiagnosisSection:
    """Verdict, causes, gain, and every candidate of every round."""
    drive = diagnosis.estimate.drive
    rounds = list(enumerate(diagnosis.rounds, 1))
    return shapes.DiagnosisSection(
        verdict=diagnosis.verdict, sentence=diagnosis.sentence, causes=list(diagnosis.causes),
        between=list(diagnosis.between), closest=list(diagnosis.closest), experiment=diagnosis.experiment,
        evidence={code: _rounded(value) for code, value in diagnosis.evidence.items()},
        gain=_gain_section(diagnosis.gain),
        candidates=[_candidate_section(each, n, drive) for n, one in rounds for each in one.candidates],
        rounds=[shapes.RoundSection(round=n, cause=one.cause, gain=_gain_section(one.gain)) for n, one in rounds],
        rule=diagnosis.rule, facts={n: _rounded(v) if isinstance(v, float) else v
                                    for n, v in diagnosis.facts.plain().items()})


def sections_before(sections: Mapping[str, shapes.ParameterSection],
                    drive: Drive) -> dict[str, shapes.ParameterSection]:
    """The parameters of the files, in the units of the drive, for a table of before and after."""
    found = {}
    for name, entry in sections.items():
        value = drive.values.get(name)
        factor = value / entry.value if value and entry.value else 1.0
        std = None if entry.std is None else entry.std * factor
        found[name] = msgspec.structs.replace(entry, value=value, std=std, unit=drive.unit(name))
    return found


def _candidate_section(found: CandidateResult, number: int, drive: Drive) -> shapes.CandidateSection:
    """One candidate of one round; its parameters in the units they were fitted in."""
    units = {p.name: p.unit for p in found.parameters}
    return shapes.CandidateSection(
        code=found.code, round=number, law=found.law, state=found.state,
        shown=_DETECTABLE.get(found.state, True), gain=_rounded(found.gain), gain_std=_rounded(found.gain_std),
        evidence=_rounded(found.evidence), reason=found.reason,
        smallest={name: shapes.SizeSection(value=_rounded(value),
                                           unit=units.get(name, _parameter_unit(drive, name)))
                  for name, value in found.smallest.items()},
        parameters=_parameter_sections(found.parameters))


def _parameter_sections(parameters: Iterable[Parameter]) -> dict[str, shapes.ParameterSection]:
    """By name, in the order in which they were fitted."""
    return {p.name: parameter_section(p) for p in parameters}


def _gain_section(gain: Gain | None) -> shapes.GainSection | None:
    """With the interval on a further record."""
    return gain and written(gain.replace(rmse_gain_ci95=gain.further_record_interval), shapes.GainSection)


def _parameter_unit(drive: Drive, name: str) -> str | None:
    """The unit of a drive parameter; None for others, such as a channel's offset."""
    return drive.unit(name) if name in drive.quantities else None


def _rounded(value: float | None) -> float | None:
    """A finite float with the digits that files have, or None."""
    found = to_plain(value)
    return None if found is None else float(found)
