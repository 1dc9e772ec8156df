"""The registry of finding codes against the code that raises them and the tests that name them."""

import ast
import csv
import re
from pathlib import Path

import pytest

from drivetool.check.causes import CAUSES
from drivetool.finding import Finding
from drivetool.finding_codes import CODES, DOUBTING, RENAMED, SHIFTED, STAGES, SUMMED
from tests.places import ROOT

SEVERITIES = ("note", "warning", "failure")
# Modules that are handed a code by a caller, and the codes that they are handed.
HANDED_ON = {"check/faults/record_faults.py": {"wrong-sign", "wrong-scale"},
             "check/faults/shaft.py": {"wrong-sign", "wrong-scale"},
             "identify/blackbox/blackbox_findings.py": {"shaft-not-identifiable", "no-conversion"}}
# Where code reads the code or the text of a finding, and why. State is handed on as a value; findings may be
# sorted.
OF_A_FILE, SORTED = "the code in the file is the interface", "sorts findings, computes nothing"
CODE_READERS = {
    ("check/full_diagnosis.py", "confirmed_outliers"): "selects faults, by the code of their cause",
    ("files/results/diagnosis_input.py", "base_findings"): OF_A_FILE,
    ("files/results/result_file.py", "estimate_file"): OF_A_FILE,
    ("site/trends/trends_result.py", "count_sentence"): "counts findings",
    ("identify/coast_down/stretches.py",
     "_refuse_counter_wrap"): "a recording has no other place for what is wrong with it",
    ("identify/laws/missing_structure.py", "missing_structure"): "reads a Lack, a finding from here on",
    ("identify/inverse/estimator.py", "_parameter_lines"): SORTED,
    ("identify/estimate/verdict.py", "_with_verdict"): SORTED,
    ("identify/blackbox/shaft_torque_fit.py", "with_shaft_torque"): SORTED,
    ("logs/door/build.py", "_experiment_on_grid"): SORTED,
    ("logs/clocks/resample.py", "_require_overlap"): "quotes the finding in an error"}
OWN = set(CODES) - set(CAUSES)  # a cause of a diagnosis has a code too


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
    assert set(CODES) == {code for _, _, codes in CALLS for code in codes}
    for code, entry in CODES.items():
        raised = set().union(*(s for _, s, codes in CALLS if code in codes))
        # All verdicts of a diagnosis are raised by one call; each has one of its severities.
        verdict = code.startswith("diagnosis-")
        assert set(entry.severities) < raised if verdict else set(entry.severities) == raised, code


def test_every_registered_code_occurs_in_a_test():
    here = Path(__file__).resolve()
    tests = "".join(p.read_text(encoding="utf-8") for p in sorted((ROOT / "tests").rglob("*.py")) if p != here)
    tested = set(re.findall('"(?:note |warning |failure )?([a-z-]+)"', tests))
    assert not set(CODES) - tested


def test_renamed_codes_lead_to_present_ones_and_stand_in_the_table_of_names():
    """docs/renamed.csv has them with all other names, for those who look for an old one."""
    assert len(RENAMED) > 80 and set(RENAMED.values()) <= set(CODES) and not set(RENAMED) & set(CODES)
    with open(ROOT / "docs" / "renamed.csv", encoding="utf-8", newline="") as file:
        rows = {row["old"]: row["new"] for row in csv.DictReader(file) if row["kind"] == "finding code"}
    assert rows == RENAMED


def test_a_code_stands_in_one_table():
    assert len(CODES) == sum(map(len, STAGES.values()))


def test_entries_are_a_code_in_lower_case_and_plain_sentences():
    """Of at most 30 words; the mildest severity first."""
    assert {s for entry in CODES.values() for s in entry.severities} == set(SEVERITIES)
    for code, entry in CODES.items():
        assert re.fullmatch("[a-z]+(-[a-z]+)*", code), code
        assert entry.severities == tuple(s for s in SEVERITIES if s in entry.severities) != (), code
        for text in (entry.meaning, entry.action):
            assert text[0].isupper() and text.endswith("."), code
            assert max(len(sentence.split()) for sentence in re.split(r"[.:;] ", text)) <= 30, code


def test_an_unregistered_code_is_refused():
    with pytest.raises(ValueError, match="'no-such-code' is no registered finding code"):
        Finding("note", "no-such-code", "Never said.")


def _are_findings(tree: ast.AST) -> set[str]:
    """Names that stand for a finding: of a loop over findings, of an argument, or by what they are called."""
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension)]
    names = {node.target.id for node in loops
             if isinstance(node.target, ast.Name) and "finding" in ast.unparse(node.iter).lower()}
    arguments = [node for node in ast.walk(tree) if isinstance(node, ast.arg) and node.annotation]
    return {"finding"} | names | {a.arg for a in arguments if ast.unparse(a.annotation) == "Finding"}


def _reads_findings(tree: ast.AST) -> bool:
    """Whether anything depends on the code or the text of a finding."""
    names = _are_findings(tree)

    def of_finding(node: ast.AST, field: str) -> bool:
        return isinstance(node, ast.Attribute) and node.attr == field and (
            isinstance(node.value, ast.Name) and node.value.id in names)

    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and of_finding(node.value, "text"):
            return True  # text.startswith, text.partition, ...
        sides = [node.left, *node.comparators] if isinstance(node, ast.Compare) else [
            node.elt] if isinstance(node, ast.SetComp) else []
        literals = {n.value for side in sides for n in ast.walk(side) if isinstance(n, ast.Constant)}
        codes = [side for side in sides if isinstance(side, ast.Attribute) and side.attr == "code"]
        if (codes and literals & OWN) or any(of_finding(s, field) for s in sides for field in ("code", "text")):
            return True
    return False


def test_nothing_depends_on_the_code_or_the_text_of_a_finding():
    package, found = ROOT / "drivetool", set()
    for path in sorted(package.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and _reads_findings(node):
                found.add((path.relative_to(package).as_posix(), node.name))
    assert found == set(CODE_READERS)


@pytest.mark.parametrize("line", [
    "any(f.code == 'not-converged' for f in estimate.findings)",
    "{f.code for f in estimate.findings} & LACKING",
    "[f for f in found.findings if f.text.startswith(name)]",
    "[f for f in more if f.code != 'model-error']",
    "[f for f in findings if name in f.text]"])
def test_such_a_question_is_seen(line):
    assert _reads_findings(ast.parse(line))


def test_what_a_file_says_by_codes_stands_in_their_table():
    assert {"innovations-correlated", "model-error", "diagnosis-unexplained"} == DOUBTING
    assert {"torque-shifted"} == SHIFTED and {"idle-torque-not-separable"} == SUMMED


def test_the_parameter_of_a_finding_makes_no_second_one():
    one = Finding("warning", "not-identifiable", "It is not identifiable.", {}, "Do.", "motor.inertia")
    assert one == Finding("warning", "not-identifiable", "It is not identifiable.", {}, "Do.")
