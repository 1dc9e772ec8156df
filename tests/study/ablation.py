"""What each rule of a verdict contributes: stored facts judged without it.

    python -m tests.study.ablation ROWS.jsonl ...

The rows are those of study_diagnose and study_names. Per rule: in how many records it decides, how many answers
change without it, and how the grades do. A rule without which no answer changes is not needed on these records.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from drivetool.check.outcome import Facts
from drivetool.check.verdict import RULES, apply_rules
from drivetool.check.verdict.rules import Rule
from tests.hidden.command import Answer, grade
from tests.study.shared.rows import rows
from tests.study.study_names import grade_of_law


def facts_of(row: Mapping) -> Facts:
    """The facts of a row; what an older version did not store is as nothing found."""
    stored = row["facts"]
    return Facts(**{n: tuple(stored[n]) if isinstance(stored[n], list) else stored[n]
                    for n in Facts.__struct_fields__ if stored.get(n) is not None})


def graded(row: Mapping, rules: Sequence[Rule]) -> str:
    """The grade of a row's record under a table of rules."""
    verdict = apply_rules(facts_of(row), rules)
    answer = Answer(verdict.verdict, verdict.causes, verdict.between if verdict.verdict == "undetermined" else ())
    if "to_name" in row:
        return grade(row["to_name"], answer, bool(row["removed"]))
    return grade_of_law(row["law"], answer)


def without_each(found: Sequence[Mapping]) -> list[tuple[str, int, Counter]]:
    """(rule, records in which it decides, (grade with it, grade without it) -> count where they differ)."""
    with_all_rules = [(graded(row, RULES), apply_rules(facts_of(row)).rule) for row in found]
    table = []
    for rule in RULES[:-1]:  # the last one is what is left
        remaining = [r for r in RULES if r is not rule]
        changed = Counter((before, after) for row, (before, _) in zip(found, with_all_rules, strict=True)
                          if (after := graded(row, remaining)) != before)
        table.append((rule.name, sum(name == rule.name for _, name in with_all_rules), changed))
    return table


def main(paths: Iterable[str]) -> None:
    """Print the table."""
    found = [row for path in paths for row in rows(Path(path)) if row.get("facts")]
    print(f"{len(found)} records\n{'rule':<24}{'decides':>9}{'changes':>9}  grades with and without it")
    for name, decides, changed in without_each(found):
        changes = ", ".join(f"{a} -> {b} {n}" for (a, b), n in changed.most_common())
        print(f"{name:<24}{decides:>9}{changed.total():>9}  {changes}")


if __name__ == "__main__":
    main(sys.argv[1:])
