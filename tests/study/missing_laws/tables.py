"""The printed tables of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tests.study.missing_laws.estimators import REGRESSION
from tests.study.missing_laws.laws import LAWS, MOST, SIZES
from tests.study.missing_laws.record import RIGHT
from tests.study.missing_laws.scores import Score, coverage, score
from tests.study.shared.figures import quantile
from tests.study.shared.tables import (
    Groups,
    Scored,
    answers,
    by_kind,
    covered,
    figures,
    filled,
    joined,
    lines,
    percent,
    ratios,
    scored,
    shares,
)

# Neither a straight line nor a function of the motion represents these; figures are also pooled without.
HARDEST = ("saturation", "lugre")
# An estimator is not worse where its median is within this factor of the better of two plain ones, plus a share of
# the inertia or of the friction that is tolerated.
PLAIN, FACTOR, TOLERATED_ERROR = (REGRESSION, "simulation"), 2.0, {"inertia": 0.001, "friction": 0.005}
ERRORS = {"inertia": "inertia", "friction": "friction curve over its mean", "idle": "idle torque over rated torque"}


def summary(rows: Sequence[Mapping], reference: str = "") -> str:
    """All tables.

    reference  estimator that the others are divided by; the first one if it is not among the rows
    """
    if not rows:
        return "no rows"
    found = scored(rows, score)
    names, groups, single = found.names, grouped(found), by_kind(found, (*LAWS, *RIGHT), tuple(SIZES))
    parts = [f"{len(found.scores)} records with all of {', '.join(names)}; percent where nothing else is said"]
    parts += [figures(found, groups, field, f"error of the {words}") for field, words in ERRORS.items()]
    parts += [figures(found, groups, field, f"half-width of the 95 % interval, {words}")
              for field, words in (("inertia_half", "inertia"), ("friction_half", "friction over its mean"))]
    parts += [coverage_cells(found, groups)]
    reference = reference if reference in names else names[0]
    parts += [ratios(found, groups, reference, ("inertia", "friction"))] if len(names) > 1 else []
    parts += [figures(found, single, field, f"by law, error of the {ERRORS[field]}")
              for field in ("inertia", "friction")]
    parts += [coverage_cells(found, single), not_worse(found), shares(rows, tuple(MOST), tuple(SIZES)),
              answers(rows, names)]
    return joined(parts)


def grouped(found: Scored) -> Groups:
    """Group -> records: the situations in which the model is right, then the laws pooled by size."""
    groups = {right: found.of([right]) for right in RIGHT}
    rest = [law for law in LAWS if law not in HARDEST]
    for size in SIZES:
        groups[size] = found.of(size=size)
        groups[f"{size} without {', '.join(HARDEST)}"] = found.of(rest, size)
    return filled(groups)


def coverage_cells(found: Scored, groups: Groups) -> str:
    """Shares of intervals that hold."""
    def cells(scores: list[Score]) -> list[str]:
        these = coverage(scores)
        return [*(percent(*each) for each in (these.inertia, these.friction, these.far)), str(these.without)]

    return covered(found, groups, ["holds inertia", "holds friction", "over 3 half-widths", "none stated"], cells)


def not_worse(found: Scored) -> str:
    """Per size: how many laws an estimator's median error keeps up with, and which it does not; see FACTOR."""
    names = found.names
    plain = [name for name in PLAIN if name in names]
    body = {}
    for size in SIZES if plain else ():
        groups = filled({law: found.of([law], size) for law in LAWS})
        for name in (name for name in names if groups and name not in plain):
            bad = {field: [law for law, members in groups.items()
                           if quantile(found.column(members, name, field), 0.5) > FACTOR * min(
                               quantile(found.column(members, other, field), 0.5) for other in plain) + least]
                   for field, least in TOLERATED_ERROR.items()}
            body[f"{size} {name}"] = ([f"{len(groups) - len(laws)}" for laws in bad.values()]
                                      + [" ".join(laws) or "-" for laws in bad.values()], len(groups))
    words = " and ".join(plain)
    return f"laws whose median error is within {FACTOR:g} x the better of {words}\n" + lines(
        "", ["inertia", "friction", "not of the inertia", "not of friction"], body)
