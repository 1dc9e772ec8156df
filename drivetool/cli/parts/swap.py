"""compare --swap: two parameter files in the place of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from drivetool.cli.options import Job, check_outputs
from drivetool.cli.output import deliver
from drivetool.errors import BadOption


def check_words(files: Sequence[str], options: Mapping[str, object]) -> None:
    """Raise BadOption unless two parameter files are all that is given.

    files    the words of the command line that are no options
    options  name -> value of those that say how recordings are read and fitted
    """
    from drivetool.files.disk import RECORDING_SUFFIXES

    given = [name for name, value in options.items() if value]
    if given:
        raise BadOption("no option of recordings or fits beside --swap, which reads two parameter files",
                        ", ".join(given), "Leave it out.")
    for file in files:
        if Path(file).suffix.lower() in RECORDING_SUFFIXES or Path(file).is_dir():
            raise BadOption("two parameter files after compare --swap", f"the recording {file}",
                            "Fit each recording first, for example with greybox, and give what it writes.")
    if len(files) != 2:
        raise BadOption("two parameter files after compare --swap", f"{len(files)}",
                        "Give the file of the first motor, then the file of the second.")
    if list(files) == ["-", "-"]:
        raise BadOption("standard input once", "'-' twice", "Give the second one as a file.")


def run(job: Job) -> int:
    """Read both files, compare, deliver; the exit code."""
    from drivetool.files.results import sides_of, swap_file
    from drivetool.files.yaml import load_parameters
    from drivetool.identify.several import swap

    check_outputs(job)
    first, second = (load_parameters([path]) for path in job.params)
    sides = sides_of(first, second)
    found = swap(*sides)
    doubts = []
    for loaded, side in zip((first, second), sides, strict=True):
        stated, summed = loaded.stated(), {word for name in side.derived for word in name.split()}
        doubts += stated.doubts(stated.unidentified.keys() - summed)  # sums are compared as such
    found = found.replace(findings=(*doubts, *found.findings))
    return deliver(job, swap_file(found, (*first.inputs, *second.inputs)), found.exhibits)
