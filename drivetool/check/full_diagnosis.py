"""Diagnose: where the simulation departs from the machine, which cause explains it, and what that gains.

Round by round every cause of the catalogue is fitted on top of what was found, and judged by the
log likelihood of samples it was not fitted to. Found is what beats the best that the base can do
there; named is what no other cause comes close to; and what noise cannot explain in the end is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.faults import (
    BLAMED,
    LATE,
    SCALE,
    Fault,
    expected_peaks,
    fine_steps,
    lag_of,
    load_scale,
    preflight,
    put_back,
    rescaled,
    scale_fault,
    shaft_fault,
    without_outliers,
    without_surprises,
)
from drivetool.check.fit import BROKEN, Model, everything, fit, from_start, with_parts
from drivetool.check.heldout import blocks_under_test, change_between, split_of
from drivetool.check.inverse import diagnose_by_inverse
from drivetool.check.outcome import DiagnoseOptions, Diagnosis
from drivetool.check.search import Base, Search, Searched, fitted_to_all, likelier_so, look, scale_beside
from drivetool.check.verdict import UNEXPLAINED, tell
from drivetool.drive import Drive
from drivetool.errors import BadParameters, DriveToolError, Finding, NotEnoughData
from drivetool.identify.setup import Roles, Task, led_in, roles_of, traces_of
from drivetool.identify.starts import SHAPE
from drivetool.logs import Experiment
from drivetool.logs.samples import measured

DELAY, DELAYED = "dead-time", "converter.dead_time"
MUCH = 0.5  # samples of a dead time, from which what was commanded before a record counts in it
BENT = 1.5  # factor by which a base that makes up for a law leaves its start, and no start is wrong
SHORTEST = 2.0  # s of record below which nothing can be held out
UNCHECKED = Finding(
    "note", "shaft-torque-unchecked",
    "Sign and scale of the shaft torque could not be checked: the motor alone does not tell what the shaft "
    "carries.",
    {}, "Record torque steps near the resonance.")


@dataclass(frozen=True)
class Asked:
    """What stays the same however often a diagnosis searches.

    count   of the records that are no judges; given: drive and free parameters as they came
    free    what is fitted again; begun: values that its own fit started from
    """

    count: int
    given: tuple[Drive, Sequence[str]]
    free: Sequence[str]
    wanted: Sequence[str]
    options: DiagnoseOptions
    begun: Mapping[str, float]
    notes: tuple[Finding, ...]


def diagnose(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], options: DiagnoseOptions,
             holdout: Sequence[Experiment] = (), begun: Mapping[str, float] = MappingProxyType({}),
             own: Sequence[str] = ()) -> Diagnosis:
    """Find what the simulation of a drive gets wrong.

    experiments  records with motor torque and any sensors; holdout: records that only judge, or
                 none: then each half of the blocks of the records judges what the other trained
    drive        the base, fitted
    free         names of its parameters that are fitted again, with and without a cause
    begun        values that its own fit started from, as far as they are known
    own          by criterion inverse: names NAME@RECORD of what records held out have of their own
    raises       BadParameters: a value is missing; NotEnoughData: too short to hold anything out
    source       Wasserman, Ramdas, Balakrishnan 2020 for the evidence; Ljung 1999 for the one-step
                 errors
    """
    if options.criterion == "inverse":
        return diagnose_by_inverse(experiments, drive, free, options, holdout, begun, own)
    wanted = options.candidates or tuple(CAUSES)
    drive.require(drive.missing(), "a diagnosis")
    drive, free = as_begun(drive, free, begun)
    if not free:
        raise BadParameters("a base with fitted parameters", "none that was fitted",
                            "Run greybox on a record of this drive first.")
    logged = tuple(led_in(measured(e), drive, free) for e in (*experiments, *holdout))
    mended, faults = preflight(logged, unmodelled(wanted, drive), drive.turns()[-1])
    given, (drive, free) = (drive, free), with_filter(drive, free, faults)
    mended, faults = load_scale(mended, drive, free, faults, begun)
    notes = fine_steps(logged) if "quantisation" in wanted else []
    blamed: list[Fault] = []
    unblamed = drive
    try:
        mended, drive, blamed = shaft_fault(mended, drive, free, wanted, begun)
        faults = [*faults, *blamed]
    except (np.linalg.LinAlgError, DriveToolError):
        notes.append(UNCHECKED)
    if any(f.code == "outliers" for f in faults):
        mended, faults = doubted_outliers(mended, logged, drive, free, faults)
    asked = Asked(len(experiments), given, free, wanted, options, begun, tuple(notes))
    search = searched(asked, mended, drive, faults)
    delay = delay_of(search)
    if delay > MUCH * max(e.step for e in mended):
        # What was commanded before the record comes through in it: nobody knows what that was.
        mended = tuple(led_in(e, drive.with_values({DELAYED: delay})) for e in mended)
        search = looked_again(asked, search, mended, drive, faults)
    as_logged = rescaled(mended, 1.0 / blamed[0].factor) if blamed else mended
    search = trusted(asked, with_shaft_scale(asked, search, mended, blamed), as_logged, unblamed)
    # Where the base leaves rounding alone nothing was looked for, and no sample of it is impossible.
    if "outliers" in wanted and search.rounds and search.left.total < UNEXPLAINED and not any(
            f.code == "quantisation" for f in faults):
        search = with_records(search, *without_surprises(search.model, search.train))
    return tell(search, drive, options)


def as_begun(drive: Drive, free: Sequence[str], begun: Mapping[str, float]) -> tuple[Drive, tuple[str, ...]]:
    """The base without dry friction that its own fit has added on a body behind the motor: a cause like others."""
    beyond = {f"{body}.coulomb" for body in drive.bodies[1:]}
    added = {n for n in free if n in beyond and begun.get(n) == 0.0}
    return drive.with_values(dict.fromkeys(added, 0.0)), tuple(n for n in free if n not in added)


def delay_of(search: Searched) -> float:
    """The dead time that was found, or is one of what it may be [s]; zero without."""
    if DELAY not in {*search.found.causes, *search.found.between}:
        return 0.0
    told = [p.value for one in search.rounds for c in one.candidates if c.code == DELAY
            for p in c.parameters if p.name == DELAYED]
    return max(told, default=0.0)


def looked_again(asked: Asked, before: Searched, records: Sequence[Experiment], drive: Drive,
                 faults: Sequence[Fault]) -> Searched:
    """A search over less of the records, for the causes that had a chance before; of the others that stands."""
    lines = [c for one in before.rounds for c in one.candidates]
    near = {c.code for c in lines if c.gain is not None or c.state == "worse"}
    wanted = tuple(c for c in asked.wanted if c in near or CAUSES[c].of_record)
    found = searched(replace(asked, wanted=wanted), records, drive, faults)
    rounds = tuple(replace(one, candidates=(*one.candidates, *(
        c for c in (before.rounds[i].candidates if i < len(before.rounds) else ())
        if c.code not in {line.code for line in one.candidates}))) for i, one in enumerate(found.rounds))
    return replace(found, rounds=rounds)


def searched(asked: Asked, records: Sequence[Experiment], drive: Drive, faults: Sequence[Fault]) -> Searched:
    """A search over the records; without those held out where the drive is another one there."""
    train = tuple(records[:asked.count])
    roles = roles_of(records, drive)
    split = split_of(records, asked.count, drive, roles)
    if sum(t.step * t.size for t in split.traces) < SHORTEST:
        raise NotEnoughData(f"at least {SHORTEST:g} s of record", "less", "Record longer, or give several logs.")
    if not any(blocks_under_test(its, split.traces) for its in split.folds):
        raise NotEnoughData("records to judge by that go on after their beginnings", "only beginnings of records",
                            "Record longer, or leave --holdout away: then halves of the records judge each other.")
    root, elsewhere = stands(task_of(train, drive, asked.free, roles), asked)
    wanted, possible = (not_ruled_out(codes, records) for codes in (asked.wanted, tuple(CAUSES)))
    search = Search(root, split, wanted, frozenset(possible), asked.options, elsewhere)
    result = look(search, faults, asked.notes, train)
    origin = first = result.origin
    if len(asked.free) != len(asked.given[1]):
        first, elsewhere = search.base(from_start(task_of(train, *asked.given, roles))), ()
    result = replace(result, first=stated_over(search, first, elsewhere) if result.found.causes else first)
    # Not before: a law that is missing asks for other values in every record, too.
    change = result.change and change_between(origin.folds[0].trained, origin.folds)
    long = sum(e.step * (b - a) for e in train for a, b in e.segments) >= SHORTEST
    if change is not None and change.described and long:
        return replace(searched(asked, train, drive, faults), change=change)
    return result


def stated_over(search: Search, first: Base, elsewhere: Sequence[Model]) -> Base:
    """The base that gains are stated over: refitted, or elsewhere, unfitted, where that foretells better.

    A base that is fitted again may bend its parameters for the law that it lacks, and foretell less than the file.
    """
    found = []
    for model in (first.model, *elsewhere):
        with suppress(*BROKEN):
            found.append(fitted_to_all(model, search.split, first))
    return min(found, key=lambda b: b.foretold.rmse, default=first)


def stands(task: Task, asked: Asked) -> tuple[Model, tuple[Model, ...]]:
    """(the base, the base elsewhere, where it may have bent its parameters to make up for what it lacks)."""
    root = from_start(task)
    masks = everything(root.problem)
    found = []
    for values in ({}, {n: asked.begun[n] for n in task.free if n in asked.begun}):
        there = task.at(values)
        if (values or not found) and bent(root, {n: there.drive.value(n) for n in task.free}):
            found.append(from_start(there, masks, most=0))
    if found:
        # It may also have been bent from the start: then the likelier end is the base.
        for model in found:
            with suppress(*BROKEN):
                root = min((root, fit(model, masks)), key=lambda m: m.value)
    return with_parts(root, masks), tuple(found[:1])


def bent(root: Model, values: Mapping[str, float | None]) -> bool:
    """Whether an inertia, stiffness, damping or gap has left a value by a factor that no start is off by."""
    return any(n.endswith(SHAPE) and values[n] and not values[n] / BENT < v < values[n] * BENT
               for n, v in zip(root.task.free, root.point.values, strict=True))


def with_shaft_scale(asked: Asked, search: Searched, records: Sequence[Experiment], blamed: Sequence[Fault],
                     ) -> Searched:
    """The search, or another one where the shaft torque has another scale beside the causes that were found.

    Without those the base made up for what it lacks, and the shaft torque was held against that.

    blamed  what the shaft torque was blamed for, undone in the records
    """
    found = scale_beside(search, records) if "wrong-scale" in asked.wanted else None
    if found is None:
        return search
    factor = found.factor * (blamed[0].factor if blamed else 1.0)
    faults = [f for f in search.faults if f not in blamed]
    if abs(factor - 1.0) > max(SCALE, BLAMED * found.std):
        faults.insert(0, scale_fault(factor, abs(factor) * found.std / found.factor))
    drive, free = search.origin.model.task.drive, search.origin.model.task.free
    values = {n: found.values[n] for n in free if n in found.values}
    try:
        again = searched(replace(asked, free=free), found.records, drive.with_values(values), faults)
    except BROKEN:
        return search
    return again if likelier_so(again, search, found.factor) else search


def trusted(asked: Asked, search: Searched, records: Sequence[Experiment], drive: Drive) -> Searched:
    """The search, or one that trusts the shaft torque, if laws explain all that was measured as well.

    A law that the drive lacks makes the motor's torque and motion say another shaft torque than the sensor.

    records  the same samples with the shaft torque as it was logged; drive: before that was blamed
    """
    factors = [f.factor for f in search.faults if f.code == "wrong-scale" and f.shaft]
    if not factors:
        return search
    try:
        other = searched(asked, records, drive, [f for f in search.faults if not f.shaft])
    except (*BROKEN, NotEnoughData):
        return search
    return search if not other.found.causes or likelier_so(search, other, factors[0]) else other


def doubted_outliers(mended: Sequence[Experiment], logged: Sequence[Experiment], drive: Drive, free: Sequence[str],
                     faults: Sequence[Fault]) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """Records and faults with those outliers only that surprise a base which has not seen them."""
    whole = put_back(mended, logged)
    spared = expected_peaks(from_start(task_of(mended, drive, free, roles_of(mended, drive))), whole, mended)
    found = [without_outliers(e, places) for e, places in zip(whole, spared, strict=True)]
    outliers = [Fault("outliers", f) for _, findings in found for f in findings]
    return tuple(e for e, _ in found), [*outliers, *(f for f in faults if f.code != "outliers")]


def with_records(search: Searched, experiments: Sequence[Experiment], findings: Sequence[Finding]) -> Searched:
    """With records in place of those of the training, if there are findings about what they lack."""
    if not findings:
        return search
    faults = (*search.faults, *(Fault(f.code, f) for f in findings))
    task = replace(search.model.task, experiments=tuple(experiments))
    problem = replace(search.model.problem, traces=traces_of(experiments, task.roles))
    return replace(search, faults=faults, train=tuple(experiments),
                   model=replace(search.model, task=task, problem=problem))


def with_filter(drive: Drive, free: Sequence[str], faults: Sequence[Fault]) -> tuple[Drive, tuple[str, ...]]:
    """The drive with the filter that a speed is behind, to be fitted with the rest."""
    lags = [f.lag for f in faults if f.lag is not None]
    if not lags:
        return drive, tuple(free)
    return drive.with_values({"sensor.bandwidth": 1.0 / float(np.mean(lags))}), (*free, "sensor.bandwidth")


def unmodelled(wanted: Sequence[str], drive: Drive) -> list[str]:
    """The causes that a fault of the record may be: a filter that the drive has is none."""
    return [c for c in wanted if not (c == "speed-filter" and np.isfinite(drive.value("sensor.bandwidth")))]


def not_ruled_out(wanted: Sequence[str], experiments: Sequence[Experiment]) -> list[str]:
    """The causes that are left: an angle beside the speed can tell that the speed is not filtered."""
    lags = [lag_of(e) for e in experiments]
    prompt = all(found is not None and abs(found.lag) + 3.0 * found.std < LATE * e.step
                 for found, e in zip(lags, experiments, strict=True))
    return [c for c in wanted if not (c == "speed-filter" and prompt)]


def task_of(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], roles: Roles) -> Task:
    """The drive over the records, what was free in the base free again."""
    return Task(drive, tuple(n for n in drive.quantities if n in free), roles, tuple(experiments))
