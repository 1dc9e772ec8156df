"""The published sensitivity study: one parameter at a time, the controller unchanged.

Tallfors 2005, sec. 3.2: stiffness and load inertia by +-20 %, the dead time doubled, the motor's
inertia at 80 % with the resonance unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivetool.drive import Drive, resonances
from drivetool.quantity import name_of
from drivetool.tune.optimisation.scenarios import loop_figures
from drivetool.tune.optimisation.sections import VariationSection
from drivetool.tune.speed_loop import Settings, Wiring, build

# By what factor a value may be off that no recording identifies, and the relative change of a figure of the loop
# that counts as dependence. Choices: a start value is seldom better; 3 % of Ms changes no margin noticeably.
UNKNOWN_FACTOR, NOTICEABLE_CHANGE = 10.0, 0.03


class Variation(VariationSection):
    """One changed drive under the unchanged controller; infinite figures where it is unstable."""

    drive: Drive


def variation_study(drive: Drive, wiring: Wiring, settings: Settings) -> tuple[Variation, ...]:
    """All variations that apply to this drive."""
    return tuple(Variation(label, *loop_figures(build(changed, wiring), settings), changed)
                 for label, changed in changed_drives(drive))


def depends_on(drive: Drive, name: str, wiring: Wiring, settings: Settings) -> bool:
    """Whether Ms or the impact drop changes noticeably where a value is ten times as large, or a tenth."""
    drives = [drive.with_values({name: float(np.clip(factor * drive.value(name), *drive.quantity(name).bounds))})
              for factor in (1.0, 1.0 / UNKNOWN_FACTOR, UNKNOWN_FACTOR)]
    nominal, *changed = (loop_figures(build(each, wiring), settings)[:2] for each in drives)
    return not np.allclose(changed, nominal, rtol=NOTICEABLE_CHANGE, atol=0.0)


def changed_drives(drive: Drive) -> Iterator[tuple[str, Drive]]:
    """(label, drive) of every variation."""
    yield "nominal", drive
    for shaft in drive.shafts:
        for percent in (-20, 20):
            yield f"{shaft}.stiffness {percent:+d} %", _scaled(drive, name_of(shaft, "stiffness"),
                                                               1.0 + percent / 100.0)
    last = drive.bodies[-1]
    for percent in (-20, 20) if len(drive.bodies) > 1 else ():
        yield f"{last}.inertia {percent:+d} %", _scaled(drive, name_of(last, "inertia"), 1.0 + percent / 100.0)
    if drive.value("converter.dead_time"):
        yield "converter.dead_time doubled", _scaled(drive, "converter.dead_time", 2.0)
    first = drive.bodies[0]
    yield f"{first}.inertia to 80 %" + (", same resonance" if drive.shafts else ""), lighter_motor(drive)


def lighter_motor(drive: Drive) -> Drive:
    """The first inertia at 80 %; all shafts times one factor that keeps the lowest resonance.

    Damping changes with stiffness, which also keeps the damping ratio.
    """
    changed = _scaled(drive, name_of(drive.bodies[0], "inertia"), 0.8)
    if not drive.shafts:
        return changed
    before, after = (min(m.frequency_hz for m in resonances(d) if m.kind == "resonance") for d in (drive, changed))
    factor = float(np.square(before / after))
    for shaft in drive.shafts:
        for suffix in ("stiffness", "damping"):
            changed = _scaled(changed, name_of(shaft, suffix), factor)
    return changed


def _scaled(drive: Drive, name: str, factor: float) -> Drive:
    return drive.with_values({name: drive.value(name) * factor})
