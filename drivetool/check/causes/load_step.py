"""A load that set in or ended during the record, at one instant or several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, start_with
from drivetool.drive.effects import STEP_NAMES, STEP_RECORDS, STEP_TIMES, STEP_TORQUES
from drivetool.quantity import name_of, owner_of, quantity_of

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

# Log likelihood that a further step must gain. A choice: above the best of thousands of instants by chance.
MIN_FURTHER_STEP_GAIN = 15.0
# Standard deviations of a further step: the best of that many instants reaches four and a half by chance.
FURTHER_STEP_STDS = 5.0


def with_steps(base: Model, instants: Sequence[tuple[float, int]]) -> Start:
    """The base with loads that set in at these instants, in that record alone if its number is not zero."""
    body, values = base.task.drive.bodies[-1], {}
    unused = [step for step in STEP_NAMES if not is_present(base, name_of(body, f"{step}_torque"))]
    for step, (time, record) in zip(unused, instants, strict=False):
        values |= {name_of(body, f"{step}_torque"): 0.0, name_of(body, f"{step}_time"): time}
        values |= {name_of(body, f"{step}_record"): float(record)} if record else {}
    return start_with(base, values, [n for n in values if quantity_of(n) in STEP_TORQUES],
                 [n for n in values if quantity_of(n) in STEP_RECORDS])


def _starts(base: Model) -> list[Start]:
    from drivetool.check.starts import load_steps

    if is_present(base, name_of(base.task.drive.bodies[-1], "step_torque")):
        return []
    return [with_steps(base, instants) for instants in load_steps(base)]


def _near_record_end(model: Model, _: Model) -> str:
    """Whether it sets in so near to an end of every segment that it cannot be separated from a wrong sample."""
    from drivetool.check.starts import MIN_STEP_DISTANCE

    times = [v for n, v in zip(model.task.free, model.point.values, strict=True) if quantity_of(n) in STEP_TIMES]
    inside = all(any(t.origin + MIN_STEP_DISTANCE <= time <= t.origin + t.size * t.step - MIN_STEP_DISTANCE
                     for t in model.problem.traces)
                 for time in times)
    return "" if inside else "it would set in where the record begins or ends"


def _without_insignificant_steps(model: Model, base: Model, masks: Masks, _: Callable) -> Model:
    """The model without insignificant steps, as long as one is left; numbered in order.

    All but the largest must exceed the chance level of the best of many instants.
    """
    from drivetool.check.fit import SIZE_SIGNIFICANCE, added_parameters, refit_without

    sizes = {p.name: abs(p.value / p.std) for p in added_parameters(model, base) if p.std
             and quantity_of(p.name) in STEP_TORQUES}
    largest = max(sizes, key=lambda n: sizes[n], default=None)
    small = [n.removesuffix("_torque") for n, size in sizes.items()
             if size < (SIZE_SIGNIFICANCE if n == largest else FURTHER_STEP_STDS)]
    if small and len(small) < len(sizes):
        names = [n for n in model.task.drive.values if n.rpartition("_")[0] in small]
        model = refit_without(model, names, base.task.drive, masks)
    return _in_order(model)


def _with_further_step(model: Model, masks: Masks, best_start: Callable) -> Model | None:
    """The model with one more load step, None where no instant gains enough.

    A base that takes all steps for torque noise shows only the largest one; under the smaller noise of the model
    with it the others become significant.
    """
    from drivetool.check.fit import FIT_ERRORS, fit
    from drivetool.check.starts import load_steps

    if sum(quantity_of(n) in STEP_TORQUES for n in model.task.free) == len(STEP_NAMES):
        return None
    try:
        starts = [with_steps(model, instants) for instants in load_steps(model) if len(instants) == 1]
        best = best_start(model, CAUSES[0], starts, masks)
        more = None if best is None or best.expected_gain < MIN_FURTHER_STEP_GAIN else fit(best.ready(masks), masks)
    except FIT_ERRORS:  # the result without a further step stays
        return None
    return None if more is None or more.value > model.value - MIN_FURTHER_STEP_GAIN else _in_order(more)


def _in_order(model: Model) -> Model:
    """The model with its steps numbered in order of time."""
    from drivetool.check.fit import on_task

    task = model.fitted
    times = {n: v for n, v in task.drive.values.items() if quantity_of(n) in STEP_TIMES and n in task.free}
    olds = [n.removesuffix("_time") for n in sorted(times, key=lambda n: times[n])]
    news = {old: name_of(owner_of(old), step) for old, step in zip(olds, STEP_NAMES, strict=False)}
    if all(old == new for old, new in news.items()):
        return model

    def renamed(name: str) -> str:
        step, _, what = name.rpartition("_")
        return f"{news[step]}_{what}" if step in news else name

    drive = replace(task.drive, values={renamed(n): v for n, v in task.drive.values.items()})
    return on_task(model, replace(task, drive=drive).with_free({renamed(n) for n in task.free}))


CAUSES = (Cause(
    "load-step", "a load that set in or ended during the record",
    "A load torque set in or ended at one or several instants of the record.",
    "Find out what happened at that time, or leave that part out.", "load-step", starts=_starts,
    sizes=tuple(name for pair in zip(STEP_TORQUES, STEP_TIMES, strict=True) for name in pair),
    implausible=_near_record_end, place="step_time", located=STEP_TIMES, searched=STEP_TIMES, event=True,
    refined=_without_insignificant_steps, another=_with_further_step,
    alike={"quadratic-drag": "Repeat the record at several speeds."}),)
