"""From a diagnosis to the parameter file that it writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict

import msgspec

from drivetool.check.outcome import CandidateResult, Diagnosis, Gain, State
from drivetool.drive import Drive
from drivetool.files.results.result_file import Inputs, estimate_file, parameter_section
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import plain
from drivetool.identify.estimate import Parameter

# Whether the record can show a cause that ended in this state.
_SHOWN: Mapping[State, bool | None] = {"not-shown": False, "failed": None, "in-the-model": None}


def diagnosis_file(diagnosis: Diagnosis, inputs: Inputs = ()) -> shapes.ParameterFile:
    """The parameter file of the extended drive, with what was found.

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
        evidence={code: _number(value) for code, value in diagnosis.evidence.items()},
        gain=_gain(diagnosis.gain),
        candidates=[_candidate(each, n, drive) for n, one in rounds for each in one.candidates],
        rounds=[shapes.RoundSection(round=n, cause=one.cause, gain=_gain(one.gain)) for n, one in rounds],
        rule=diagnosis.rule, facts={n: _number(v) if isinstance(v, float) else v
                                    for n, v in diagnosis.facts.plain().items()})


def sections_before(sections: Mapping[str, shapes.ParameterSection],
                    drive: Drive) -> dict[str, shapes.ParameterSection]:
    """What the files said, in the units of the drive, for a table of before and after."""
    found = {}
    for name, entry in sections.items():
        value = drive.values.get(name)
        factor = value / entry.value if value and entry.value else 1.0
        std = None if entry.std is None else entry.std * factor
        found[name] = msgspec.structs.replace(entry, value=value, std=std, unit=drive.unit(name))
    return found


def _candidate(found: CandidateResult, number: int, drive: Drive) -> shapes.CandidateSection:
    """One candidate of one round; its parameters in the units they were fitted in."""
    units = {p.name: p.unit for p in found.parameters}
    return shapes.CandidateSection(
        code=found.code, round=number, law=found.law, state=found.state,
        shown=_SHOWN.get(found.state, True), gain=_number(found.gain), gain_std=_number(found.gain_std),
        evidence=_number(found.evidence), reason=found.reason,
        smallest={name: shapes.SizeSection(value=_number(value), unit=units.get(name, _unit(drive, name)))
                  for name, value in found.smallest.items()},
        parameters=_parameters(found.parameters))


def _parameters(parameters: Iterable[Parameter]) -> dict[str, shapes.ParameterSection]:
    """By name, in the order in which they were fitted."""
    return {p.name: parameter_section(p) for p in parameters}


def _gain(gain: Gain | None) -> shapes.GainSection | None:
    """Figures that are not finite become null."""
    if gain is None:
        return None
    interval = gain.on_a_fresh_record
    return shapes.GainSection(
        **{key: value if isinstance(value, str) else _number(value)
           for key, value in asdict(gain).items() if key not in ("blocks", "rmse_bar")},
        rmse_gain_ci95=None if interval is None else tuple(map(_number, interval)))


def _unit(drive: Drive, name: str) -> str | None:
    """Of a parameter that the drive has; a channel's offset, for example, is none."""
    return drive.unit(name) if name in drive.quantities else None


def _number(value: float | None) -> float | None:
    """A finite float with the digits that files have, or None."""
    found = plain(value)
    return None if found is None else float(found)
