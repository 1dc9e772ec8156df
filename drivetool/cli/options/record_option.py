"""--record FILE WORD: the differences of one of the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from drivetool.cli.options.inputs import errors_as_usage, start_of, start_value
from drivetool.cli.options.job import WORD_SEPARATOR, Job
from drivetool.errors import BadOption, nearest
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.identify.setup import KnownStart
    from drivetool.logs import Experiment

RECORD_OPTION = "--record"
FREE_WORD, START_WORD, CLAMPED_WORD = "free", "start", "clamped"
RECORD_ADVICE = (
    f"Write for example '{RECORD_OPTION} FILE load.added_inertia=0.02', '{RECORD_OPTION} FILE free=motor.coulomb', "
    f"'{RECORD_OPTION} FILE clamped=load' or '{RECORD_OPTION} FILE start=rest'.")


def join_record_words(args: Sequence[str]) -> list[str]:
    """The words of a command line, both words after the option as one."""
    found, remaining = [], list(args)
    while remaining:
        word = remaining.pop(0)
        if word == "--":
            return [*found, word, *remaining]
        if word.startswith(f"{RECORD_OPTION}="):
            remaining.insert(0, word.removeprefix(f"{RECORD_OPTION}="))
            word = RECORD_OPTION
        found.append(word)
        if word == RECORD_OPTION and len(remaining) > 1:
            found.append(f"{remaining.pop(0)}{WORD_SEPARATOR}{remaining.pop(0)}")
    return found


@dataclass(frozen=True)
class RecordDifferences:
    """The differences between the recordings.

    drive   with the values of single recordings, free or known
    free    names of those that are fitted
    starts  number of a recording -> the state in which it begins
    words   (recording, word) as given
    """

    drive: Drive
    free: tuple[str, ...] = ()
    starts: dict[int, KnownStart] = field(default_factory=dict)
    words: tuple[tuple[str, str], ...] = ()


def record_differences(job: Job, experiments: Sequence[Experiment], drive: Drive) -> RecordDifferences:
    """The drive with the differences given by --record.

    raises  BadOption: a file that is no recording of the command line, an unknown word or name
    """
    found, states = RecordDifferences(drive), {}
    for pair in job.record:
        file, between, word = pair.partition(WORD_SEPARATOR)
        if not between:
            raise BadOption(f"a recording and what differs in it after {RECORD_OPTION}", f"only '{file}'",
                            RECORD_ADVICE)
        e = _named_recording(file, job.logs, experiments)
        found = _with_label(found, e)
        label = next(name for name, sha in found.drive.records.items() if sha == e.sha256)
        kind, _, rest = word.partition("=")
        if kind.strip() == CLAMPED_WORD and not rest.strip():
            raise BadOption(f"a body after {CLAMPED_WORD}=", f"'{word}'", RECORD_ADVICE, found.drive.bodies)
        if kind.strip() == START_WORD:
            states.setdefault(e.number, []).append(rest)
        elif kind.strip() == FREE_WORD:
            found = _with_free_parameters(found, label, rest, word)
        elif kind.strip() == CLAMPED_WORD:
            found = _with_clamped_body(found, label, rest.strip(), e)
        else:
            found = _with_known_value(found, label, word)
        found = replace(found, words=(*found.words, (label, word)))
    starts = {number: start_of([w for w in words if w.strip() != FREE_WORD], drive) for number,
              words in states.items()}
    return replace(found, starts=starts)


def only_known_differences(found: RecordDifferences, step: str) -> RecordDifferences:
    """The same for a step that fits nothing."""
    if found.free:
        raise BadOption(f"known changes after {RECORD_OPTION} of {step}", f"{FREE_WORD}=",
                        "Fit it with greybox --record, and "
                        "pass the file that it writes.")
    return found


def held_out_differences(found: RecordDifferences, training: Sequence[Experiment], step: str) -> RecordDifferences:
    """The same for a step that fits differences of held-out recordings only; training: the other recordings."""
    fitted = {e.sha256 for e in training}
    of_training = [label for n in found.free if found.drive.records[label := n.partition("@")[2]] in fitted]
    if of_training:
        raise BadOption(f"held-out recordings (--holdout) after {RECORD_OPTION} with {FREE_WORD}= of {step}",
                        of_training[0],
                        "Fit it with greybox --record, and pass the file that it writes.")
    if found.starts:
        raise BadOption(f"no state after {RECORD_OPTION} of {step} --criterion inverse", f"{START_WORD}=",
                        "The motion is taken as measured: leave it out.")
    return found


def _named_recording(file: str, logs: Sequence[str], experiments: Sequence[Experiment]) -> Experiment:
    """The recording of that name on the command line."""
    if file not in logs:
        raise BadOption(f"a recording of the command line after {RECORD_OPTION}", f"'{file}'",
                        "Use the same name as on the command line.", tuple(logs))
    e = experiments[list(logs).index(file)]
    if sum(other.sha256 == e.sha256 for other in experiments) > 1:
        raise BadOption(f"a recording after {RECORD_OPTION} whose content no other has",
                        f"'{file}', which is there twice", "Leave out the copy.")
    return e


def _with_label(found: RecordDifferences, e: Experiment) -> RecordDifferences:
    """The drive with the recording under its file's name; numbered where another one has that name."""
    records = found.drive.records
    if e.sha256 in records.values():
        return found
    name, count = e.name, 2
    while name in records:
        name, count = f"{e.name} ({count})", count + 1
    return replace(found, drive=replace(found.drive, records={**records, name: e.sha256}))


def _with_free_parameters(found: RecordDifferences, label: str, names: str, word: str) -> RecordDifferences:
    """Parameters that are fitted anew for the recording, from the value that they have."""
    each = [n.strip() for n in names.split(",") if n.strip()]
    if not each:
        raise BadOption(f"names after {FREE_WORD}=", f"'{word}'", RECORD_ADVICE)
    for name in each:
        drive = _with_split_friction(found.drive, name)
        with errors_as_usage():
            own, value = f"{name}@{label}", drive.value(name)
            value = drive.values.get(own, value)
            if value is None:
                raise BadOption(f"a start value of {name}", "none", f"Give one with --set {name}=VALUE.")
            drive = drive.with_values({own: value})
        found = replace(found, drive=drive, free=(*found.free, own))
    return found


def _with_clamped_body(found: RecordDifferences, label: str, body: str, e: Experiment) -> RecordDifferences:
    """A body that was held while the recording was made."""
    from drivetool.identify.greybox import check_clamped

    if body not in found.drive.bodies:
        raise BadOption(f"a body of the {found.drive.name} drive after {CLAMPED_WORD}=", f"'{body}'",
                        nearest(body, found.drive.bodies))
    check_clamped(e, found.drive, body)
    return replace(found, drive=found.drive.with_values({name_of(body, "clamped", label): 1.0}))


def _with_known_value(found: RecordDifferences, label: str, word: str) -> RecordDifferences:
    """A parameter whose value in the recording is known."""
    kind = word.partition("=")[0].strip()
    if kind.endswith(f".{CLAMPED_WORD}"):
        raise BadOption(f"{CLAMPED_WORD}=BODY after {RECORD_OPTION} FILE", f"'{word}'", RECORD_ADVICE)
    drive = _with_split_friction(found.drive, kind)
    with errors_as_usage():
        name, value = start_value(word, drive, f"{RECORD_OPTION} FILE")
        return replace(found, drive=drive.with_values({f"{name}@{label}": value}))


def _with_split_friction(drive: Drive, name: str) -> Drive:
    """The friction of each body in the place of their sum, where one of them is named.

    raises  BadOption: the sum is named and the drive has its parts
    """
    from drivetool.drive import TOTALS
    from drivetool.identify.fit import with_friction_parts

    parts = [f"{b}.{TOTALS[name]}" for b in drive.bodies] if name in TOTALS else []
    if parts and (len(parts) == 1 or any(p in drive.values for p in parts)):
        raise BadOption(f"the friction of a body after {RECORD_OPTION}", f"the sum {name}", f"Name {parts[0]}.")
    suffix = name.rpartition(".")[2]
    sums = [total for total, part in TOTALS.items() if part == suffix and total != name and total in drive.values]
    return with_friction_parts(drive) if sums else drive
