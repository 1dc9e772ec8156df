"""The committed reference pages against those that the code gives today."""

import importlib.util
import re

import pytest

from drivetool.cli.command_line import COMMANDS
from drivetool.finding_codes import CODES, RENAMED
from drivetool.logs import ROLES
from drivetool.logs.roles import NAMED_ROLES
from tests.places import ROOT

FOLDER = ROOT / "docs" / "reference"


def _generator():
    """The module docs/generate_reference.py, which is in no package."""
    place = importlib.util.spec_from_file_location("generate_reference", ROOT / "docs" / "generate_reference.py")
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


GENERATOR = _generator()
PAGES = GENERATOR.pages()


@pytest.mark.parametrize("name", PAGES)
def test_page_is_up_to_date(name):
    path = FOLDER / name
    committed = path.read_text(encoding="utf-8") if path.exists() else ""
    assert committed == PAGES[name], "run: python docs/generate_reference.py docs/reference"


def test_no_page_is_left_over():
    assert {path.name for path in FOLDER.iterdir()} == set(PAGES)


def test_every_command_finding_and_role_has_its_place():
    labels = [set(re.findall(rf"^\({kind}-(.*)\)=$", PAGES[page], re.MULTILINE))
              for kind, page in (("finding", "findings.md"), ("command", "commands.md"))]
    assert labels == [{*CODES, *RENAMED}, set(COMMANDS)]
    assert {"motor_torque", "motor_speed"} <= set(ROLES) and NAMED_ROLES
    assert all(f"`{role}`" in PAGES["roles.md"] for role in ROLES)
    assert all(f"_{what}`" in PAGES["roles.md"] for what in NAMED_ROLES)


def test_links_lead_to_a_place():
    """A target is a label of any page, or a page."""
    labels = {label for text in PAGES.values() for label in re.findall(r"^\((.*)\)=$", text, re.MULTILINE)}
    links = {link for text in PAGES.values() for link in re.findall(r"\]\(([^)]*)\)", text)}
    assert len(links) > 50 and links <= {f"#{label}" for label in labels} | set(PAGES)
    assert len(labels) == sum(len(re.findall(r"^\(.*\)=$", text, re.MULTILINE)) for text in PAGES.values())


@pytest.mark.parametrize(("text", "markdown"), [
    ("Use --set x, or 'keep from=2'.", "Use `--set` x, or `keep from=2`."),
    ("the step's 2 * 3 of reference_*", r"the step's 2 \* 3 of `reference_*`"),
    ("see `a_b <c>` and <d>", r"see `a_b <c>` and \<d\>")])
def test_a_text_is_rendered_as_it_was_written(text, markdown):
    assert GENERATOR.prose(text) == markdown
