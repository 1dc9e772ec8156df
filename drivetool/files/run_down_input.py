"""What a diagnosis says to run-downs without a torque."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.errors import BadRecording
from drivetool.logs.experiment import Experiment


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
