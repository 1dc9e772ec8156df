"""Checks of the base that a diagnosis starts from, and its verdict as a finding."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.check.outcome import Diagnosis
from drivetool.drive import Drive
from drivetool.errors import BadOption, BadParameters
from drivetool.files.yaml import Loaded
from drivetool.finding import Finding
from drivetool.finding_codes import SHIFTED
from drivetool.logs import Experiment

FITTED_STATUSES = ("fitted", "at-bound", "not-identifiable")


def check_base(loaded: Loaded, drive: Drive) -> None:
    """Refuse a drive that was never fitted: its model error would be taken for causes.

    loaded  the parameter files; drive: with their values
    raises  BadParameters: a value is missing, or no parameter was ever fitted
    """
    drive.require(drive.missing(), "a diagnosis")
    sections = loaded.sections(drive)
    if not any(entry.status in FITTED_STATUSES for entry in sections.values()):
        names = ", ".join(name for name, _ in loaded.inputs)
        raise BadParameters(
            "a base that was fitted", f"only held values in {names or 'no file'}",
            "Run greybox on these recordings first, and give its file after --params: otherwise the "
            "diagnosis reports the error of a wrong value as a cause.")


def check_holdout(training: Sequence[Experiment], holdout: Sequence[Experiment]) -> None:
    """Refuse held-out data that are training data.

    raises  BadOption: a held-out recording is one of the others, whatever its name
    """
    names = {content: e.name for e in training for content in e.contents}
    for each in holdout:
        known = next((names[content] for content in each.contents if content in names), None)
        if known is not None:
            same = "which is also a training recording" if each.name == known else f"the same recording as {known}"
            raise BadOption(
                "a recording after --holdout that is not one of the others", f"{each.name}, {same}",
                "Give another recording, or leave --holdout out: the recordings are then cross-validated in parts.")


def base_findings(loaded: Loaded, training: Sequence[Experiment],
                  holdout: Sequence[Experiment], criterion: str = "simulation") -> tuple[Finding, ...]:
    """Whether the base was fitted to the training data, not to the held-out data, and by the same criterion."""
    fitted_to = {entry.sha256 for source in loaded.sources for entry in source.file.data}
    found = []
    unseen = [e.name for e in training if e.sha256 not in fitted_to]
    if unseen:
        known = "to other recordings" if fitted_to else "to recordings that its file does not list"
        found.append(Finding(
            "warning", "biased-base",
            f"The base was fitted {known}, not to {', '.join(unseen)}: a difference, for example in "
            "temperature or load, may be reported as a cause.", {"recordings": len(unseen)},
            "Fit the base to these recordings, with greybox."))
    fitted_holdout = [e.name for e in holdout if e.sha256 in fitted_to]
    if fitted_holdout:
        found.append(Finding(
            "warning", "not-held-out",
            f"The base was fitted to {', '.join(fitted_holdout)}, which is held-out data here: "
            "the stated gain is too small.",
            {"recordings": len(fitted_holdout)}, "Give a recording that no fit has used."))
    by_torque = [s.file.options.get("criterion") == "inverse" for s in loaded.sources if s.file.data]
    if any(by_torque) and criterion != "inverse":
        found.append(Finding(
            "warning", "biased-base",
            "The base was fitted by inverse dynamics, but the diagnosis simulates the motion. Where the motion was "
            "imposed, the error of the simulated motion is not caused by the drive.", {},
            "Diagnose with --criterion inverse, or fit the base by a simulation first."))
    shift_findings = [f for source in loaded.sources for f in source.file.findings if f.code in SHIFTED]
    return (*found, *(Finding(
        "warning", "biased-base",
        f"{f.text} The file of the base has this finding; a diagnosis would report the shift as a cause, often as "
        "a third mass.",
        {"shift": float(f.evidence["shift"])}, f"First: {f.action}") for f in shift_findings))


def verdict_finding(diagnosis: Diagnosis) -> Finding:
    """The verdict for scripts; a warning where it is undetermined or unexplained."""
    open_end = diagnosis.verdict in ("undetermined", "unexplained")
    evidence = {f"log10_evidence.{code}": float(value) for code, value in diagnosis.evidence.items()}
    return Finding("warning" if open_end else "note", f"diagnosis-{diagnosis.verdict}", diagnosis.sentence,
                   evidence, diagnosis.experiment)
