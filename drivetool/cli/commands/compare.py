"""Structures side by side.

Each fitted on every record and checked on all the others; mean and spread of what they find over the experiments.
With --swap: one drive, identified from both of its motors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from enum import StrEnum
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import (
    Job,
    collected_findings,
    common as cli,
    drive_for,
    noted_options,
    open_all,
    with_torques,
)
from drivetool.cli.output import deliver, recordings_drawn_on_failure
from drivetool.cli.parts import swap as sides
from drivetool.errors import BadOption

if TYPE_CHECKING:
    from drivetool.identify.several import CompareOptions

EXAMPLE = "drivetool compare one.parquet two.parquet --structure oe --out compare.yaml"

# What can be compared.
ComparedName = StrEnum("ComparedName", (
    "oe", "bj", "arx", "armax", "innovations", "physical", "physical-innovations"))
Structures = Annotated[list[ComparedName] | None, typer.Option(
    "--structure", help="Repeatable; physical is the drive fitted to simulate (K = 0), physical-innovations to "
    "predict. Default: oe and bj.")]
Order = Annotated[int | None, typer.Option(
    "--order", metavar="N", min=1, help="Of the polynomial ones. Default: 2 n - 1 for a drive of n bodies.")]


Machines = Annotated[list[str] | None, typer.Option(
    "--machine", metavar="NAME=PATTERN", help="Which recordings are of one machine, as 'A=axis1/*'; repeatable. "
    "Machines are told apart by how each varies from recording to recording. Default: every recording for itself.")]
Swap = Annotated[bool, typer.Option(
    "--swap", help="Compare two parameter files in the place of recordings: of one drive, identified with one "
    "machine as the motor, then with the machine at its other end. The bodies of the second file are exchanged; - "
    "is standard input.")]


def command(
    logs: cli.Logs, params: cli.Params = None, map: cli.Map = None, condition: cli.Condition = None,
    drive: cli.DriveName = None, structure: Structures = None, order: Order = None,
    noise_order: cli.NoiseOrder = None, machine: Machines = None, swap: Swap = False,
    set: cli.Set = None, out: cli.Out = None, json: cli.Json = False, plot: cli.Plot = None,
    strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    from drivetool.identify.several import CompareOptions

    job = Job("compare", logs, params or (), map, drive, set or (), out, json, plot, strict, quiet,
              condition or ())
    if swap:
        sides.check_words(logs, {
            "--params": params, "--map": map, "--condition": condition, "--drive": drive,
            "--structure": structure, "--order": order, "--noise-order": noise_order is not None,
            "--machine": machine, "--set": set})
        return sides.run(replace(job, given=(), params=logs))
    names = tuple(dict.fromkeys(s.value for s in structure)) if structure else ("oe", "bj")
    return run(job, CompareOptions(names, order, noise_order, machines_of(machine or (), job.logs)))


def machines_of(words: Sequence[str], logs: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """'A=axis1/*' as the places of the recordings on the command line.

    raises  BadOption: a pattern without recordings, a recording in two machines, a machine with one recording
    """
    from drivetool.identify.several import MIN_RECORDS_PER_MACHINE

    found: dict[str, tuple[int, ...]] = {}
    for word in words:
        name, equals, pattern = (part.strip() for part in word.partition("="))
        if not (name and equals and pattern):
            raise BadOption("NAME=PATTERN after --machine", f"'{word}'", "Write for example --machine 'A=axis1/*'.")
        if name in found:
            raise BadOption("every machine once after --machine", f"'{name}' twice",
                            "Put its recordings under one pattern.")
        found[name] = tuple(i for i, log in enumerate(logs) if fnmatchcase(log, pattern))
        if len(found[name]) < MIN_RECORDS_PER_MACHINE:
            raise BadOption(f"at least {MIN_RECORDS_PER_MACHINE} recordings of machine {name}: one recording "
                            "does not separate the machine from the day",
                            f"{len(found[name])} for '{pattern}'", "Correct the pattern, or record it again.",
                            tuple(logs))
    shared = [log for i, log in enumerate(logs) if sum(i in places for places in found.values()) > 1]
    if shared:
        raise BadOption("every recording assigned to one machine", f"'{shared[0]}' in several",
                        "Correct the patterns.")
    if len(found) == 1:
        raise BadOption("two machines to compare", f"only '{next(iter(found))}'", "Give another --machine.")
    return found


def run(job: Job, options: CompareOptions) -> int:
    """Open, fit, check, deliver; the exit code."""
    from drivetool.files.results import comparison_file
    from drivetool.identify.channels import used_by
    from drivetool.identify.several import compare
    from drivetool.logs import refuse_copies

    opened = open_all(job)
    assumed, doubts = drive_for(job, opened).assumed(warn=False)  # most of them are fitted again
    opened, drive = with_torques(opened, assumed)
    refuse_copies([opened.experiments[i] for places in options.machines.values() for i in places])
    with recordings_drawn_on_failure(job, opened.experiments):
        found = compare(opened.experiments, drive, options)
    used = asdict(options) | {"machines": {name: [opened.experiments[i].name for i in places]
                                           for name, places in options.machines.items()}}
    found = replace(found, options=noted_options(job, used), findings=collected_findings(
        opened, (*doubts, *found.findings), used_by(job.step, opened.experiments, drive), drive, job.step))
    return deliver(job, comparison_file(found, opened.inputs), found.exhibits)
