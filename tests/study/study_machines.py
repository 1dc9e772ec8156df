"""Two machines of ten recordings each, that differ by 3 % in one of four parameters or are equal: is this found?

    python -m tests.study.study_machines [pairs] [shift] [recordings]

Every parameter varies by 1.5 % from recording to recording. One machine is held against five others: one that is
equal, and one per parameter that differs. Per kind of pair: in how many anything was said
to differ, in how many the right parameter, in how many a wrong one. Multiplicity is corrected over the parameters.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.several import CompareOptions
from drivetool.identify.several.comparison import compared_figures, fitted_structure
from drivetool.identify.several.differences import between_machines
from drivetool.logs import Experiment
from tests.identify.days import NAMES, days_of, machine_of, start_of

STRUCTURE = "physical-innovations"
PAIRS, RECORDINGS, SCATTER, CHANGE = 100, 10, 0.015, 0.03
FIRST_SEED = 730_000


def figures_of(days: Sequence[Experiment], start: Drive) -> dict[str, Mapping[str, tuple]]:
    """Recording -> what is found of it."""
    options = CompareOptions((STRUCTURE,))
    return {e.name: compared_figures(fitted_structure(STRUCTURE, e.name, e, start, options, days)) for e in days}


def differing(seed: int, count: int) -> list[set[str]]:
    """What is said to differ: between equal machines, and where one of each parameter differs."""
    first = machine_of(seed)
    start = start_of(first)
    base, found = figures_of(days_of(first, count, SCATTER, seed, "a"), start), []
    for k in range(len(NAMES) + 1):
        other = first * np.where(np.arange(len(NAMES)) == k - 1, 1.0 + CHANGE, 1.0)
        more = figures_of(days_of(other, count, SCATTER, seed + (k + 1) * 100_000, "b"), start)
        pairs = between_machines(STRUCTURE, base | more, {"A": list(base), "B": list(more)})
        found.append({d.name for d in pairs if d.differs})
    return found


def main(pairs: int = PAIRS, shift: int = 0, count: int = RECORDINGS) -> None:
    """Print the table."""
    found = [differing(FIRST_SEED + shift + i, count) for i in range(pairs)]
    for k, kind in enumerate(("equal", *NAMES)):
        right = {kind} & set(NAMES)
        said = [each[k] for each in found]
        print(f"{kind:20s} any {sum(map(bool, said))}, right {sum(bool(f & right) for f in said)}, "
              f"wrong {sum(bool(f - right) for f in said)} of {pairs}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
