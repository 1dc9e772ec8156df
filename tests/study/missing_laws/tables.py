"""The printed tables of a study: a line per group of records, a column per estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tests.study.missing_laws.estimators import REGRESSION
from tests.study.missing_laws.laws import LAWS, MOST, SIZES
from tests.study.missing_laws.record import RIGHT
from tests.study.missing_laws.scores import Score, coverage, quantile, ratio, score

Records = Mapping[str, Mapping[str, Score]]  # record -> estimator -> score
# Neither a straight line nor a torque that the motion tells represents these; figures are also pooled without.
HARDEST = ("saturation", "lugre")
# An estimator keeps up where its median is within this factor of the better of two plain ones, plus a share of
# the inertia or of the friction that is of no matter.
PLAIN, FACTOR, NO_MATTER = (REGRESSION, "simulation"), 2.0, {"inertia": 0.001, "friction": 0.005}
LEAST = 5  # records, below which there is no ratio of quantiles to speak of
ERRORS = {"inertia": "inertia", "friction": "friction curve over its mean", "idle": "idle torque over rated torque"}


def summary(rows: Sequence[Mapping], reference: str = "") -> str:
    """All tables.

    reference  estimator that the others are divided by; the first one if it is not among the rows
    """
    names = list(dict.fromkeys(row["estimator"] for row in rows))
    if not names:
        return "no rows"
    scored: dict[str, dict[str, Score]] = {}
    kinds: dict[str, tuple[str, str]] = {}
    for row in rows:
        record = row["key"].rsplit("/", 1)[0]
        scored.setdefault(record, {})[row["estimator"]] = score(row)
        kinds[record] = row["law"], row["size"]
    complete = {record: each for record, each in scored.items() if set(each) == set(names)}
    groups = grouped(complete, kinds)
    single = {f"{law} {size}".strip(): [r for r in complete if kinds[r] == (law, size)]
              for law in (*LAWS, *RIGHT) for size in (*SIZES, "")}
    single = {name: members for name, members in single.items() if members}
    parts = [f"{len(complete)} records with all of {', '.join(names)}; percent where nothing else is said"]
    parts += [figures(complete, groups, names, field, f"error of the {words}") for field, words in ERRORS.items()]
    parts += [figures(complete, groups, names, field, f"half-width of the 95 % interval, {words}")
              for field, words in (("inertia_half", "inertia"), ("friction_half", "friction over its mean"))]
    parts += [covered(complete, groups, names)]
    reference = reference if reference in names else names[0]
    parts += [ratios(complete, groups, names, reference, kinds)] if len(names) > 1 else []
    parts += [figures(complete, single, names, field, f"by law, error of the {ERRORS[field]}")
              for field in ("inertia", "friction")]
    parts += [covered(complete, single, names), kept_up(complete, kinds, names), achieved(rows)]
    parts += [answers(rows, names)]
    return "\n\n".join(part for part in parts if part.count("\n") != 1)  # a title and a head without a line


def grouped(complete: Records, kinds: Mapping[str, tuple[str, str]]) -> dict[str, list[str]]:
    """Group -> records: the situations in which the model is right, then the laws pooled by size."""
    found = {right: [r for r in complete if kinds[r][0] == right] for right in RIGHT}
    for size in SIZES:
        found[size] = [r for r in complete if kinds[r][1] == size]
        found[f"{size} without {', '.join(HARDEST)}"] = [r for r in found[size] if kinds[r][0] not in HARDEST]
    return {name: members for name, members in found.items() if members}


def column(complete: Records, members: Sequence[str], name: str, field: str) -> np.ndarray:
    """(n,) a field of the scores of an estimator over records; those that are not stated are left out."""
    values = np.array([getattr(complete[record][name], field) for record in members])
    return values[~np.isnan(values)]


def lines(head: str, columns: Sequence[str], body: Mapping[str, tuple[Sequence[str], int]]) -> str:
    """A table: name -> (cells, number of records)."""
    width = max(map(len, [head, *body]))
    cell = [max([len(c), *(len(cells[i]) for cells, _ in body.values())]) for i, c in enumerate(columns)]

    def row(first: str, cells: Sequence[str], last: str) -> str:
        inner = [text.rjust(wide) for text, wide in zip(cells, cell, strict=True)]
        return "  ".join([first.ljust(width), *inner, last.rjust(5)])

    return "\n".join([row(head, columns, "n"), *(row(name, cells, str(n)) for name, (cells, n) in body.items())])


def figures(complete: Records, groups: Mapping[str, Sequence[str]], names: Sequence[str], field: str,
            title: str) -> str:
    """Median / worst decile of a field in percent."""
    def cell(members: Sequence[str], name: str) -> str:
        values = 100.0 * column(complete, members, name, field)
        return f"{quantile(values, 0.5):.2f} / {quantile(values, 0.9):.2f}"

    return f"{title}: median / worst decile\n" + lines("", names, {
        group: ([cell(members, name) for name in names], len(members)) for group, members in groups.items()})


def covered(complete: Records, groups: Mapping[str, Sequence[str]], names: Sequence[str]) -> str:
    """Shares of intervals that hold, with Clopper and Pearson's 99 % intervals."""
    def cells(members: Sequence[str], name: str) -> list[str]:
        found = coverage(complete[record][name] for record in members)
        parts = [found.inertia, found.friction, found.far]
        return [f"{100 * value:.0f} ({100 * low:.0f}-{100 * high:.0f})" for value, low, high in parts] + [
            str(found.without)]

    columns = ["holds inertia", "holds friction", "over 3 half-widths", "none stated"]
    return "95 % intervals, with 99 % intervals of the shares\n" + lines("", columns, {
        f"{group} {name}": (cells(members, name), len(members))
        for group, members in groups.items() for name in names})


def ratios(complete: Records, groups: Mapping[str, Sequence[str]], names: Sequence[str], reference: str,
           kinds: Mapping[str, tuple[str, str]]) -> str:
    """Medians and worst deciles over those of the reference, with paired 99 % bootstrap intervals."""
    others = [name for name in names if name != reference]

    def cell(members: Sequence[str], name: str, field: str, q: float) -> str:
        mine, theirs = (np.array([getattr(complete[r][n], field) for r in members]) for n in (name, reference))
        value, low, high = ratio(mine, theirs, q, [kinds[r][0] for r in members])
        return f"{value:.2f} ({low:.2f}-{high:.2f})"

    columns = [f"{field} {word}" for field in ("inertia", "friction") for word in ("median", "decile")]
    return f"error over that of {reference}\n" + lines("", columns, {
        f"{group} {name}": ([cell(members, name, field, q) for field in ("inertia", "friction")
                             for q in (0.5, 0.9)], len(members))
        for group, members in groups.items() if len(members) >= LEAST for name in others})


def kept_up(complete: Records, kinds: Mapping[str, tuple[str, str]], names: Sequence[str]) -> str:
    """Per size: how many laws an estimator's median error keeps up with, and which it does not; see FACTOR."""
    plain = [name for name in PLAIN if name in names]
    body = {}
    for size in SIZES if plain else ():
        groups = {law: [r for r in complete if kinds[r] == (law, size)] for law in LAWS}
        groups = {law: members for law, members in groups.items() if members}
        for name in (name for name in names if groups and name not in plain):
            bad = {field: [law for law, members in groups.items()
                           if quantile(column(complete, members, name, field), 0.5) > FACTOR * min(
                               quantile(column(complete, members, other, field), 0.5) for other in plain) + least]
                   for field, least in NO_MATTER.items()}
            body[f"{size} {name}"] = ([f"{len(groups) - len(laws)}" for laws in bad.values()]
                                      + [" ".join(laws) or "-" for laws in bad.values()], len(groups))
    words = " and ".join(plain)
    return f"laws whose median error is within {FACTOR:g} x the better of {words}\n" + lines(
        "", ["inertia", "friction", "not of the inertia", "not of friction"], body)


def achieved(rows: Sequence[Mapping]) -> str:
    """Median of the share of rated torque, of laws whose strength is bounded."""
    body = {}
    for law in MOST:
        found = {size: {row["seed"]: row["truth"]["share"] for row in rows
                        if (row["law"], row["size"]) == (law, size)} for size in SIZES}
        if any(found.values()):
            body[law] = ([f"{100 * quantile(np.array(list(each.values())), 0.5):.1f}" for each in found.values()],
                         sum(map(len, found.values())))
    return "share of rated torque that a law has, median, %\n" + lines("", list(SIZES), body)


def answers(rows: Sequence[Mapping], names: Sequence[str]) -> str:
    """Processor time, failures and intervals that are missing."""
    body = {}
    for name in names:
        mine = [row for row in rows if row["estimator"] == name]
        seconds = np.array([row["seconds"] for row in mine])
        body[name] = ([f"{quantile(seconds, 0.5):.2f}", f"{quantile(seconds, 0.9):.2f}", f"{seconds.max():.1f}",
                       str(sum("failed" in row for row in mine))], len(mine))
    return "processor time of a fit, s\n" + lines("", ["median", "worst decile", "longest", "failed"], body)
