"""What the simulation gets wrong, and why.

Names the physical cause, writes the extended drive, and states the gain on data held out.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import (
    Job,
    check_outputs,
    collected_findings,
    common as cli,
    drive_for,
    held_out_differences,
    noted_options,
    only_known_differences,
    open_all,
    record_differences,
    with_torques,
)
from drivetool.cli.output import deliver, recordings_drawn_on_failure, say
from drivetool.drive import is_constant
from drivetool.errors import BadOption
from drivetool.files.disk import write_whole

if TYPE_CHECKING:
    from drivetool.check.outcome import DiagnoseOptions

EXAMPLE = "drivetool diagnose gap.parquet --params greybox.yaml --report page.html"

Holdout = Annotated[list[str] | None, typer.Option(
    "--holdout", metavar="LOG", help="Recording that only judges; repeatable. Without one, parts of the "
    "recordings judge each other.")]
Candidates = Annotated[str, typer.Option(
    "--candidates", metavar="A,B", help="Causes to look for, see drivetool effects. Default: all.")]
Budget = Annotated[float, typer.Option(
    "--error-budget", metavar="P", min=1e-6, max=0.5,
    help="Share of records without a cause on which one may be named, over all rounds.")]
Rounds = Annotated[int, typer.Option("--rounds", metavar="N", min=1, help="Most causes that are looked for.")]
Explain = Annotated[bool, typer.Option("--explain", help="Print the facts and the rule that made the verdict.")]
Report = Annotated[str | None, typer.Option("--report", metavar="FILE", help="Where the HTML page goes.")]


def command(
    logs: cli.Logs, params: cli.Base, holdout: Holdout = None, candidates: Candidates = "",
    error_budget: Budget = 0.01, rounds: Rounds = 3,
    criterion: cli.CheckCriterion = cli.CheckCriterionName.simulation, seed: cli.Seed = 1, map: cli.Map = None,
    condition: cli.Condition = None, record: cli.Record = None, out: cli.Out = None, report: Report = None,
    json: cli.Json = False, plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False,
    quiet: cli.Quiet = False, explain: Explain = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.check.outcome import DiagnoseOptions
    from drivetool.files.disk import recordings_in

    holdout_logs = tuple(holdout or ())
    job = Job("diagnose", [*logs, *holdout_logs], params, map, None, (), out, json, plot, strict, quiet,
              condition or (), record=record or ())
    codes = tuple(filter(None, (code.strip() for code in candidates.split(","))))
    if candidates and not codes:
        raise BadOption("at least one cause after --candidates", f"'{candidates}'",
                        "Name causes, with commas between; drivetool effects lists them.")
    return run(job, len(recordings_in(holdout_logs)), DiagnoseOptions(
        codes, error_budget, rounds, seed, criterion.value), report, explain)


def run(job: Job, held_count: int, options: DiagnoseOptions, report: str | None, explain: bool = False) -> int:
    """Open, diagnose, deliver; the exit code.

    held_count  number of held-out recordings of the job; the last ones
    """
    from drivetool.check import diagnose
    from drivetool.check.causes import chosen_causes
    from drivetool.cli.parts import refuse_coast_downs
    from drivetool.files.results import (
        base_findings,
        check_base,
        check_holdout,
        diagnosis_file,
        sections_before,
        verdict_finding,
    )
    from drivetool.files.tables import print_rule
    from drivetool.identify.channels import used_by

    check_outputs(job, report=report)
    opened = open_all(job)
    loaded = opened.loaded
    stated = drive_for(job, opened)
    assumed, doubts = stated.assumed(warn=False)  # most of them are freed again
    differences = record_differences(job, opened.experiments, assumed)
    split = len(opened.experiments) - held_count
    differences = (held_out_differences(differences, opened.experiments[:split],
                                   job.step) if options.criterion == "inverse"
             else only_known_differences(differences, job.step))
    opened, drive = with_torques(opened, differences.drive)
    training, holdout = opened.experiments[:split], opened.experiments[split:]
    check_holdout(training, holdout)
    refuse_coast_downs(opened.experiments)
    check_base(loaded, drive)
    options = replace(options, candidates=chosen_causes(options.candidates, drive))
    sections = loaded.sections(drive)
    with recordings_drawn_on_failure(job, training):
        free = [name for name, section in sections.items() if section.status != "held" and not is_constant(name)
                and name not in differences.free]
        found = diagnose(training, drive, free, options, holdout, loaded.starts(drive), differences.free)
    about_base = base_findings(loaded, training, holdout, options.criterion)
    all_findings = (*doubts, *about_base, verdict_finding(found), *found.estimate.findings)
    used = asdict(options) | dict(found.estimate.options) | {
        "holdout": [{"file": e.name, "sha256": e.sha256} for e in holdout]}
    used_roles = used_by(job.step, opened.experiments, drive)
    found = found.replace(estimate=replace(
        found.estimate, findings=collected_findings(opened, all_findings, used_roles, drive, job.step),
        options=noted_options(job, used, differences.words)))
    file = diagnosis_file(found, opened.inputs, stated.acting)
    if report is not None:
        from drivetool.files.pages import diagnosis_page

        write_whole(report, diagnosis_page(found, file, sections_before(sections, drive)))
        if not job.quiet:
            say(job.step, f"wrote {report}")
    code = deliver(job, file, found.exhibits)
    if explain:
        print_rule(file)
    return code
