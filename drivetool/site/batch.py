"""One run of `drivetool batch`: from the words to the results and whether any was missed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from drivetool.errors import BadOption
from drivetool.files.disk import check_folder, check_target, encoded, write_whole
from drivetool.files.shapes import SiteFile
from drivetool.files.yaml import several
from drivetool.logs.formats import read_summary
from drivetool.site.asked import Asked, CommandLine
from drivetool.site.plan import Setting, find, load_site, steps_of, with_recordings
from drivetool.site.pool import Executor, Limits, Pool, Runner, check_memory_limit, cluster, numerics
from drivetool.site.results import (
    PAGE,
    SUMMARY,
    TABLE,
    TRENDS,
    open_manifest,
    read_manifest,
    rows,
    summary_csv,
    summary_parquet,
)
from drivetool.site.site_run import Outcome, run_site
from drivetool.site.verdicts import Case, index_page, judge, junit, markdown

# Ten times what a fit of a usual recording takes; beyond it a recording is a mistake more often than large.
MEMORY_MB = 2000.0
MOST_SAID = 10  # missed bars that are said on standard error; all are in the files


def run(asked: Asked, line: CommandLine) -> bool:
    """Do a site, or check it; whether every bar is met and, where it is checked, every result holds."""
    site, folder, name = _site_of(asked)
    out = _out_of(asked, folder, name)
    if not asked.verify:
        check_folder(out)
    _check_verdicts(asked)
    check_memory_limit(asked.memory_limit is not None)
    steps = steps_of(site, folder, Path(name).name, line.parse)
    limits = Limits(asked.time_limit, asked.memory_limit or MEMORY_MB)
    found = find(site, folder, out)
    say = asked.say

    def setting(executor: Executor | None) -> Setting:
        explain = (lambda text: asked.put(f"{text}\n")) if asked.explain else None
        bounds = {"time": limits.seconds, "memory": limits.memory_mb}
        return Setting(folder, out, steps, bounds, numerics(), executor, say, explain, asked.retry)

    if asked.verify:
        return _verified(asked, run_site(setting(None), found, read_manifest(out)), site, out)
    # No other run may write before the files of the whole site are written, too.
    with _executor(asked, limits, line.run) as executor, closing(open_manifest(out)) as manifest:
        outcome = run_site(setting(executor), found, manifest)
        cases = judge(outcome.entries, site.bars)
        _write(out, _tables(outcome))
        _write_verdicts(asked, cases)
        _write(out, _told(outcome, cases, out, say))
    problems = sum(entry.problem is not None for entry in outcome.entries)
    say(f"{several(len(found), 'recording')}; {several(len(outcome.entries), 'result')}, {outcome.begun} of them "
        f"run now, {problems} with a problem; wrote {os.path.relpath(out)}")
    return _verdict(asked, cases)


def _site_of(asked: Asked) -> tuple[SiteFile, Path, str]:
    """(the site, the folder that its paths count from, its file).

    raises  BadOption: words that do not fit together; BadParameters: see load_site
    """
    if asked.recipe is None:
        if len(asked.given) > 1 or not asked.given[0].lower().endswith((".yaml", ".yml")):
            raise BadOption("one site file (.yaml), or recordings with --recipe", ", ".join(asked.given[:3]),
                            "Write the first site file with `drivetool init`, or name the recipe.")
        if asked.map is not None:
            raise BadOption("--map with --recipe only", "it beside a site file",
                            "Write the map into the site file.")
        site = load_site(asked.given[0])
        if not site.recordings:
            raise BadOption("recordings in the site file, or on the command line",
                            f"none in {asked.given[0]}", "Name them, and this file after --recipe.")
        return site, Path(os.path.abspath(asked.given[0])).parent, asked.given[0]
    site = load_site(asked.recipe)
    kinds = list(dict.fromkeys(step.kind for step in site.recipe))
    if site.recordings or len(kinds) > 1:
        found = "recordings in it" if site.recordings else f"the kinds {', '.join(kinds)}"
        raise BadOption(f"a recipe of one kind and without recordings in {asked.recipe}", found,
                        "Give the site file alone, which says the kind of each recording.")
    return with_recordings(site, asked.given, kinds[0], asked.map), Path.cwd(), asked.recipe


def _out_of(asked: Asked, folder: Path, name: str) -> Path:
    """The folder of the results."""
    return Path(os.path.abspath(asked.out)) if asked.out else folder / f"{Path(name).stem}-results"


def _check_verdicts(asked: Asked) -> None:
    """Raise BadOption where a file of verdicts could not be written, or both would go to one place."""
    if asked.junit and asked.junit == asked.markdown:
        raise BadOption("different files for --junit and --markdown", f"{asked.junit} for both", "Rename one.")
    for path in filter(None, (asked.junit, asked.markdown)):
        check_target(path)


def _tables(outcome: Outcome) -> dict[str, str | bytes]:
    """The summary in both forms; the same for the same results, but for the cost of the run."""
    table = rows(outcome.entries)
    return {SUMMARY: summary_parquet(table), TABLE: summary_csv(table)}


def _told(outcome: Outcome, cases: Sequence[Case], out: Path, say: Callable[[str], None]) -> dict[str, str | bytes]:
    """What the summary that was written says: the trends file and the page. What changed is said."""
    from drivetool.files.results import dump
    from drivetool.site.trends import ALARM, trends_file, trends_of

    findings, found = trends_of(read_summary(out / SUMMARY))
    changed = [finding for finding in findings if finding.severity != "note"]
    for finding in changed:
        say(f"{finding.severity}: {finding.text}")
    # Without the checksum of the summary, which has the cost of the run in it.
    return {TRENDS: dump(trends_file(findings, found, {"alarm": ALARM})),
            PAGE: index_page(outcome.entries, cases, outcome.outputs, changed)}


def _write(out: Path, files: Mapping[str, str | bytes]) -> None:
    for path, content in files.items():
        write_whole(out / path, content)


def _write_verdicts(asked: Asked, cases: Sequence[Case]) -> None:
    for path, form in ((asked.junit, junit), (asked.markdown, markdown)):
        if path == "-":
            asked.put(form(cases))
        elif path:
            write_whole(path, form(cases))


def _verdict(asked: Asked, cases: Sequence[Case]) -> bool:
    """Say what was missed; whether nothing was."""
    missed = [case for case in cases if not case.passed]
    say = asked.say
    for case in missed[:MOST_SAID]:
        say(f"missed: {' '.join(filter(None, (case.machine, case.recording)))}: {case.text}")
    if len(missed) > MOST_SAID:
        say(f"missed: {len(missed) - MOST_SAID} more, see {PAGE}")
    return not missed


def _verified(asked: Asked, outcome: Outcome, site: SiteFile, out: Path) -> bool:
    """Say what does not hold, or write the verdicts; whether all holds and no bar was missed."""
    cases = judge(outcome.entries, site.bars)
    wrong = list(outcome.undone)
    for made in (lambda: _tables(outcome), lambda: _told(outcome, cases, out, asked.say)):
        if not wrong:
            wrong += [f"{path}: it is not what the results give" for path, content in made().items()
                      if not _is(out / path, content)]
    for line in wrong:
        asked.put(f"{line}\n")
    asked.say(f"{several(len(wrong), 'result')} to be done or written anew" if wrong
              else f"all {len(outcome.entries)} results hold")
    if wrong:
        return False
    _write_verdicts(asked, cases)
    return _verdict(asked, cases)


def _is(path: Path, content: str | bytes) -> bool:
    """Whether a file has a content."""
    try:
        return path.read_bytes() == encoded(content)
    except OSError:
        return False


@contextmanager
def _executor(asked: Asked, limits: Limits, runner: Runner) -> Iterator[Executor]:
    """The pool of this machine, or the cluster; ended whatever happens."""
    if asked.scheduler is not None:
        with cluster(asked.scheduler, limits, runner) as remote:
            yield remote
        return
    pool = Pool(asked.workers or _cores(), limits, runner)
    try:
        yield pool
    finally:
        pool.close()


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
