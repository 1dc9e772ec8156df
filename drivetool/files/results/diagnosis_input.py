"""What a diagnosis can start from, and what its outcome is as a finding."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.check.outcome import Diagnosis
from drivetool.drive import Drive
from drivetool.errors import BadOption, BadParameters, Finding
from drivetool.files.yaml import Loaded
from drivetool.finding_codes import SHIFTED
from drivetool.logs import Experiment

FITTED = ("fitted", "at-bound", "not-identifiable")


def check_base(loaded: Loaded, drive: Drive) -> None:
    """Refuse a drive that was never fitted: every candidate would look like a discovery.

    loaded  the parameter files; drive: with their values
    raises  BadParameters: a value is missing, or no parameter was ever fitted
    """
    drive.require(drive.missing(), "a diagnosis")
    sections = loaded.sections(drive)
    if not any(entry.status in FITTED for entry in sections.values()):
        names = ", ".join(name for name, _ in loaded.inputs)
        raise BadParameters(
            "a base that was fitted", f"only values that were held in {names or 'no file'}",
            "Run greybox on these recordings first, and give its file after --params: whatever a wrong value "
            "leaves over would be taken for a cause.")


def check_holdout(training: Sequence[Experiment], holdout: Sequence[Experiment]) -> None:
    """Refuse to judge by what was fitted to.

    raises  BadOption: a held-out recording is one of the others, whatever its name
    """
    names = {content: e.name for e in training for content in e.contents}
    for each in holdout:
        known = next((names[content] for content in each.contents if content in names), None)
        if known is not None:
            same = "itself" if each.name == known else f"the same recording as {known}"
            raise BadOption(
                "a recording after --holdout that is not one of the others", f"{each.name}, {same}",
                "Give another recording, or leave --holdout out: parts of the record then judge each other.")


def base_findings(loaded: Loaded, training: Sequence[Experiment],
                  holdout: Sequence[Experiment], criterion: str = "simulation") -> tuple[Finding, ...]:
    """Whether the base was fitted to these recordings, not to those that judge, and to what is judged by."""
    seen = {entry.sha256 for source in loaded.sources for entry in source.file.data}
    found = []
    other = [e.name for e in training if e.sha256 not in seen]
    if other:
        known = "to other recordings" if seen else "to recordings it does not name"
        found.append(Finding(
            "warning", "base-fitted-to-other-data",
            f"The base was fitted {known}, not to {', '.join(other)}: a difference between the recordings, "
            "say in temperature or load, may be taken for a cause.", {"recordings": len(other)},
            "Fit the base to these recordings, with greybox."))
    judged = [e.name for e in holdout if e.sha256 in seen]
    if judged:
        found.append(Finding(
            "warning", "held-out-record-was-fitted",
            f"The base was fitted to {', '.join(judged)}, which should only judge: the gain stated is too small.",
            {"recordings": len(judged)}, "Give a recording that no fit has seen."))
    by_torque = [s.file.options.get("criterion") == "inverse" for s in loaded.sources if s.file.data]
    if any(by_torque) and criterion != "inverse":
        found.append(Finding(
            "warning", "base-fitted-to-the-torque",
            "The base was fitted to the torque that the motion asks for, and is diagnosed by the motion that the "
            "torque makes: where the motion was imposed, causes of that are none.", {},
            "Diagnose with --criterion inverse, or fit the base by a simulation first."))
    said = [f for source in loaded.sources for f in source.file.findings if f.code in SHIFTED]
    return (*found, *(Finding(
        "warning", "base-with-shifted-torque",
        f"{f.text} The base says so; a diagnosis takes it for a cause, often for a third mass.",
        {"shift": float(f.evidence["shift"])}, f"First: {f.action}") for f in said))


def verdict_finding(diagnosis: Diagnosis) -> Finding:
    """The verdict for scripts; a warning where there is something to be decided yet."""
    open_end = diagnosis.verdict in ("undetermined", "unexplained")
    evidence = {f"log10_evidence.{code}": float(value) for code, value in diagnosis.evidence.items()}
    return Finding("warning" if open_end else "note", f"diagnosis-{diagnosis.verdict}", diagnosis.sentence,
                   evidence, diagnosis.experiment)
