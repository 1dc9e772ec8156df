"""A whole search: from the base to the result that the verdict is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.faults import Fault
from drivetool.check.fit import ResidualTests, run_residual_tests
from drivetool.check.heldout import change_between, exact_to_rounding, over_all_records
from drivetool.check.search.exchange_pass import ReassessedCauses, run_exchange_pass
from drivetool.check.search.masked_causes import find_masked_causes, is_inconclusive
from drivetool.check.search.result import SearchResult, SelectedCauses
from drivetool.check.search.search import Expansion, ForwardSelection
from drivetool.finding import Finding
from drivetool.logs import Experiment

# Of a base whose free runs are exact to rounding: there is no path from it.
NO_RESIDUAL = ResidualTests(0.0, 0.0, 0.0)


def search_causes(search: ForwardSelection, faults: Sequence[Fault], notes: Sequence[Finding],
         train: Sequence[Experiment]) -> SearchResult:
    """Forward selection, exchange pass, and a second search from a multimodal cause where the first ends in doubt.

    faults  of the records; train: records that are fitted to
    """
    path, unrequested = search.path()
    result = _search_result(search, path, unrequested, (faults, notes, train))
    if path and is_inconclusive(result):
        other = find_masked_causes(search, path)
        result = result if other is None else _search_result(search, *other, (faults, notes, train))
    return replace(result, change=change_between(result.whole, result.folds))


def _search_result(search: ForwardSelection, path: Sequence[Expansion], unrequested: str,
           given: tuple[Sequence[Fault], Sequence[Finding], Sequence[Experiment]]) -> SearchResult:
    """The result of a path."""
    faults, notes, train = given
    origin = search.base(search.root.model)
    reassessed = run_exchange_pass(search, path) if path else ReassessedCauses(search.root, SelectedCauses(), ())
    # Without a law found the base is tested on its own records under its likeliest noise.
    model = reassessed.node.model if reassessed.found.causes or not path else origin.model
    whole = over_all_records(model, search.split)
    left = run_residual_tests(whole, search.split.held) if path or not exact_to_rounding(whole) else NO_RESIDUAL
    return SearchResult(search.split, search.options, tuple(faults), tuple(notes), tuple(train), origin,
                    origin, model, whole, reassessed.node.trained, reassessed.found,
                    reassessed.rounds, left, unrequested)
