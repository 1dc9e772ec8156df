"""A load that set in or ended during the record, at one instant or several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause, Start
from drivetool.check.causes.starts import added, present
from drivetool.drive.effects.load_step import RECORDS, STEPS, TIMES, TORQUES

if TYPE_CHECKING:
    from drivetool.check.model import Masks, Model


def with_steps(base: Model, instants: Sequence[tuple[float, int]]) -> Start:
    """The base with loads that set in at these instants, in that record alone if its number is not zero."""
    body, values = base.task.drive.bodies[-1], {}
    unused = [step for step in STEPS if not present(base, f"{body}.{step}_torque")]
    for step, (time, record) in zip(unused, instants, strict=False):
        values |= {f"{body}.{step}_torque": 0.0, f"{body}.{step}_time": time}
        values |= {f"{body}.{step}_record": float(record)} if record else {}
    return added(base, values, [n for n in values if n.endswith(TORQUES)],
                 [n for n in values if n.endswith(RECORDS)])


def _starts(base: Model) -> list[Start]:
    from drivetool.check.instants import load_steps

    if present(base, f"{base.task.drive.bodies[-1]}.step_torque"):
        return []
    return [with_steps(base, instants) for instants in load_steps(base)]


def _at_an_end(model: Model, _: Model) -> str:
    """Whether it sets in so near to an end of every stretch that nothing tells it from a sample gone wrong."""
    from drivetool.check.instants import EARLY

    times = [v for n, v in zip(model.task.free, model.point.values, strict=True) if n.endswith(TIMES)]
    inside = all(any(t.origin + EARLY <= time <= t.origin + t.size * t.step - EARLY for t in model.problem.traces)
                 for time in times)
    return "" if inside else "it would set in where the record begins or ends"


def _with_further_steps(model: Model, base: Model, masks: Masks) -> Model:
    from drivetool.check.further_steps import with_further_steps

    return with_further_steps(model, base, masks)


CAUSES = (Cause(
    "load-step", "a load that set in or ended during the record",
    "At one instant of the record, or at several, a load torque set in or ended.",
    "Ask what happened at that time, or leave that part out.", "load-step", starts=_starts,
    sizes=tuple(name[1:] for pair in zip(TORQUES, TIMES, strict=True) for name in pair), implausible=_at_an_end,
    place=".step_time", located=TIMES, searched=TIMES, event=True, refined=_with_further_steps,
    alike={"quadratic-drag": "Repeat the record at several speeds."}),)
