"""Files of a coast-down as models of recordings without a torque, and what such a file lacks for other steps."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.drive.chain import Drive
from drivetool.errors import BadParameters, BadRecording, Finding
from drivetool.files.parameter_file import Loaded
from drivetool.identify.coast_down.stretches import switched_off
from drivetool.logs.experiment import Experiment

RATIO = "_over_inertia"
ASSUMED = "switched-off-assumed"


def refuse_ratios(loaded: Loaded, drive: Drive, why: str) -> None:
    """Refuse ratios alone in the place of an inertia and frictions.

    loaded  the parameter files; drive: with their values; why: what they are for
    raises  BadParameters: a file has ratios of a coast-down, and the drive no inertia
    """
    names = [s.name for s in loaded.sources if any(n.endswith(RATIO) for n in s.file.derived or ())]
    if names and drive.missing():
        raise BadParameters(
            f"values of {', '.join(drive.missing())} for {why}",
            f"only ratios of friction to inertia in {', '.join(names)}",
            "Run steady again with an inertia held: a drive without torque runs down alike with any one, "
            "such as --set motor.inertia=1 --hold motor.inertia.")


def refuse_run_downs(experiments: Sequence[Experiment]) -> None:
    """Refuse recordings of which a diagnosis has no torque.

    raises  BadRecording: no torque was logged in one, or zeros alone in all
    """
    silent = [e.name for e in experiments if "motor_torque" not in e.signals]
    zero = [e.name for e in experiments if e.name not in silent and not e.signals["motor_torque"].any()]
    if silent or len(zero) == len(experiments):
        raise BadRecording(
            "a torque that drives, for a diagnosis", f"none in {', '.join(silent)}" if silent else
            f"zeros alone in {', '.join(zero)}",
            "Name its channel in the channel map; where the drive runs down without torque, take steady --method "
            "coast-down, which names the law that its friction lacks.")


def with_run_downs(experiments: Sequence[Experiment], loaded: Loaded) -> tuple[list[Experiment], list[Finding]]:
    """The recordings, those without a torque as run-downs where every file is of a coast-down; what to know of it.

    raises  NotEnoughData: one does not run down
    """
    if not loaded.sources or not all(_of_coast_down(s.file.options, [f.code for f in s.file.findings])
                                     for s in loaded.sources):
        return list(experiments), []
    decay = max(float(s.file.options.get("flux_decay") or 0.0) for s in loaded.sources)  # type: ignore[arg-type]
    found = [switched_off(e, decay) if "motor_torque" not in e.signals else e for e in experiments]
    names = [e.name for e in experiments if "motor_torque" not in e.signals]
    if not names:
        return found, []
    return found, [Finding(
        "note", "switched-off-assumed", f"No torque was logged in {', '.join(names)}: the drive is taken to run "
        "down without one from where its speed has left the highest value.", {"recordings": len(names)},
        "Leave out what belongs to the switching with --condition 'keep from=..'.")]


def _of_coast_down(options: object, codes: Sequence[str]) -> bool:
    """Whether a file was fitted to run-downs."""
    return ASSUMED in codes or (isinstance(options, dict) and options.get("method") == "coast-down")
