"""Verdicts as JUnit and Markdown: read by public parsers, and whole whatever the text."""

import re
import xml.etree.ElementTree as ElementTree

import pytest

from drivetool.site.verdicts import Case, junit, markdown
from drivetool.site.verdicts.cases import MAX_LINES_LISTED

MISSED = "wanted shaft.half_gap at most 5 mrad; found 6.1 mrad. Open the gearbox."
CASES = [
    Case("press 1", "press 1/01.mcap", "shaft.half_gap <= 5 mrad", True, ""),
    Case("press 2", "press 2/01.mcap", "shaft.half_gap <= 5 mrad", False, MISSED,
         ('gap-law: "a" & <b>',)),
    Case("press 1", "", "GREYBOX runs", True, "", ("one-level: one speed",)),
    Case("press 2", "press 2/02.mcap", "steady runs", False, "first line\nsecond line")]
HOSTILE = ("bell \x07 escape \x1b[31m nul \x00 delete \x7f line\u2028 turned \u202e lone \udc80 end \ufffe "
           "]]> <x> & \"'\r\n\ttab \U0001f600")


def test_a_suite_per_machine_and_a_case_per_limit_and_recording():
    root = ElementTree.fromstring(junit(CASES).encode())
    assert root.tag == "testsuites"
    assert root.attrib == {"name": "drivetool", "tests": "4", "failures": "2", "errors": "0"}
    assert [(s.get("name"), s.get("tests"), s.get("failures")) for s in root] == [
        ("press 1", "2", "0"), ("press 2", "2", "2")]
    cases = {(c.get("classname"), c.get("name")): c for c in root.iter("testcase")}
    assert set(cases) == {("press 1/01.mcap", "shaft.half_gap <= 5 mrad"), ("press 1", "GREYBOX runs"),
                          ("press 2/01.mcap", "shaft.half_gap <= 5 mrad"), ("press 2/02.mcap", "steady runs")}
    case = cases["press 2/01.mcap", "shaft.half_gap <= 5 mrad"]
    assert case.find("failure").text == case.find("failure").get("message") == MISSED
    assert case.find("system-out").text == CASES[1].warnings[0]
    several = cases["press 2/02.mcap", "steady runs"].find("failure")
    assert several.text == "first line\nsecond line" and several.get("message") == "first line"
    assert not list(cases["press 1/01.mcap", "shaft.half_gap <= 5 mrad"])


def test_there_are_no_times_and_the_same_cases_give_the_same_bytes():
    text = junit(CASES)
    assert text == junit(list(CASES)) and not re.search("time|hostname|[0-9]{4}-[0-9]{2}", text)


@pytest.mark.parametrize("passed", [True, False])
def test_any_text_is_xml(passed):
    case = Case(HOSTILE, HOSTILE, HOSTILE, passed, "" if passed else HOSTILE, (HOSTILE,))
    text = junit([case])
    suite, = ElementTree.fromstring(text.encode("utf-8"))
    assert all(part in suite.get("name") for part in ("\\u001b[31m", "\\u202e", "\\udc80", "\U0001f600"))
    assert suite.find("testcase").get("name") == suite.get("name") == suite.find("testcase/system-out").text
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\ufffe]", text)
    assert not re.search("[\x00-\x09\x1b\x7f]", markdown([case]))


def test_nothing_to_judge_is_a_file_too():
    assert len(ElementTree.fromstring(junit([]).encode())) == 0
    assert markdown([]).startswith("# drivetool: 0 checks passed\n")


def test_a_public_parser_reads_it(tmp_path):
    junitparser = pytest.importorskip("junitparser")
    path = tmp_path / "drivetool.xml"
    hostile = Case("press 3", HOSTILE, HOSTILE, False, HOSTILE, (HOSTILE,))
    path.write_text(junit([*CASES, hostile]), encoding="utf-8")
    suites = junitparser.JUnitXml.fromfile(str(path))
    assert (suites.tests, suites.failures, suites.errors) == (5, 3, 0)
    cases = [case for suite in suites for case in suite]
    missed = [case for case in cases if not case.is_passed]
    assert len(cases) == 5 and missed[0].result[0].text == MISSED
    assert missed[0].system_out == CASES[1].warnings[0]


def test_markdown_has_the_machines_the_misses_and_the_warnings():
    text = markdown(CASES)
    assert text.startswith("# drivetool: 2 of 4 checks failed\n")
    assert "| press 1 | 2 | 0 | 1 |" in text and "| press 2 | 2 | 2 | 1 |" in text
    assert "- **press 2/01.mcap**, shaft.half\\_gap \\<= 5 mrad: wanted shaft.half\\_gap at most 5 mrad" in text
    assert "first line second line" in text and "<details><summary>Warnings</summary>" in text
    assert "## Failed" not in markdown(CASES[:1]) and "# drivetool: 1 checks passed" in markdown(CASES[:1])


def test_a_pipe_in_a_name_is_no_column():
    row, = (line for line in markdown([Case("a|b\nc", "", "x", True, "")]).splitlines() if line.startswith("| a"))
    assert row == "| a\\|b c | 1 | 0 | 0 |"


def test_a_summary_for_many_stays_short():
    text = markdown([Case("m", f"{i}.mcap", "bar", False, "x") for i in range(MAX_LINES_LISTED + 5)])
    assert text.count("- **") == MAX_LINES_LISTED and "- and 5 more" in text
