"""The printed tables of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tests.study.missing_laws.laws import SIZES
from tests.study.missing_laws.scores import FAR
from tests.study.shared.figures import held, share
from tests.study.shared.tables import (
    Groups,
    Scored,
    answers,
    by_kind,
    covered,
    figures,
    filled,
    joined,
    percent,
    ratios,
    scored,
    shares,
)
from tests.study.two_masses.laws import LAWS
from tests.study.two_masses.record import BEHIND_GAP, GAP, RIGHT
from tests.study.two_masses.scores import ABOUT, Score, score

# Neither friction nor a torque on one of the bodies represents these.
STRUCTURE = ("shaft.gap", "load.third-mass")
ERRORS = {"motor_inertia": "motor inertia", "load_inertia": "load inertia", "stiffness": "stiffness",
          "friction": "friction curve over its mean", "half_gap": "half gap",
          "idle": "idle torque over rated torque"}
NO_IDLE = tuple(field for field in ERRORS if field != "idle")


def summary(rows: Sequence[Mapping], reference: str = "") -> str:
    """All tables.

    reference  estimator that the others are divided by; the first one if it is not among the rows
    """
    if not rows:
        return "no rows"
    found = scored(rows, score)
    names, groups = found.names, grouped(found)
    sensors, single = by_sensors(found, rows), by_kind(found, (*LAWS, *BEHIND_GAP, *RIGHT), tuple(SIZES))
    reference = reference if reference in names else names[0]
    parts = [f"{len(found.scores)} records with all of {', '.join(names)}; percent where nothing else is said"]
    parts += [figures(found, stated(found, groups, field), field, f"error of the {words}")
              for field, words in ERRORS.items()]
    parts += [figures(found, stated(found, groups, field), f"{field}_half",
                      f"half-width of the 95 % interval, {ERRORS[field]}") for field in NO_IDLE]
    parts += [holds(found, groups)]
    parts += [ratios(found, groups, reference, NO_IDLE)] if len(names) > 1 else []
    parts += [figures(found, sensors, field, f"by sensors, error of the {ERRORS[field]}")
              for field in ("motor_inertia", "stiffness", "friction")]
    parts += [holds(found, sensors)]
    parts += [figures(found, stated(found, single, field), field, f"by law, error of the {ERRORS[field]}")
              for field in NO_IDLE]
    parts += [holds(found, single), shares(rows, (*LAWS, *BEHIND_GAP), tuple(SIZES)), answers(rows, names)]
    return joined(parts)


def grouped(found: Scored) -> Groups:
    """Group -> records: right models; by size the laws on either body, what is left out, laws beside a gap."""
    groups = {right: found.of([right]) for right in RIGHT}
    on_bodies = [law for law in LAWS if law not in STRUCTURE]
    for size in SIZES:
        groups[size] = found.of(on_bodies, size)
        for body in ("motor", "load"):
            groups[f"{size} {body}"] = found.of([law for law in on_bodies if law.startswith(body)], size)
    groups |= {f"{size} {law.partition('.')[2]} left out": found.of([law], size)
               for law in STRUCTURE for size in SIZES}
    return filled(groups | {f"{size} with a gap": found.of(BEHIND_GAP, size) for size in SIZES})


def by_sensors(found: Scored, rows: Sequence[Mapping]) -> Groups:
    """Right models, and laws on either body of any size, by what is measured; without a gap."""
    sensors = {row["key"].rsplit("/", 1)[0]: row["sensors"] for row in rows}
    kinds = {"right": [right for right in RIGHT if not right.startswith(GAP)],
             "law": [law for law in LAWS if law not in STRUCTURE]}
    return filled({f"{kind} {roles}": [record for record in found.of(situations) if sensors[record] == roles]
                   for kind, situations in kinds.items() for roles in sorted(set(sensors.values()))})


def stated(found: Scored, groups: Groups, field: str) -> Groups:
    """The groups in which a field has a value: of a half gap, those with a gap in the model."""
    return {group: members for group, members in groups.items()
            if any(len(found.column(members, name, field)) for name in found.names)}


def holds(found: Scored, groups: Groups) -> str:
    """Shares of intervals that hold; with their number where it is not that of the records."""
    def of(text: str, number: int, scores: list[Score]) -> str:
        return "-" if number == 0 else text + (f" of {number}" if number < len(scores) else "")

    def cell(scores: list[Score], name: str) -> str:
        over = np.array([each.over[name] for each in scores])
        over = over[~np.isnan(over).any(axis=1)]
        return of(percent(*held(over)), len(over), scores)

    def cells(scores: list[Score]) -> list[str]:
        all_over = [np.concatenate(list(each.over.values())) for each in scores]
        some = [over for over in all_over if not np.isnan(over).all()]
        far = sum(bool(np.any(over > FAR)) for over in some)
        without = sum(bool(np.isnan(over[:-1]).any()) for over in all_over)  # the last is of a gap
        return [*(cell(scores, name) for name in ABOUT), of(percent(*share(far, len(some))), len(some), scores),
                str(without)]

    return covered(found, groups, [*ABOUT, "over 3 half-widths", "not all stated"], cells)
