"""One run of `drivetool batch`: from the words to the results and the exit code."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from drivetool.cli.batch.command import MEMORY_MB, Asked, check_verdicts, out_of, site_of, speaker
from drivetool.cli.batch.pool import Limits, Pool, check_memory_limit
from drivetool.cli.batch.recipe import steps_of
from drivetool.cli.batch.recordings import find
from drivetool.cli.batch.run import Outcome, run_site
from drivetool.cli.batch.setting import Executor, Setting
from drivetool.cli.batch.worker import numerics
from drivetool.cli.outcomes import DONE, MISSED, put
from drivetool.files.site.bars import judge
from drivetool.files.site.cases import Case, junit, markdown
from drivetool.files.site.index_page import index_page
from drivetool.files.site.manifest import PAGE, SUMMARY, TABLE, TRENDS, open_manifest, read_manifest
from drivetool.files.site.summary import rows, summary_csv, summary_parquet
from drivetool.files.text import several
from drivetool.files.write import check_folder, encoded, write_whole

if TYPE_CHECKING:
    from drivetool.files.site.shapes import SiteFile

MOST_SAID = 10  # missed bars that are said on standard error; all are in the files


def run(asked: Asked) -> int:
    """Do a site, or check it; the exit code."""
    site, folder, name = site_of(asked)
    out = out_of(asked, folder, name)
    if not asked.verify:
        check_folder(out)
    check_verdicts(asked)
    check_memory_limit(asked.memory_limit is not None)
    steps = steps_of(site, folder, Path(name).name)
    limits = Limits(asked.time_limit, asked.memory_limit or MEMORY_MB)
    found = find(site, folder, out)
    say = speaker(asked)

    def setting(executor: Executor | None) -> Setting:
        explain = (lambda text: put(f"{text}\n")) if asked.explain else None
        bounds = {"time": limits.seconds, "memory": limits.memory_mb}
        return Setting(folder, out, steps, bounds, numerics(), executor, say, explain, asked.retry)

    if asked.verify:
        return _verified(asked, run_site(setting(None), found, read_manifest(out)), site, out)
    # No other run may write before the files of the whole site are written, too.
    with _executor(asked, limits) as executor, closing(open_manifest(out)) as manifest:
        outcome = run_site(setting(executor), found, manifest)
        cases = judge(outcome.entries, site.bars)
        _write(out, _tables(outcome))
        _write_verdicts(asked, cases)
        _write(out, _told(outcome, cases, out, say))
    problems = sum(entry.problem is not None for entry in outcome.entries)
    say(f"{several(len(found), 'recording')}; {several(len(outcome.entries), 'result')}, {outcome.begun} of them "
        f"run now, {problems} with a problem; wrote {os.path.relpath(out)}")
    return _verdict(asked, cases)


def _tables(outcome: Outcome) -> dict[str, str | bytes]:
    """The summary in both forms; the same for the same results, but for the cost of the run."""
    table = rows(outcome.entries)
    return {SUMMARY: summary_parquet(table), TABLE: summary_csv(table)}


def _told(outcome: Outcome, cases: Sequence[Case], out: Path, say: Callable[[str], None]) -> dict[str, str | bytes]:
    """What the summary that was written says: the trends file and the page. What changed is said."""
    from drivetool.check.trends.findings import trends_of
    from drivetool.check.trends.trend import ALARM
    from drivetool.files.result_file import dump
    from drivetool.files.trends_file import trends_file
    from drivetool.logs.summary import read_summary

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
            put(form(cases))
        elif path:
            write_whole(path, form(cases))


def _verdict(asked: Asked, cases: Sequence[Case]) -> int:
    """Say what was missed; the exit code."""
    missed = [case for case in cases if not case.passed]
    say = speaker(asked)
    for case in missed[:MOST_SAID]:
        say(f"missed: {' '.join(filter(None, (case.machine, case.recording)))}: {case.text}")
    if len(missed) > MOST_SAID:
        say(f"missed: {len(missed) - MOST_SAID} more, see {PAGE}")
    return MISSED if missed else DONE


def _verified(asked: Asked, outcome: Outcome, site: SiteFile, out: Path) -> int:
    """Say what does not hold, or write the verdicts; the exit code."""
    cases = judge(outcome.entries, site.bars)
    wrong = list(outcome.undone)
    for made in (lambda: _tables(outcome), lambda: _told(outcome, cases, out, speaker(asked))):
        if not wrong:
            wrong += [f"{path}: it is not what the results give" for path, content in made().items()
                      if not _is(out / path, content)]
    for line in wrong:
        put(f"{line}\n")
    speaker(asked)(f"{several(len(wrong), 'result')} to be done or written anew" if wrong
                   else f"all {len(outcome.entries)} results hold")
    if wrong:
        return MISSED
    _write_verdicts(asked, cases)
    return _verdict(asked, cases)


def _is(path: Path, content: str | bytes) -> bool:
    """Whether a file has a content."""
    try:
        return path.read_bytes() == encoded(content)
    except OSError:
        return False


@contextmanager
def _executor(asked: Asked, limits: Limits) -> Iterator[Executor]:
    """The pool of this machine, or the cluster; ended whatever happens."""
    if asked.scheduler is not None:
        from drivetool.cli.batch.cluster import cluster

        with cluster(asked.scheduler, limits) as remote:
            yield remote
        return
    pool = Pool(asked.workers or _cores(), limits)
    try:
        yield pool
    finally:
        pool.close()


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
