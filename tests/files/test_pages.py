"""Pages are made from templates alone, and whatever stands in them is escaped."""

import re
from pathlib import Path

from drivetool.site.verdicts import Case, index_page

ROOT = Path(__file__).parent.parent.parent / "drivetool"
TEMPLATES = sorted((ROOT / "files/pages/templates").glob("*.html"))


def test_html_and_styles_are_written_in_the_templates_alone_and_the_styles_once():
    assert [p for p in ROOT.rglob("*.py") if re.search(r"</?(td|p|li|h1|html|style)[ >]", p.read_text())] == []
    assert [p.name for p in TEMPLATES if "<style>" in p.read_text()] == ["page.html"]


def test_only_pictures_are_not_escaped():
    used = [(p.name, found) for p in TEMPLATES
            for found in re.findall(r"(\S+) *\| *safe|autoescape", p.read_text())]
    assert used == [("diagnosis.html", "picture")]


def test_what_names_contain_is_text():
    case = Case("<script>&\"'", "", "x runs", False, "<b>no</b> +- 1")
    page = index_page([], [case])
    assert "<b>" not in page and "&lt;b&gt;no&lt;/b&gt; +- 1" in page and "1 of 1 checks failed" in page


def test_a_page_is_for_light_dark_and_paper():
    page = index_page([], [])
    assert "color-scheme: light dark" in page and "prefers-color-scheme: dark" in page and "@media print" in page
