"""The tiers of tests are budgets: every page that names a time names the same."""

import re

import pytest

from tests.places import ROOT

MINUTES = {"test": "five", "test-slow": "thirty"}
WHOLE = "46"  # of .ci/run


def minutes_stated(name, tier):
    """Minutes that a file says of a tier: in a line with its command, or in the comment over its rule."""
    text = (ROOT / name).read_text(encoding="utf-8")
    line = rf"\bmake {tier}(?![-\w]).*?(at most )?(\w+) minutes" if name != "Makefile" else (
        rf"^#.*?(at most )?(\w+) minutes.*\n{tier}:")
    return {(bool(most), number.lower()) for most, number in re.findall(line, text, re.MULTILINE | re.IGNORECASE)}


@pytest.mark.parametrize("name", ["README.md", "Makefile", "CONTRIBUTING.md"])
@pytest.mark.parametrize("tier", MINUTES)
def test_every_page_says_the_same(name, tier):
    assert minutes_stated(name, tier) == {(True, MINUTES[tier])}


@pytest.mark.parametrize("name", [".ci/run", "CONTRIBUTING.md"])
def test_so_does_what_runs_all(name):
    assert re.findall(r"at most (\d+) minutes", (ROOT / name).read_text(), re.IGNORECASE) == [WHOLE]
