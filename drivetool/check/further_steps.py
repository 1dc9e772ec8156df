"""Further load steps, that show only once those before them are known, and those that then turn out to be none."""

from __future__ import annotations

from dataclasses import replace

from drivetool.check.causes.load_step import with_steps
from drivetool.check.hypothesis import TOLD, TRIFLE, begin, values_of
from drivetool.check.instants import load_steps
from drivetool.check.model import BROKEN, Masks, Model, fit
from drivetool.check.needless import without_them
from drivetool.check.structure import carried
from drivetool.drive.effects.load_step import STEPS, TIMES, TORQUES
from drivetool.identify.setup import problem_of

ENOUGH = 15.0  # log likelihood that a further step must bring
AMONG = 5.0  # standard deviations that it must have: chance makes four and a half at the best of so many instants
PLAIN = 30.0  # log likelihood that those before it must have brought


def with_further_steps(model: Model, base: Model, masks: Masks) -> Model:
    """A load that sets in, and every further instant at which one does.

    Beside a base that takes them all for noise of the torque, or bends its parameters to make up for them, only the
    largest is seen, and that at about its instant: under the noise that is left once it is known the others are.
    """
    if model.value > base.value - PLAIN:
        return model
    best = model
    try:
        for _ in STEPS:
            best = without_trifles(best, base, masks)
            more = _with_another(best, masks)
            if more is None or more.value > best.value - ENOUGH:
                break
            best = more
    except BROKEN:  # what was found before that stands
        pass
    return model if best is model else in_order(best)


def in_order(model: Model) -> Model:
    """The model with its steps numbered as they come."""
    task = model.fitted
    times = {n: v for n, v in task.drive.values.items() if n.endswith(TIMES) and n in task.free}
    olds = [n.removesuffix("_time") for n in sorted(times, key=lambda n: times[n])]
    news = {old: f"{old.partition('.')[0]}.{step}" for old, step in zip(olds, STEPS, strict=False)}

    def renamed(name: str) -> str:
        step, _, what = name.rpartition("_")
        return f"{news[step]}_{what}" if step in news else name

    drive = replace(task.drive, values={renamed(n): v for n, v in task.drive.values.items()})
    free = {renamed(n) for n in task.free}
    task = replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in free))
    problem = problem_of(drive, task.free, task.roles, model.problem.traces)
    return replace(model, task=task, problem=problem, point=carried(model, task, problem))


def _with_another(model: Model, masks: Masks) -> Model | None:
    """The model with a load that sets in at one instant more, None where no instant asks for that."""
    starts = [begin(model, with_steps(model, instants), masks) for instants in load_steps(model)
              if len(instants) == 1] if _unused(model) else []
    best = max(starts, key=lambda b: b.promise, default=None)
    if best is None or best.promise < TRIFLE:
        return None
    return fit(model.code, best.start.task, best.problem, best.point, model.noise, masks)


def _unused(model: Model) -> bool:
    return sum(n.endswith(TORQUES) for n in model.task.free) < len(STEPS)


def without_trifles(model: Model, base: Model, masks: Masks) -> Model:
    """The model without the steps that are not to be told from zero, as long as one is left.

    Beside the largest each must stand out from what chance makes at the best of many instants.
    """
    sizes = {p.name: abs(p.value / p.std) for p in values_of(model, base) if p.std and p.name.endswith(TORQUES)}
    largest = max(sizes, key=lambda n: sizes[n], default=None)
    small = [n for n, size in sizes.items() if size < (TOLD if n == largest else AMONG)]
    if not small or len(small) == len(sizes):
        return model
    owner = [n.removesuffix("_torque") for n in small]
    names = [n for n in model.task.drive.values if n.rpartition("_")[0] in owner]
    return without_them(model, names, base.task.drive, masks)
