"""The registry of finding codes against the code that raises them and the tests that ask for them."""

import ast
import re
from pathlib import Path

import pytest

from drivetool.errors import Finding
from drivetool.finding_codes import CODES, STAGES
from tests.places import ROOT

SEVERITIES = ("note", "warning", "failure")
# Modules that are handed a code by a caller, and the codes that they are handed.
HANDED_ON = {"check/faults/preflight.py": {"wrong-sign", "wrong-scale"},
             "check/faults/shaft.py": {"wrong-sign", "wrong-scale"},
             "identify/blackbox_findings.py": {"shaft-not-excited", "impossible-conversion"}}
# A diagnosis rewrites the severity of a finding of its last fit.
REWRITTEN = {"innovations-correlated": {"note"}}


def _texts(node: ast.expr) -> set[str]:
    """The literals that an expression may give; an f-string as a pattern."""
    if isinstance(node, ast.Constant):
        return {node.value}
    if isinstance(node, ast.IfExp):
        return _texts(node.body) | _texts(node.orelse)
    if isinstance(node, ast.JoinedStr):
        return {"".join(re.escape(part.value) if isinstance(part, ast.Constant) else "[a-z-]+"
                        for part in node.values)}
    return set()


def _calls() -> list[tuple[str, set[str], set[str]]]:
    """(module and line, severities, codes) of each Finding that the package makes."""
    found = []
    package = ROOT / "drivetool"
    for path in sorted(package.rglob("*.py")):
        module = path.relative_to(package).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Finding":
                severity, code = node.args[:2]
                patterns = _texts(code)
                codes = {c for c in CODES for p in patterns if re.fullmatch(p, c)} if isinstance(
                    code, ast.JoinedStr) else patterns or HANDED_ON.get(module, set())
                found.append((f"{module}:{node.lineno}", _texts(severity), codes))
    return found


CALLS = _calls()


def test_every_finding_has_registered_codes_and_plain_severities():
    """A new code is entered into drivetool/finding_codes; one that is handed on is listed in HANDED_ON."""
    assert len(CALLS) > 100
    wrong = [where for where, severities, codes in CALLS
             if not codes or not codes <= set(CODES) or not severities or not severities <= set(SEVERITIES)]
    assert not wrong


def test_every_registered_code_is_raised_with_the_severities_that_it_states():
    """What no call raises is taken out of drivetool/finding_codes."""
    for code, entry in CODES.items():
        raised = REWRITTEN.get(code, set()).union(*(s for _, s, codes in CALLS if code in codes))
        # All verdicts of a diagnosis are raised by one call; each has one of its severities.
        verdict = code.startswith("diagnosis-")
        assert set(entry.severities) < raised if verdict else set(entry.severities) == raised, code


def test_every_registered_code_is_asked_for_in_a_test():
    here = Path(__file__).resolve()
    tests = "".join(p.read_text(encoding="utf-8") for p in sorted((ROOT / "tests").rglob("*.py")) if p != here)
    asked = set(re.findall('"(?:note |warning |failure )?([a-z-]+)"', tests))
    assert not set(CODES) - asked


def test_a_code_stands_in_one_table():
    assert len(CODES) == sum(map(len, STAGES.values()))


def test_entries_are_a_code_in_lower_case_and_plain_sentences():
    """Of at most 30 words; the mildest severity first."""
    for code, entry in CODES.items():
        assert re.fullmatch("[a-z]+(-[a-z]+)*", code), code
        assert entry.severities == tuple(s for s in SEVERITIES if s in entry.severities) != (), code
        for text in (entry.meaning, entry.action):
            assert text[0].isupper() and text.endswith("."), code
            assert max(len(sentence.split()) for sentence in re.split(r"[.:;] ", text)) <= 30, code


def test_an_unregistered_code_is_refused():
    with pytest.raises(ValueError, match="'no-such-code' is no registered finding code"):
        Finding("note", "no-such-code", "Never said.")
