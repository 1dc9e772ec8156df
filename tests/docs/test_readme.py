"""The README stays short and lists what there is."""

import re

from drivetool.cli.command_line import COMMANDS
from tests.places import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_begins_with_the_two_commands_and_is_short():
    lines = TEXT.splitlines()
    assert [line.split("#")[0].strip() for line in lines[:2]] == ["make demo", "make test"]
    assert len(lines) <= 150


def test_its_table_lists_every_command():
    table = TEXT.partition("## Commands")[2].partition("\n## ")[0]
    assert sorted(re.findall(r"^\| `(\w+)`", table, re.MULTILINE)) == sorted(COMMANDS)
