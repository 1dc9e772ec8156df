"""All inputs, in the order in which they run."""

from __future__ import annotations

from tests.golden import (
    inputs_diagnose,
    inputs_docs,
    inputs_fixtures,
    inputs_generated,
    inputs_measured,
    inputs_options,
    inputs_site,
    inputs_tune,
)
from tests.golden.case import Case


def all_cases(base: str) -> list[Case]:
    """Every case; the examples are those of the documents of BASE."""
    found = [*inputs_options.cases(base), *inputs_fixtures.cases(), *inputs_docs.cases(base), *inputs_site.cases(),
             *inputs_tune.cases(), *inputs_measured.cases(), *inputs_generated.cases(), *inputs_diagnose.cases()]
    names = [each.name for each in found]
    if len(set(names)) < len(names):
        raise ValueError(f"two cases of one name: {sorted({name for name in names if names.count(name) > 1})}")
    return found
