"""The tasks of the command line."""

from __future__ import annotations

import fnmatch
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tests.golden import compare, environment, inputs, places, run
from tests.golden.case import Case, inputs_hash
from tests.golden.inputs_options import uncovered
from tests.golden.masks import Masks, renamed


def main(task: str, words: Sequence[str]) -> int:
    """The exit code: 1 for a difference."""
    if task == "compare":
        return golden(words[0], words[1:])
    if task == "list":
        return listed(words)
    if not words:
        raise SystemExit(f"{task} wants a commit.")
    commit, patterns = places.commit_of(words[0]), words[1:]
    cases = chosen(inputs.all_cases(places.base()), patterns)
    if task == "again":
        return again(commit, cases)
    costs(cases, run.run_all(cases, commit))
    return 0


def chosen(cases: Sequence[Case], patterns: Sequence[str]) -> list[Case]:
    """Those that match one of the patterns; all without a pattern."""
    return [each for each in cases if not patterns or any(fnmatch.fnmatch(each.name, p) for p in patterns)]


def golden(base: str, patterns: Sequence[str]) -> int:
    """BASE and the working tree."""
    commit = places.head_of_clean_tree()
    cases = chosen(inputs.all_cases(base), patterns)
    old, new = (run.run_all(cases, each) for each in (base, commit))
    return report(base, commit, cases, old, new)


def again(commit: str, cases: Sequence[Case]) -> int:
    """A commit and itself: whether its results are the same every time."""
    old = run.run_all(cases, commit)
    new = run.run_all(cases, commit, again=True, place=old.with_name(f"{old.name}-again"))
    return report(commit, commit, cases, old, new)


def report(base: str, commit: str, cases: Sequence[Case], old: Path, new: Path) -> int:
    """Print what differs, and keep it in a file."""
    masks = Masks((version(base), version(commit)), renamed())
    found = compare.compare(cases, old, new, masks)
    found.schemas, more = compare.schemas(environment.tree(base), environment.tree(commit), masks)
    found.differences += more
    text = compare.report(found, masks, base, commit, inputs_hash(cases))
    (places.folder() / "report.txt").write_text(text + "\n", encoding="utf-8")
    costs(cases, old, new)
    print(text)
    return int(bool(found.differences))


def costs(cases: Sequence[Case], *places_of_results: Path) -> None:
    """Minutes of processor time by kind, of each side."""
    spent: Counter[tuple[str, Path]] = Counter()
    for case in cases:
        for place in places_of_results:
            result = run.Result.read(place / f"{case.key}.zip")
            minutes = result.seconds / 60.0 if result else 0.0
            spent.update({(case.kind, place): minutes, ("all", place): minutes})
    print("minutes of processor time:")
    for kind in (*dict.fromkeys(case.kind for case in cases), "all"):
        count = sum(kind in (case.kind, "all") for case in cases)
        each = " ".join(f"{spent[kind, place]:7.1f}" for place in places_of_results)
        print(f"  {kind:10} {count:4} cases {each}")


def version(commit: str) -> str:
    """What `drivetool --version` says."""
    done = subprocess.run([environment.python(), "-P", "-m", "drivetool", "--version"], capture_output=True,
                          env=environment.variables(commit), text=True, check=True)
    return done.stdout.split()[-1]


def listed(patterns: Sequence[str]) -> int:
    """Print the cases, and the options that none has."""
    base = places.base()
    everything = inputs.all_cases(base)
    for each in chosen(everything, patterns):
        print(f"{each.kind}: {each.key}", *each.commands, sep="\n    ")
    kinds = Counter(each.kind for each in everything)
    print(f"{len(everything)} cases ({', '.join(f'{n} {kind}' for kind, n in kinds.items())}), "
          f"{sum(len(each.commands) for each in everything)} commands, inputs {inputs_hash(everything)}")
    left = uncovered(base, everything)
    print("no case has: " + (", ".join(left) or "nothing"))
    return 0
