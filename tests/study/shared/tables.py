"""The printed tables of a study: a line per group of records, a column per estimator or figure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.study.shared.figures import quantile, ratio

LEAST = 5  # records, below which there is no ratio of quantiles to speak of
Groups = Mapping[str, Sequence[str]]  # name -> records


@dataclass(frozen=True)
class Scored:
    """Scores of the records that every estimator has answered.

    scores  record -> estimator -> score, a value whose fields the tables name
    kinds   record -> (situation, size)
    """

    names: tuple[str, ...]
    scores: Mapping[str, Mapping[str, Any]]
    kinds: Mapping[str, tuple[str, str]]

    def column(self, members: Sequence[str], name: str, field: str) -> np.ndarray:
        """(n,) a field of the scores of an estimator over records; those that are not stated are left out."""
        values = np.array([getattr(self.scores[record][name], field) for record in members])
        return values[~np.isnan(values)]

    def of(self, situations: Sequence[str] | None = None, size: str | None = None) -> list[str]:
        """The records of some situations and of a size; None: of any."""
        return [record for record in self.scores if (situations is None or self.kinds[record][0] in situations)
                and (size is None or self.kinds[record][1] == size)]


def scored(rows: Sequence[Mapping], score: Callable[[Mapping], Any]) -> Scored:
    """The scores of rows."""
    names = tuple(dict.fromkeys(row["estimator"] for row in rows))
    scores: dict[str, dict[str, Any]] = {}
    kinds: dict[str, tuple[str, str]] = {}
    for row in rows:
        record = row["key"].rsplit("/", 1)[0]
        scores.setdefault(record, {})[row["estimator"]] = score(row)
        kinds[record] = row["law"], row["size"]
    return Scored(names, {record: each for record, each in scores.items() if set(each) == set(names)}, kinds)


def filled(groups: Groups) -> Groups:
    """The groups that have records."""
    return {name: members for name, members in groups.items() if members}


def by_kind(found: Scored, situations: Sequence[str], sizes: Sequence[str]) -> Groups:
    """A group per situation and size."""
    return filled({f"{situation} {size}".strip(): found.of([situation], size)
                   for situation in situations for size in (*sizes, "")})


def lines(head: str, columns: Sequence[str], body: Mapping[str, tuple[Sequence[str], int]]) -> str:
    """A table: name -> (cells, number of records)."""
    width = max(map(len, [head, *body]))
    cell = [max([len(c), *(len(cells[i]) for cells, _ in body.values())]) for i, c in enumerate(columns)]

    def row(first: str, cells: Sequence[str], last: str) -> str:
        inner = [text.rjust(wide) for text, wide in zip(cells, cell, strict=True)]
        return "  ".join([first.ljust(width), *inner, last.rjust(5)])

    return "\n".join([row(head, columns, "n"), *(row(name, cells, str(n)) for name, (cells, n) in body.items())])


def joined(parts: Sequence[str]) -> str:
    """Tables below one another, without those that have a title and a head but no line."""
    return "\n\n".join(part for part in parts if part.count("\n") != 1)


def figures(found: Scored, groups: Groups, field: str, title: str) -> str:
    """Median / worst decile of a field in percent."""
    def cell(members: Sequence[str], name: str) -> str:
        values = 100.0 * found.column(members, name, field)
        return f"{quantile(values, 0.5):.2f} / {quantile(values, 0.9):.2f}"

    return f"{title}: median / worst decile\n" + lines("", found.names, {
        group: ([cell(members, name) for name in found.names], len(members)) for group, members in groups.items()})


def covered(found: Scored, groups: Groups, columns: Sequence[str],
            cells: Callable[[list[Any]], list[str]]) -> str:
    """Shares of intervals that hold, with Clopper and Pearson's 99 % intervals; cells: of scores, by `percent`."""
    return "95 % intervals, with 99 % intervals of the shares\n" + lines("", columns, {
        f"{group} {name}": (cells([found.scores[record][name] for record in members]), len(members))
        for group, members in groups.items() for name in found.names})


def percent(value: float, low: float, high: float) -> str:
    """A share and the ends of its interval."""
    return f"{100 * value:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def ratios(found: Scored, groups: Groups, reference: str, fields: Sequence[str]) -> str:
    """Medians and worst deciles over those of the reference, with paired 99 % bootstrap intervals."""
    others = [name for name in found.names if name != reference]

    def cell(members: Sequence[str], name: str, field: str, q: float) -> str:
        both = [np.array([getattr(found.scores[r][n], field) for r in members]) for n in (name, reference)]
        stated = ~np.isnan(both).any(axis=0)
        if not stated.any():
            return "-"
        kinds = [found.kinds[r][0] for r, known in zip(members, stated, strict=True) if known]
        # A kind of which there is one record has no spread of its own: then all are drawn from together.
        strata = kinds if min(Counter(kinds).values()) > 1 else None
        value, low, high = ratio(both[0][stated], both[1][stated], q, strata)
        return f"{value:.2f} ({low:.2f}-{high:.2f})"

    columns = [f"{field.replace('_', ' ')} {word}" for field in fields for word in ("median", "decile")]
    return f"error over that of {reference}\n" + lines("", columns, {
        f"{group} {name}": ([cell(members, name, field, q) for field in fields for q in (0.5, 0.9)], len(members))
        for group, members in groups.items() if len(members) >= LEAST for name in others})


def shares(rows: Sequence[Mapping], laws: Sequence[str], sizes: Sequence[str]) -> str:
    """Median of the share of rated torque that laws have."""
    body = {}
    for law in laws:
        found = {size: {row["seed"]: row["truth"]["share"] for row in rows
                        if (row["law"], row["size"]) == (law, size)} for size in sizes}
        if any(found.values()):
            body[law] = ([f"{100 * quantile(np.array(list(each.values())), 0.5):.1f}" for each in found.values()],
                         sum(map(len, found.values())))
    return "share of rated torque that a law has, median, %\n" + lines("", list(sizes), body)


def answers(rows: Sequence[Mapping], names: Sequence[str]) -> str:
    """Processor time and failures."""
    body = {}
    for name in names:
        mine = [row for row in rows if row["estimator"] == name]
        seconds = np.array([row["seconds"] for row in mine])
        body[name] = ([f"{quantile(seconds, 0.5):.2f}", f"{quantile(seconds, 0.9):.2f}", f"{seconds.max():.1f}",
                       str(sum("failed" in row for row in mine))], len(mine))
    return "processor time of a fit, s\n" + lines("", ["median", "worst decile", "longest", "failed"], body)
