"""A load that set in or ended during the record, at one instant or several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, present
from drivetool.drive.effects import RECORDS, STEPS, TIMES, TORQUES

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

ENOUGH = 15.0  # log likelihood that a further step must bring
AMONG = 5.0  # standard deviations that it must have: chance makes four and a half at the best of so many instants


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
    from drivetool.check.starts import load_steps

    if present(base, f"{base.task.drive.bodies[-1]}.step_torque"):
        return []
    return [with_steps(base, instants) for instants in load_steps(base)]


def _at_an_end(model: Model, _: Model) -> str:
    """Whether it sets in so near to an end of every stretch that nothing tells it from a sample gone wrong."""
    from drivetool.check.starts import EARLY

    times = [v for n, v in zip(model.task.free, model.point.values, strict=True) if n.endswith(TIMES)]
    inside = all(any(t.origin + EARLY <= time <= t.origin + t.size * t.step - EARLY for t in model.problem.traces)
                 for time in times)
    return "" if inside else "it would set in where the record begins or ends"


def _without_trifles(model: Model, base: Model, masks: Masks, _: Callable) -> Model:
    """The model without the steps that are not to be told from zero, as long as one is left; numbered in order.

    Beside the largest each must stand out from what chance makes at the best of many instants.
    """
    from drivetool.check.fit import TOLD, values_of, without_them

    sizes = {p.name: abs(p.value / p.std) for p in values_of(model, base) if p.std and p.name.endswith(TORQUES)}
    largest = max(sizes, key=lambda n: sizes[n], default=None)
    small = [n.removesuffix("_torque") for n, size in sizes.items() if size < (TOLD if n == largest else AMONG)]
    if small and len(small) < len(sizes):
        names = [n for n in model.task.drive.values if n.rpartition("_")[0] in small]
        model = without_them(model, names, base.task.drive, masks)
    return _in_order(model)


def _with_another(model: Model, masks: Masks, most_promising: Callable) -> Model | None:
    """The model with a load that sets in at one instant more, None where no instant asks for that.

    Beside a base that takes them all for noise of the torque only the largest is seen: under the noise that is left
    once it is known the others are.
    """
    from drivetool.check.fit import BROKEN, fit
    from drivetool.check.starts import load_steps

    if sum(n.endswith(TORQUES) for n in model.task.free) == len(STEPS):
        return None
    try:
        starts = [with_steps(model, instants) for instants in load_steps(model) if len(instants) == 1]
        best = most_promising(model, CAUSES[0], starts, masks)
        more = None if best is None or best.promise < ENOUGH else fit(best.ready(masks), masks)
    except BROKEN:  # what was found before that stands
        return None
    return None if more is None or more.value > model.value - ENOUGH else _in_order(more)


def _in_order(model: Model) -> Model:
    """The model with its steps numbered as they come."""
    from drivetool.check.fit import carried
    from drivetool.identify.setup import problem_of

    task = model.fitted
    times = {n: v for n, v in task.drive.values.items() if n.endswith(TIMES) and n in task.free}
    olds = [n.removesuffix("_time") for n in sorted(times, key=lambda n: times[n])]
    news = {old: f"{old.partition('.')[0]}.{step}" for old, step in zip(olds, STEPS, strict=False)}
    if all(old == new for old, new in news.items()):
        return model

    def renamed(name: str) -> str:
        step, _, what = name.rpartition("_")
        return f"{news[step]}_{what}" if step in news else name

    drive = replace(task.drive, values={renamed(n): v for n, v in task.drive.values.items()})
    free = {renamed(n) for n in task.free}
    task = replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in free))
    problem = problem_of(drive, task.free, task.roles, model.problem.traces)
    return replace(model, task=task, problem=problem, point=carried(model, task, problem))


CAUSES = (Cause(
    "load-step", "a load that set in or ended during the record",
    "At one instant of the record, or at several, a load torque set in or ended.",
    "Ask what happened at that time, or leave that part out.", "load-step", starts=_starts,
    sizes=tuple(name[1:] for pair in zip(TORQUES, TIMES, strict=True) for name in pair), implausible=_at_an_end,
    place=".step_time", located=TIMES, searched=TIMES, event=True, refined=_without_trifles, another=_with_another,
    alike={"quadratic-drag": "Repeat the record at several speeds."}),)
