"""Diagnose: where the simulation departs from the machine, which cause explains it, and what that gains.

Round by round every cause of the catalogue is fitted on top of what was found, and judged by the
log likelihood of samples it was not fitted to. Found is what beats the best that the base can do
there; named is what no other cause comes close to; and what noise cannot explain in the end is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from drivetool.check.afresh import strayed
from drivetool.check.between_records import change_between
from drivetool.check.causes import CAUSES
from drivetool.check.diagnosis import DiagnoseOptions, Diagnosis
from drivetool.check.judgement import UNEXPLAINED
from drivetool.check.lateness import lag_of
from drivetool.check.load_scale import load_scale
from drivetool.check.model import BROKEN, Masks, Model, everything, from_start, heard_afresh
from drivetool.check.parts import with_parts
from drivetool.check.preflight import LATE, Fault, fine_steps, preflight
from drivetool.check.rounds import Search
from drivetool.check.samples import fitted_samples, samples_of
from drivetool.check.second_look import second_look
from drivetool.check.shaft import BLAMED, SCALE, scale_fault, shaft_fault
from drivetool.check.shaft_scale import likelier_so, scale_beside
from drivetool.check.spikes import expected_peaks, put_back, without_outliers, without_surprises
from drivetool.check.story import tell
from drivetool.drive.chain import Drive
from drivetool.errors import BadParameters, DriveToolError, Finding, NotEnoughData
from drivetool.identify.engine import Task
from drivetool.identify.setup import led_in, roles_of
from drivetool.logs.experiment import Experiment
from drivetool.logs.samples.unmeasured import measured

DELAY, DELAYED = "dead-time", "converter.dead_time"
MUCH = 0.5  # samples of a dead time, from which what was commanded before a record counts in it
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
             holdout: Sequence[Experiment] = (), begun: Mapping[str, float] = MappingProxyType({})) -> Diagnosis:
    """Find what the simulation of a drive gets wrong.

    experiments  records with motor torque and any sensors; holdout: records that only judge, or
                 none: then each half of the blocks of the records judges what the other trained
    drive        the base, fitted
    free         names of its parameters that are fitted again, with and without a cause
    begun        values that its own fit started from, as far as they are known
    raises       BadParameters: a value is missing; NotEnoughData: too short to hold anything out
    source       Wasserman, Ramdas, Balakrishnan 2020 for the evidence; Ljung 1999 for the one-step
                 errors
    """
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
    try:
        mended, drive, blamed = shaft_fault(mended, drive, free, wanted, begun)
        faults += blamed
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
        search = searched(asked, mended, drive, faults)
    search = with_shaft_scale(asked, search, mended, blamed)
    if "outliers" in wanted and search.left.total < UNEXPLAINED and "quantisation" not in {f.code for f in faults}:
        search.leave_out(*without_surprises(search.model, mended[:len(search.model.task.experiments)]))
    return tell(search, drive, options)


def as_begun(drive: Drive, free: Sequence[str], begun: Mapping[str, float]) -> tuple[Drive, tuple[str, ...]]:
    """The base without dry friction that its own fit has added on a body behind the motor: a cause like others."""
    beyond = {f"{body}.coulomb" for body in drive.bodies[1:]}
    added = {n for n in free if n in beyond and begun.get(n) == 0.0}
    return drive.with_values(dict.fromkeys(added, 0.0)), tuple(n for n in free if n not in added)


def delay_of(search: Search) -> float:
    """The dead time that was found, or is one of what it may be [s]; zero without."""
    if DELAY not in {*search.found.causes, *search.found.between}:
        return 0.0
    told = [p.value for one in search.rounds for c in one.candidates if c.code == DELAY
            for p in c.parameters if p.name == DELAYED]
    return max(told, default=0.0)


def searched(asked: Asked, records: Sequence[Experiment], drive: Drive, faults: Sequence[Fault]) -> Search:
    """A search over the records; without those held out where the drive is another one there."""
    train, test = records[:asked.count], records[asked.count:]
    task = task_of(records, drive, asked.free)
    traces = task.problem().traces
    if sum(t.step * t.size for t in traces) < SHORTEST:
        raise NotEnoughData(f"at least {SHORTEST:g} s of record", "less", "Record longer, or give several logs.")
    samples = samples_of(traces, train, test, drive)
    base = base_model(task, fitted_samples(samples), asked.begun)
    search = Search(base, not_ruled_out(asked.wanted, records), asked.options, samples, faults, train)
    search.possible = frozenset(not_ruled_out(tuple(CAUSES), records))
    search.notes, search.begun = asked.notes, asked.begun
    if len(asked.free) > len(asked.given[1]):
        search.begin_with(base_model(task_of(records, *asked.given), search.masks))
    folds = search.folds
    search.run()
    # Not before: a law that is missing asks for other values in every record, too.
    change = search.change and change_between(base, folds)
    long = sum(e.step * (b - a) for e in train for a, b in e.segments) >= SHORTEST
    if change is not None and change.described and long:
        search = searched(asked, train, drive, faults)
        search.change = change
        return search
    return second_look(search)


def with_shaft_scale(asked: Asked, search: Search, records: Sequence[Experiment], blamed: Sequence[Fault],
                     ) -> Search:
    """The search, or another one where the shaft torque has another scale beside the causes that were found.

    Without those the base made up for what it lacks, and the shaft torque was held against that.

    blamed  what the shaft torque was blamed for, undone in the records
    """
    found = scale_beside(search, records) if "wrong-scale" in asked.wanted else None
    if found is None:
        return search
    factor = found.factor * (blamed[0].finding.evidence["factor"] if blamed else 1.0)
    faults = [f for f in search.faults if f not in blamed]
    if abs(factor - 1.0) > max(SCALE, BLAMED * found.std):
        faults.insert(0, scale_fault(factor, abs(factor) * found.std / found.factor))
    drive, free = search.origin.task.drive, search.origin.task.free
    values = {n: found.values[n] for n in free if n in found.values}
    try:
        again = searched(asked, found.records, drive.with_values(values), faults)
    except BROKEN:
        return search
    return again if likelier_so(again, search, found.factor) else search


def doubted_outliers(mended: Sequence[Experiment], logged: Sequence[Experiment], drive: Drive, free: Sequence[str],
                     faults: Sequence[Fault]) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """Records and faults with those outliers only that surprise a base which has not seen them."""
    whole = put_back(mended, logged)
    spared = expected_peaks(base_model(task_of(mended, drive, free)), whole, mended)
    found = [without_outliers(e, places) for e, places in zip(whole, spared, strict=True)]
    outliers = [Fault("outliers", f) for _, findings in found for f in findings]
    return tuple(e for e, _ in found), [*outliers, *(f for f in faults if f.code != "outliers")]


def with_filter(drive: Drive, free: Sequence[str], faults: Sequence[Fault]) -> tuple[Drive, tuple[str, ...]]:
    """The drive with the filter that a speed is behind, to be fitted with the rest."""
    lags = [f.finding.evidence["lag"] for f in faults if f.code == "speed-filter"]
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


def task_of(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str]) -> Task:
    """The drive over the records, what was free in the base free again."""
    return Task(drive, tuple(n for n in drive.quantities if n in free), roles_of(experiments, drive),
                tuple(experiments))


def base_model(task: Task, masks: Masks | None = None, begun: Mapping[str, float] = MappingProxyType({})) -> Model:
    """The base refitted until it moves no more: one that has not converged makes every cause a discovery.

    begun  values that its own fit started from: where a channel was mended, that fit may have gone far astray
    """
    masks = everything(task.problem()) if masks is None else masks
    base = from_start(task, masks, rounds=10)
    if strayed(base, begun):
        again = from_start(task.at({n: begun[n] for n in task.free if n in begun}), masks, rounds=10)
        base = min(base, again, key=lambda m: m.value)
    return with_parts(heard_afresh(base, masks), masks)
