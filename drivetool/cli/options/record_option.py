"""--record FILE WORD: what differs in one of the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from typer.core import TyperCommand

from drivetool.cli.options.inputs import as_usage, start_of, start_value
from drivetool.cli.options.job import BETWEEN, Job
from drivetool.errors import BadOption, nearest

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.identify.setup import Start
    from drivetool.logs import Experiment

OPTION = "--record"
FREE, START, CLAMPED = "free", "start", "clamped"
DO = f"Write for example '{OPTION} FILE load.added_inertia=0.02', '{OPTION} FILE free=motor.coulomb', " \
     f"'{OPTION} FILE clamped=load' or '{OPTION} FILE start=rest'."


class Command(TyperCommand):
    """A command with an option of two words that may be repeated, which typer does not have."""

    def parse_args(self, ctx, args: list[str]) -> list[str]:
        """The words behind the option are joined first."""
        return super().parse_args(ctx, joined(args))


def joined(args: Sequence[str]) -> list[str]:
    """The words of a command line, both words after the option as one."""
    found, left = [], list(args)
    while left:
        word = left.pop(0)
        if word == "--":
            return [*found, word, *left]
        if word.startswith(f"{OPTION}="):
            left.insert(0, word.removeprefix(f"{OPTION}="))
            word = OPTION
        found.append(word)
        if word == OPTION and len(left) > 1:
            found.append(f"{left.pop(0)}{BETWEEN}{left.pop(0)}")
    return found


@dataclass(frozen=True)
class Differing:
    """What the recordings differ in.

    drive   with the values of single recordings, free or known
    free    names of those that are fitted
    starts  number of a recording -> the state in which it begins
    words   (recording, word) as they were said
    """

    drive: Drive
    free: tuple[str, ...] = ()
    starts: dict[int, Start] = field(default_factory=dict)
    words: tuple[tuple[str, str], ...] = ()


def differing(job: Job, experiments: Sequence[Experiment], drive: Drive) -> Differing:
    """The drive with what --record said.

    raises  BadOption: a file that is no recording of the command line, a word that is none, an unknown name
    """
    found, states = Differing(drive), {}
    for pair in job.record:
        file, between, word = pair.partition(BETWEEN)
        if not between:
            raise BadOption(f"a recording and what differs in it after {OPTION}", f"only '{file}'", DO)
        e = _recording(file, job.logs, experiments)
        found = _with_label(found, e)
        label = next(name for name, sha in found.drive.records.items() if sha == e.sha256)
        kind, _, rest = word.partition("=")
        if kind.strip() == CLAMPED and not rest.strip():
            raise BadOption(f"a body after {CLAMPED}=", f"'{word}'", DO, found.drive.bodies)
        if kind.strip() == START:
            states.setdefault(e.number, []).append(rest)
        elif kind.strip() == FREE:
            found = _freed(found, label, rest, word)
        elif kind.strip() == CLAMPED:
            found = _clamped(found, label, rest.strip(), e)
        else:
            found = _stated(found, label, word)
        found = replace(found, words=(*found.words, (label, word)))
    starts = {number: start_of([w for w in words if w.strip() != FREE], drive) for number, words in states.items()}
    return replace(found, starts=starts)


def only_stated(found: Differing, step: str) -> Differing:
    """The same for a step that fits nothing."""
    if found.free:
        raise BadOption(f"known changes after {OPTION} of {step}", f"{FREE}=", "Fit it with greybox --record, and "
                        "pass the file that it writes.")
    return found


def own_of_held_out(found: Differing, training: Sequence[Experiment], step: str) -> Differing:
    """The same for a step that fits what differs in recordings that only judge; training: the others."""
    fitted = {e.sha256 for e in training}
    taken = [label for n in found.free if found.drive.records[label := n.partition("@")[2]] in fitted]
    if taken:
        raise BadOption(f"recordings of --holdout after {OPTION} with {FREE}= of {step}", taken[0],
                        "Fit it with greybox --record, and pass the file that it writes.")
    if found.starts:
        raise BadOption(f"no state after {OPTION} of {step} --criterion inverse", f"{START}=",
                        "The motion is taken as measured: leave it out.")
    return found


def _recording(file: str, logs: Sequence[str], experiments: Sequence[Experiment]) -> Experiment:
    """The recording of that name on the command line."""
    if file not in logs:
        raise BadOption(f"a recording of the command line after {OPTION}", f"'{file}'",
                        "Name it as it is named there.", tuple(logs))
    e = experiments[list(logs).index(file)]
    if sum(other.sha256 == e.sha256 for other in experiments) > 1:
        raise BadOption(f"a recording after {OPTION} whose content no other has", f"'{file}', which is there twice",
                        "Leave out the copy.")
    return e


def _with_label(found: Differing, e: Experiment) -> Differing:
    """The drive that knows the recording, by its file's name; numbered where another one is called so."""
    records = found.drive.records
    if e.sha256 in records.values():
        return found
    name, count = e.name, 2
    while name in records:
        name, count = f"{e.name} ({count})", count + 1
    return replace(found, drive=replace(found.drive, records={**records, name: e.sha256}))


def _freed(found: Differing, label: str, names: str, word: str) -> Differing:
    """Parameters that are fitted anew for the recording, from the value that they have."""
    each = [n.strip() for n in names.split(",") if n.strip()]
    if not each:
        raise BadOption(f"names after {FREE}=", f"'{word}'", DO)
    for name in each:
        _no_sum_of_parts(found.drive, name)
        drive = _in_parts(found.drive, name)
        with as_usage():
            own, value = f"{name}@{label}", drive.value(name)
            value = drive.values.get(own, value)
            if value is None:
                raise BadOption(f"a start value of {name}", "none", f"Give one with --set {name}=VALUE.")
            drive = drive.with_values({own: value})
        found = replace(found, drive=drive, free=(*found.free, own))
    return found


def _clamped(found: Differing, label: str, body: str, e: Experiment) -> Differing:
    """A body that was held while the recording was made."""
    from drivetool.drive import AT
    from drivetool.identify.greybox import check_clamped

    if body not in found.drive.bodies:
        raise BadOption(f"a body of the {found.drive.name} drive after {CLAMPED}=", f"'{body}'",
                        nearest(body, found.drive.bodies))
    check_clamped(e, found.drive, body)
    return replace(found, drive=found.drive.with_values({f"{body}.clamped{AT}{label}": 1.0}))


def _stated(found: Differing, label: str, word: str) -> Differing:
    """A parameter whose value in the recording is known."""
    kind = word.partition("=")[0].strip()
    if kind.endswith(f".{CLAMPED}"):
        raise BadOption(f"{CLAMPED}=BODY after {OPTION} FILE", f"'{word}'", DO)
    _no_sum_of_parts(found.drive, kind)
    drive = _in_parts(found.drive, kind)
    with as_usage():
        name, value = start_value(word, drive, f"{OPTION} FILE")
        return replace(found, drive=drive.with_values({f"{name}@{label}": value}))


def _no_sum_of_parts(drive: Drive, name: str) -> None:
    """Raise BadOption where a sum is named of which the drive has the parts."""
    from drivetool.drive import TOTALS

    parts = [f"{b}.{TOTALS[name]}" for b in drive.bodies] if name in TOTALS else []
    if parts and (len(parts) == 1 or any(p in drive.values for p in parts)):
        raise BadOption(f"the friction of a body after {OPTION}", f"the sum {name}", f"Name {parts[0]}.")


def _in_parts(drive: Drive, name: str) -> Drive:
    """The friction of each body in the place of their sum, where one of them is named."""
    from drivetool.drive import TOTALS
    from drivetool.identify.fit import apart

    suffix = name.rpartition(".")[2]
    sums = [total for total, part in TOTALS.items() if part == suffix and total != name and total in drive.values]
    return apart(drive) if sums else drive
