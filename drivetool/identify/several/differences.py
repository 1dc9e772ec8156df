"""Which parameters differ between records, with p-values adjusted for the number of pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy

from drivetool.finding import Finding
from drivetool.identify.outcome import mean_of, p_value_of_equality
from drivetool.identify.several.sections import DifferenceSection

MIN_RECORDS_PER_MACHINE = 2  # records of a machine: one alone shows no scatter from day to day
# Probability that equal machines differ in any figure of a structure by chance: the usual choice.
DIFFERENCE_SIGNIFICANCE = 0.05


def differences(structure: str, figures: Mapping[str, Mapping[str, tuple[float, float | None, str]]],
                ) -> tuple[DifferenceSection, ...]:
    """All pairs of records, figure by figure.

    figures  record -> name -> (value, std or None, unit); without a std it is not compared
    source   Holm 1979, A simple sequentially rejective multiple test procedure
    """
    found = []
    for a, b in combinations(figures, 2):
        for name, (value, std, unit) in figures[a].items():
            other = figures[b].get(name)
            if other is None or not std or not other[1]:
                continue
            change, both = float(other[0] - value), float(np.hypot(std, other[1]))
            found.append((name, unit, a, b, change, both, 2.0 * scipy.stats.norm.sf(abs(change) / both)))
    return _with_adjusted_p(structure, found)


def between_machines(structure: str, figures: Mapping[str, Mapping[str, tuple[float, float | None, str]]],
                     machines: Mapping[str, Sequence[str]]) -> tuple[DifferenceSection, ...]:
    """All pairs of machines, figure by figure, by how each varies from recording to recording.

    figures   record -> name -> (value, std or None, unit)
    machines  name -> its records; a figure that fewer than two of them identify is not compared
    source    Welch 1947; Holm 1979
    """
    found = []
    for a, b in combinations(machines, 2):
        for name in dict.fromkeys(n for r in machines[a] for n in figures.get(r, {})):
            estimates = [[x for r in machines[m] if (x := figures.get(r, {}).get(name)) is not None and x[1]
                          and np.isfinite(x[:2]).all()] for m in (a, b)]
            if min(map(len, estimates)) < MIN_RECORDS_PER_MACHINE:
                continue
            one, other = (mean_of(*np.array([(x[0], x[1]**2) for x in each]).T) for each in estimates)
            found.append((name, estimates[0][0][2], a, b, other.value - one.value,
                          float(np.sqrt(one.variance + other.variance)), p_value_of_equality(one, other)))
    return _with_adjusted_p(structure, found)


def _with_adjusted_p(structure: str, rows: Sequence[tuple[str, str, str, str, float, float, float]],
                     ) -> tuple[DifferenceSection, ...]:
    """The differences of a structure by (name, unit, first, second, change, std, p) each, p adjusted for all."""
    p = holm(np.array([row[-1] for row in rows]))
    return tuple(DifferenceSection(structure, *row[:-1], float(q), bool(q < DIFFERENCE_SIGNIFICANCE))
                 for row, q in zip(rows, p, strict=True))


def holm(p: np.ndarray) -> np.ndarray:
    """(n,) p-values adjusted so that none of n true hypotheses falls below a level more often than that level."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    found = np.empty(len(p))
    found[order] = np.minimum(steps, 1.0)
    return found


def difference_findings(found: Sequence[DifferenceSection], machines: bool = False) -> list[Finding]:
    """The differences of a structure in one sentence; one record each does not distinguish machines from days."""
    significant = [d for d in found if d.differs]
    if not significant:
        return []
    beyond, action = (
        ("The scatter within each machine is smaller.",
         "Look for wear, lubrication or another load where friction or inertia differs.") if machines else
        ("The noise within the records does not explain it. With one record per machine, a difference between "
         "machines cannot be separated from one between days.",
         "Record each machine several times, at different times, and compare with --machine."))
    return [Finding("warning", "parameters-differ",
                    f"{significant[0].structure}: {_most_significant_listed(significant)}. {beyond}",
                    {f"{d.name} {d.first} {d.second}": d.p for d in significant}, action)]


def _most_significant_listed(differ: Sequence[DifferenceSection]) -> str:
    """The three most significant ones."""
    text = "; ".join(f"{d.name} differs by {d.change:+.3g} {d.unit} from {d.first} to {d.second} "
                     f"(+- {d.std:.2g}, p {d.p:.2g})" for d in sorted(differ, key=lambda d: float(d.p))[:3])
    return text + (f", and {len(differ) - 3} more" if len(differ) > 3 else "")
