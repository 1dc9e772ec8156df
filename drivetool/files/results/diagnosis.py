"""From a diagnosis to the parameter file that it writes."""

from __future__ import annotations

from collections.abc import Mapping

from drivetool.check.outcome import (
    CandidateResult,
    CandidateSection,
    Diagnosis,
    DiagnosisSection,
    Gain,
    GainSection,
    RoundSection,
    State,
)
from drivetool.drive import Drive
from drivetool.files.results.result_file import Inputs, estimate_file, parameter_section
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import written

# Whether a cause that ended in this state is detectable in the record; None: unknown.
_DETECTABLE: Mapping[State, bool | None] = {"not-shown": False, "failed": None, "in-the-model": None}


def diagnosis_file(diagnosis: Diagnosis, inputs: Inputs = (),
                   unidentified: Mapping[str, str] | None = None) -> shapes.ParameterFile:
    """The parameter file of the extended drive, with the diagnosis.

    inputs        (name, sha256) of the parameter files that were read
    unidentified  as of `estimate_file`
    """
    return estimate_file(diagnosis.estimate, inputs, unidentified=unidentified).replace(
        step="diagnose", outcome=diagnosis.sentence, diagnosis=diagnosis_section(diagnosis))


def diagnosis_section(diagnosis: Diagnosis) -> DiagnosisSection:
    """Verdict, causes, gain, and every candidate of every round."""
    rounds = diagnosis.rounds
    return written(diagnosis.replace(
        gain=_gain_section(diagnosis.gain),
        candidates=[_candidate_section(each, one.round) for one in rounds for each in one.candidates],
        rounds=[written(one.replace(gain=_gain_section(one.gain)), RoundSection) for one in rounds],
    ), DiagnosisSection)


def sections_before(sections: Mapping[str, shapes.ParameterSection],
                    drive: Drive) -> dict[str, shapes.ParameterSection]:
    """The parameters of the files, in the units of the drive, for a table of before and after."""
    found = {}
    for name, entry in sections.items():
        value = drive.values.get(name)
        factor = value / entry.value if value and entry.value else 1.0
        std = None if entry.std is None else entry.std * factor
        found[name] = entry.replace(value=value, std=std, unit=drive.unit(name))
    return found


def _candidate_section(found: CandidateResult, number: int) -> CandidateSection:
    """One candidate of one round; its parameters in the units they were fitted in."""
    return written(found.replace(
        round=number, shown=_DETECTABLE.get(found.state, True),
        parameters={n: parameter_section(p) for n, p in found.parameters.items()}), CandidateSection)


def _gain_section(gain: Gain | None) -> GainSection | None:
    """With the interval on a further record."""
    return gain and written(gain.replace(rmse_gain_ci95=gain.further_record_interval), GainSection)
