"""One run of `drivetool batch`: from the options to the results and whether a bar was missed."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path

from drivetool.errors import BadOption
from drivetool.files.disk import check_folder, check_target, encoded, write_whole
from drivetool.files.shapes import SiteFile
from drivetool.files.yaml import counted_noun
from drivetool.logs.formats import read_summary
from drivetool.site.batch_request import BatchRequest, CommandLine
from drivetool.site.plan import RunOptions, find_recordings, load_site, steps_of, with_recordings
from drivetool.site.pool import Executor, Limits, Pool, Runner, check_memory_limit, cluster, library_versions
from drivetool.site.results import (
    OVERVIEW_PAGE,
    SUMMARY_CSV,
    SUMMARY_PARQUET,
    TRENDS_FILE,
    open_manifest,
    read_manifest,
    summary_csv,
    summary_parquet,
    summary_rows,
)
from drivetool.site.site_run import SiteOutcome, run_site
from drivetool.site.trends import DEFAULT_ALARM_RATIO
from drivetool.site.verdicts import Case, evaluate_bars, index_page, junit, markdown

# Ten times what a fit of a usual recording takes; a fit that needs more mostly has a wrong recording as input.
DEFAULT_MEMORY_LIMIT_MB = 2000.0
MAX_MISSED_BARS_SHOWN = 10  # A choice: lines on standard error that fit on a screen; all are in the files.


def run(request: BatchRequest, line: CommandLine) -> bool:
    """Run a site, or verify it; whether every bar is met and, if verified, every result is current."""
    site, folder, name = _site_of_request(request)
    out = _results_folder(request, folder, name)
    if not request.verify:
        check_folder(out)
    _check_verdict_paths(request)
    check_memory_limit(request.memory_limit is not None)
    steps = steps_of(site, folder, Path(name).name, line.parse)
    limits = Limits(request.time_limit, request.memory_limit or DEFAULT_MEMORY_LIMIT_MB)
    recordings = find_recordings(site, folder, out)
    say = request.say

    def options(executor: Executor | None) -> RunOptions:
        explain = (lambda text: request.write_stdout(f"{text}\n")) if request.explain else None
        bounds = {"time": limits.seconds, "memory": limits.memory_mb}
        return RunOptions(folder, out, steps, bounds, library_versions(), executor, say, explain, request.retry)

    if request.verify:
        return _verify_results(request, run_site(options(None), recordings, read_manifest(out)), site, out)
    # No other run may write before the files of the whole site are written, too.
    with _executor_of(request, limits, line.run) as executor, closing(open_manifest(out)) as manifest:
        outcome = run_site(options(executor), recordings, manifest)
        cases = evaluate_bars(outcome.entries, site.bars)
        _write_files(out, _summary_files(outcome))
        _write_verdicts(request, cases)
        _write_files(out, _trend_files(outcome, cases, out, say))
    problems = sum(entry.problem is not None for entry in outcome.entries)
    say(f"{counted_noun(len(recordings), 'recording')}; {counted_noun(len(outcome.entries), 'result')}, "
        f"{outcome.run_count} "
        f"of them run now, {problems} with a problem; wrote {os.path.relpath(out)}")
    return _report_missed_bars(request, cases)


def _site_of_request(request: BatchRequest) -> tuple[SiteFile, Path, str]:
    """(the site, the folder that its paths are relative to, its file).

    raises  BadOption: options that contradict each other; BadParameters: see load_site
    """
    if request.recipe is None:
        if len(request.given) > 1 or not request.given[0].lower().endswith((".yaml", ".yml")):
            raise BadOption("one site file (.yaml), or recordings with --recipe", ", ".join(request.given[:3]),
                            "Write the first site file with `drivetool init`, or name the recipe.")
        if request.map is not None:
            raise BadOption("--map with --recipe only", "it beside a site file",
                            "Write the map into the site file.")
        site = load_site(request.given[0])
        if not site.recordings:
            raise BadOption("recordings in the site file, or on the command line",
                            f"none in {request.given[0]}", "Name them, and this file after --recipe.")
        return site, Path(os.path.abspath(request.given[0])).parent, request.given[0]
    site = load_site(request.recipe)
    kinds = list(dict.fromkeys(step.kind for step in site.recipe))
    if site.recordings or len(kinds) > 1:
        found = "recordings in it" if site.recordings else f"the kinds {', '.join(kinds)}"
        raise BadOption(f"a recipe of one kind and without recordings in {request.recipe}", found,
                        "Give the site file alone, which says the kind of each recording.")
    return with_recordings(site, request.given, kinds[0], request.map), Path.cwd(), request.recipe


def _results_folder(request: BatchRequest, folder: Path, name: str) -> Path:
    """The folder of the results."""
    return Path(os.path.abspath(request.out)) if request.out else folder / f"{Path(name).stem}-results"


def _check_verdict_paths(request: BatchRequest) -> None:
    """Raise BadOption where a file of verdicts could not be written, or both have the same path."""
    if request.junit and request.junit == request.markdown:
        raise BadOption("different files for --junit and --markdown", f"{request.junit} for both", "Rename one.")
    for path in filter(None, (request.junit, request.markdown)):
        check_target(path)


def _summary_files(outcome: SiteOutcome) -> dict[str, str | bytes]:
    """The summary in both forms; deterministic, except for the cost of the run."""
    table = summary_rows(outcome.entries)
    return {SUMMARY_PARQUET: summary_parquet(table), SUMMARY_CSV: summary_csv(table)}


def _trend_files(outcome: SiteOutcome, cases: Sequence[Case], out: Path,
                 say: Callable[[str], None]) -> dict[str, str | bytes]:
    """The trends file and the page, from the summary as written. Changes are printed."""
    from drivetool.files.results import dump
    from drivetool.site.trends import trends_file, trends_of

    findings, found_trends = trends_of(read_summary(out / SUMMARY_PARQUET))
    changes = [finding for finding in findings if finding.severity != "note"]
    for finding in changes:
        say(f"{finding.severity}: {finding.text}")
    # Without the checksum of the summary, which contains the cost of the run.
    return {TRENDS_FILE: dump(trends_file(findings, found_trends, {"alarm": DEFAULT_ALARM_RATIO})),
            OVERVIEW_PAGE: index_page(outcome.entries, cases, changes)}


def _write_files(out: Path, files: Mapping[str, str | bytes]) -> None:
    for path, content in files.items():
        write_whole(out / path, content)


def _write_verdicts(request: BatchRequest, cases: Sequence[Case]) -> None:
    for path, form in ((request.junit, junit), (request.markdown, markdown)):
        if path == "-":
            request.write_stdout(form(cases))
        elif path:
            write_whole(path, form(cases))


def _report_missed_bars(request: BatchRequest, cases: Sequence[Case]) -> bool:
    """Print the missed bars; whether there are none."""
    missed = [case for case in cases if not case.passed]
    say = request.say
    for case in missed[:MAX_MISSED_BARS_SHOWN]:
        say(f"missed: {' '.join(filter(None, (case.machine, case.recording)))}: {case.text}")
    if len(missed) > MAX_MISSED_BARS_SHOWN:
        say(f"missed: {len(missed) - MAX_MISSED_BARS_SHOWN} more, see {OVERVIEW_PAGE}")
    return not missed


def _verify_results(request: BatchRequest, outcome: SiteOutcome, site: SiteFile, out: Path) -> bool:
    """Print what is out of date, or write the verdicts; whether all is current and no bar was missed."""
    cases = evaluate_bars(outcome.entries, site.bars)
    mismatches = list(outcome.pending)
    for make_files in (lambda: _summary_files(outcome), lambda: _trend_files(outcome, cases, out, request.say)):
        if not mismatches:
            mismatches += [f"{path}: its content differs from the results" for path, content in make_files().items()
                      if not _has_content(out / path, content)]
    for line in mismatches:
        request.write_stdout(f"{line}\n")
    request.say(f"{counted_noun(len(mismatches), 'result')} to be done or written anew" if mismatches
              else f"all {len(outcome.entries)} results are current")
    if mismatches:
        return False
    _write_verdicts(request, cases)
    return _report_missed_bars(request, cases)


def _has_content(path: Path, content: str | bytes) -> bool:
    """Whether a file has exactly this content."""
    try:
        return path.read_bytes() == encoded(content)
    except OSError:
        return False


def _executor_of(request: BatchRequest, limits: Limits, runner: Runner) -> AbstractContextManager[Executor]:
    """The pool of this machine, or the cluster; closed in any case."""
    if request.scheduler is not None:
        return cluster(request.scheduler, limits, runner)
    return closing(Pool(request.workers or _available_cores(), limits, runner))


def _available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
