"""A whole search: from the base to what is handed to the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.faults import Fault
from drivetool.check.fit import Remainder, remainder
from drivetool.check.heldout import change_between, exact, extended
from drivetool.check.search.beside import Asked, asked_beside
from drivetool.check.search.pairs import doubtful, together
from drivetool.check.search.result import Found, Searched
from drivetool.check.search.search import Expansion, Search
from drivetool.errors import Finding
from drivetool.logs import Experiment

NOTHING = Remainder(0.0, 0.0, 0.0)  # what a base leaves whose free runs end in rounding: there is no path from it


def look(search: Search, faults: Sequence[Fault], notes: Sequence[Finding],
         train: Sequence[Experiment]) -> Searched:
    """Search, ask each cause again beside the others, and begin with a rough cause where that ends in doubt.

    faults  of the records; train: records that are fitted to
    """
    path, unasked = search.path()
    result = _ended(search, path, unasked, (faults, notes, train))
    if path and doubtful(result):
        other = together(search, path)
        result = result if other is None else _ended(search, *other, (faults, notes, train))
    return replace(result, change=change_between(result.whole, result.folds))


def _ended(search: Search, path: Sequence[Expansion], unasked: str,
           given: tuple[Sequence[Fault], Sequence[Finding], Sequence[Experiment]]) -> Searched:
    """What a path amounts to."""
    faults, notes, train = given
    origin = search.base(search.root.model)
    asked = asked_beside(search, path) if path else Asked(search.root, Found(), ())
    # Where no law was found the base is held against its own records under the noise that is likeliest for it.
    model = asked.node.model if asked.found.causes or not path else origin.model
    whole = extended(model, search.split)
    left = remainder(whole, search.split.held) if path or not exact(whole) else NOTHING
    return Searched(search.split, search.options, tuple(faults), tuple(notes), tuple(train), origin,
                    origin, model, whole, asked.node.trained, asked.found,
                    asked.rounds, left, unasked)
