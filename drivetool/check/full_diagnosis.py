"""Diagnose: which cause explains the difference between simulation and machine, and its gain.

In each round every cause of the catalogue is fitted on top of those found, and tested by the log
likelihood of held-out samples. A cause is found if it beats the best fit of the base there, and
named if no other cause comes close. The report states what noise does not explain in the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.faults import (
    MIN_DELAY_SAMPLES,
    MIN_SHAFT_SCALE_ERROR,
    SENSOR_SIGNIFICANCE,
    Fault,
    encoder_step_findings,
    expected_peaks,
    load_scale,
    record_faults_of,
    rescaled,
    scale_fault,
    shaft_fault,
    speed_delay,
    with_outliers_restored,
    without_model_outliers,
    without_outliers,
)
from drivetool.check.fit import FIT_ERRORS, Model, all_samples, fit, fit_from_start, with_parts
from drivetool.check.heldout import blocks_under_test, change_between, split_of
from drivetool.check.inverse import diagnose_by_inverse
from drivetool.check.outcome import DiagnoseOptions, Diagnosis
from drivetool.check.search import (
    Base,
    ForwardSelection,
    SearchResult,
    fitted_to_all,
    joint_shaft_scale,
    scale_improves_likelihood,
    search_causes,
)
from drivetool.check.verdict import MIN_UNEXPLAINED_GAIN, diagnosis_of
from drivetool.drive import Drive
from drivetool.errors import BadParameters, DriveToolError, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.setup import Roles, Task, after_transient, roles_of, traces_of
from drivetool.identify.starts import SHAPE_QUANTITIES
from drivetool.logs import Experiment
from drivetool.logs.samples import without_unmeasured
from drivetool.quantity import name_of, quantity_of

DEAD_TIME_CODE, DEAD_TIME_NAME = "dead-time", "converter.dead_time"
# samples of a dead time: from half a sample on, a torque from before the record acts in it
MIN_DEAD_TIME_SAMPLES = 0.5
# factor by which a biased base leaves its start (docs/explanation/diagnosis.md), while start values are closer
MAX_START_FACTOR = 1.5
MIN_RECORD_LENGTH = 2.0  # s of record: with less nothing can be held out
SHAFT_TORQUE_UNCHECKED = Finding(
    "note", "shaft-torque-unchecked",
    "Sign and scale of the shaft torque could not be checked: the shaft torque is not identifiable from "
    "the motor channels.",
    {}, "Record torque steps near the resonance.")


@dataclass(frozen=True)
class Request:
    """The settings that all searches of a diagnosis share.

    count   of training records; given: drive and free parameters as requested
    free    parameters that are fitted again; initial_fit: start values of the base's own fit
    """

    count: int
    given: tuple[Drive, Sequence[str]]
    free: Sequence[str]
    wanted: Sequence[str]
    options: DiagnoseOptions
    initial_fit: Mapping[str, float]
    notes: tuple[Finding, ...]


def diagnose(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], options: DiagnoseOptions,
             holdout: Sequence[Experiment] = (), initial_fit: Mapping[str, float] = MappingProxyType({}),
             own: Sequence[str] = ()) -> Diagnosis:
    """Find the laws that the simulation of a drive lacks.

    experiments  records with motor torque and any sensors; holdout: held-out records, or
                 none: then each half of the blocks of the records tests the fit to the other
    drive        the base, fitted
    free         names of its parameters that are fitted again, with and without a cause
    initial_fit  start values of its own fit, as far as they are known
    own          by criterion inverse: names NAME@RECORD of parameters that held-out records have of their own
    raises       BadParameters: a value is missing; NotEnoughData: too short to hold anything out
    source       Wasserman, Ramdas, Balakrishnan 2020 for the evidence; Ljung 1999 for the one-step
                 errors
    """
    if options.criterion == "inverse":
        return diagnose_by_inverse(experiments, drive, free, options, holdout, initial_fit, own)
    wanted = options.candidates or tuple(CAUSES)
    drive.require(drive.missing(), "a diagnosis")
    drive, free = without_added_friction(drive, free, initial_fit)
    if not free:
        raise BadParameters("a base with fitted parameters", "none that was fitted",
                            "Run greybox on a record of this drive first.")
    logged = tuple(after_transient(without_unmeasured(e), drive, free) for e in (*experiments, *holdout))
    corrected, faults = record_faults_of(logged, causes_not_modelled(wanted, drive), drive.gear_ratios()[-1])
    given, (drive, free) = (drive, free), with_speed_filter(drive, free, faults)
    corrected, faults = load_scale(corrected, drive, free, faults, initial_fit)
    notes = encoder_step_findings(logged) if "quantisation" in wanted else []
    sensor_faults: list[Fault] = []
    uncorrected = drive
    try:
        corrected, drive, sensor_faults = shaft_fault(corrected, drive, free, wanted, initial_fit)
        faults = [*faults, *sensor_faults]
    except (np.linalg.LinAlgError, DriveToolError):
        notes.append(SHAFT_TORQUE_UNCHECKED)
    if any(f.code == "outliers" for f in faults):
        corrected, faults = confirmed_outliers(corrected, logged, drive, free, faults)
    request = Request(len(experiments), given, free, wanted, options, initial_fit, tuple(notes))
    search = search_records(request, corrected, drive, faults)
    delay = found_dead_time(search)
    if delay > MIN_DEAD_TIME_SAMPLES * max(e.step for e in corrected):
        # An unknown command from before the record acts in its first samples.
        corrected = tuple(after_transient(e, drive.with_values({DEAD_TIME_NAME: delay})) for e in corrected)
        search = repeated_search(request, search, corrected, drive, faults)
    as_logged = rescaled(corrected, 1.0 / sensor_faults[0].factor) if sensor_faults else corrected
    search = with_trusted_sensor(request, with_shaft_scale(request, search, corrected, sensor_faults), as_logged,
                                 uncorrected)
    # A base that is exact to rounding was not searched, and has no outliers.
    if "outliers" in wanted and search.rounds and search.left.total < MIN_UNEXPLAINED_GAIN and not any(
            f.code == "quantisation" for f in faults):
        search = with_corrected_records(search, *without_model_outliers(search.model, search.train))
    return diagnosis_of(search, drive, options)


def without_added_friction(drive: Drive, free: Sequence[str],
                           initial_fit: Mapping[str, float]) -> tuple[Drive, tuple[str, ...]]:
    """The base without dry friction that its own fit has added behind the motor: that is a cause like others."""
    load_friction = {name_of(body, "coulomb") for body in drive.bodies[1:]}
    added = {n for n in free if n in load_friction and initial_fit.get(n) == 0.0}
    return drive.with_values(dict.fromkeys(added, 0.0)), tuple(n for n in free if n not in added)


def found_dead_time(search: SearchResult) -> float:
    """The dead time among the causes found or their rivals [s]; zero without."""
    if DEAD_TIME_CODE not in {*search.found.causes, *search.found.between}:
        return 0.0
    delays = [p.value for one in search.rounds for c in one.candidates if c.code == DEAD_TIME_CODE
            for p in c.parameters.values() if p.name == DEAD_TIME_NAME]
    return max(delays, default=0.0)


def repeated_search(request: Request, before: SearchResult, records: Sequence[Experiment], drive: Drive,
                 faults: Sequence[Fault]) -> SearchResult:
    """A search over shortened records, for the causes that were tested before; the other results stay."""
    lines = [c for one in before.rounds for c in one.candidates]
    tested = {c.code for c in lines if c.gain is not None or c.state == "worse"}
    wanted = tuple(c for c in request.wanted if c in tested or CAUSES[c].of_record)
    found = search_records(replace(request, wanted=wanted), records, drive, faults)
    rounds = tuple(one.replace(candidates=(*one.candidates, *(
        c for c in (before.rounds[i].candidates if i < len(before.rounds) else ())
        if c.code not in {line.code for line in one.candidates}))) for i, one in enumerate(found.rounds))
    return replace(found, rounds=rounds)


def search_records(request: Request, records: Sequence[Experiment], drive: Drive,
                   faults: Sequence[Fault]) -> SearchResult:
    """A search over the records; without the held-out ones where their parameters differ."""
    train = tuple(records[:request.count])
    roles = roles_of(records, drive)
    split = split_of(records, request.count, drive, roles)
    if sum(t.step * t.size for t in split.traces) < MIN_RECORD_LENGTH:
        raise NotEnoughData(f"at least {MIN_RECORD_LENGTH:g} s of record", "less",
                            "Record longer, or give several logs.")
    if not any(blocks_under_test(its, split.traces) for its in split.folds):
        raise NotEnoughData("test records longer than their initial transients", "initial transients only",
                            "Record longer, or leave out --holdout: then halves of the records test each other.")
    root, alternatives = base_and_alternatives(task_of(train, drive, request.free, roles), request)
    wanted, possible = (without_excluded_filter(codes, records) for codes in (request.wanted, tuple(CAUSES)))
    search = ForwardSelection(root, split, wanted, frozenset(possible), request.options, alternatives)
    result = search_causes(search, faults, request.notes, train)
    origin = first = result.origin
    if len(request.free) != len(request.given[1]):
        first, alternatives = search.base(fit_from_start(task_of(train, *request.given, roles))), ()
    result = replace(result, first=reference_base(search, first, alternatives) if result.found.causes else first)
    # Not before: a missing law changes the fitted values in every record, too.
    change = result.change and change_between(origin.folds[0].trained, origin.folds)
    long_enough = sum(e.step * (b - a) for e in train for a, b in e.segments) >= MIN_RECORD_LENGTH
    if change is not None and change.described and long_enough:
        return replace(search_records(request, train, drive, faults), change=change)
    return result


def reference_base(search: ForwardSelection, first: Base, alternatives: Sequence[Model]) -> Base:
    """The base that gains are stated over: refitted, or at other values where these predict held-out data better.

    A refitted base may be biased by the missing law, and predict worse than the values of the file.
    """
    found = []
    for model in (first.model, *alternatives):
        with suppress(*FIT_ERRORS):
            found.append(fitted_to_all(model, search.split, first))
    return min(found, key=lambda b: b.free_runs.rmse, default=first)


def base_and_alternatives(task: Task, request: Request) -> tuple[Model, tuple[Model, ...]]:
    """(the base, the base at its start values where its fit may be biased by a missing law)."""
    root = fit_from_start(task)
    masks = all_samples(root.problem)
    found = []
    for values in ({}, {n: request.initial_fit[n] for n in task.free if n in request.initial_fit}):
        initial = task.at(values)
        if (values or not found) and has_diverged_from_start(root, {n: initial.drive.value(n) for n in task.free}):
            found.append(fit_from_start(initial, masks, max_iterations=0))
    if found:
        # The start values may be biased as well: the likelier end is the base.
        for model in found:
            with suppress(*FIT_ERRORS):
                root = min((root, fit(model, masks)), key=lambda m: m.value)
    return with_parts(root, masks), tuple(found[:1])


def has_diverged_from_start(root: Model, values: Mapping[str, float | None]) -> bool:
    """Whether an inertia, stiffness, damping or gap differs from its start by more than starts are wrong."""
    return any(quantity_of(n) in SHAPE_QUANTITIES and values[n]
               and not values[n] / MAX_START_FACTOR < v < values[n] * MAX_START_FACTOR
               for n, v in zip(root.task.free, root.point.values, strict=True))


def with_shaft_scale(request: Request, search: SearchResult, records: Sequence[Experiment],
                     sensor_faults: Sequence[Fault]) -> SearchResult:
    """The search, or another one where the shaft torque has another scale together with the causes found.

    Without the causes a biased base was the reference of the shaft torque.

    sensor_faults  of the shaft torque, corrected in the records
    """
    found = joint_shaft_scale(search, records) if "wrong-scale" in request.wanted else None
    if found is None:
        return search
    factor = found.factor * (sensor_faults[0].factor if sensor_faults else 1.0)
    faults = [f for f in search.faults if f not in sensor_faults]
    if abs(factor - 1.0) > max(MIN_SHAFT_SCALE_ERROR, SENSOR_SIGNIFICANCE * found.std):
        faults.insert(0, scale_fault(factor, abs(factor) * found.std / found.factor))
    drive, free = search.origin.model.task.drive, search.origin.model.task.free
    values = {n: found.values[n] for n in free if n in found.values}
    try:
        again = search_records(replace(request, free=free), found.records, drive.with_values(values), faults)
    except FIT_ERRORS:
        return search
    return again if scale_improves_likelihood(again, search, found.factor) else search


def with_trusted_sensor(request: Request, search: SearchResult, records: Sequence[Experiment],
                        drive: Drive) -> SearchResult:
    """The search, or one with the shaft torque as logged, if laws explain all channels as well.

    With a missing law the motor's torque and motion give another shaft torque than the sensor.

    records  the same samples with the shaft torque as logged; drive: from before its correction
    """
    factors = [f.factor for f in search.faults if f.code == "wrong-scale" and f.shaft]
    if not factors:
        return search
    try:
        other = search_records(request, records, drive, [f for f in search.faults if not f.shaft])
    except (*FIT_ERRORS, NotEnoughData):
        return search
    return search if not other.found.causes or scale_improves_likelihood(search, other, factors[0]) else other


def confirmed_outliers(corrected: Sequence[Experiment], logged: Sequence[Experiment], drive: Drive,
                       free: Sequence[str], faults: Sequence[Fault],
                       ) -> tuple[tuple[Experiment, ...], list[Fault]]:
    """Records and faults with only those outliers that contradict a base fitted without them."""
    whole = with_outliers_restored(corrected, logged)
    confirmed = expected_peaks(
        fit_from_start(task_of(corrected, drive, free, roles_of(corrected, drive))), whole, corrected)
    found = [without_outliers(e, places) for e, places in zip(whole, confirmed, strict=True)]
    outliers = [Fault("outliers", f) for _, findings in found for f in findings]
    return tuple(e for e, _ in found), [*outliers, *(f for f in faults if f.code != "outliers")]


def with_corrected_records(search: SearchResult, experiments: Sequence[Experiment],
                           findings: Sequence[Finding]) -> SearchResult:
    """The search with corrected training records, if findings say what was removed."""
    if not findings:
        return search
    faults = (*search.faults, *(Fault(f.code, f) for f in findings))
    task = replace(search.model.task, experiments=tuple(experiments))
    problem = replace(search.model.problem, traces=traces_of(experiments, task.roles))
    return replace(search, faults=faults, train=tuple(experiments),
                   model=replace(search.model, task=task, problem=problem))


def with_speed_filter(drive: Drive, free: Sequence[str], faults: Sequence[Fault]) -> tuple[Drive, tuple[str, ...]]:
    """The drive with the filter of a logged speed, to be fitted with the rest."""
    lags = [f.lag for f in faults if f.lag is not None]
    if not lags:
        return drive, tuple(free)
    return drive.with_values({"sensor.bandwidth": 1.0 / float(np.mean(lags))}), (*free, "sensor.bandwidth")


def causes_not_modelled(wanted: Sequence[str], drive: Drive) -> list[str]:
    """The causes that may be faults of the record: a filter that the drive already has is none."""
    return [c for c in wanted if not (c == "speed-filter" and np.isfinite(drive.value("sensor.bandwidth")))]


def without_excluded_filter(wanted: Sequence[str], experiments: Sequence[Experiment]) -> list[str]:
    """The remaining causes: a logged angle can show that the speed is not filtered."""
    lags = [speed_delay(e) for e in experiments]
    undelayed = all(found is not None and abs(found.lag) + 3.0 * found.std < MIN_DELAY_SAMPLES * e.step
                 for found, e in zip(lags, experiments, strict=True))
    return [c for c in wanted if not (c == "speed-filter" and undelayed)]


def task_of(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str], roles: Roles) -> Task:
    """The drive over the records, with the free parameters of the base."""
    return Task(drive, tuple(n for n in drive.quantities if n in free), roles, tuple(experiments))
