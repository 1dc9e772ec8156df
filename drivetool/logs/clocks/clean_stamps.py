"""Time stamps as logged: in order, each once, uniform where they were cut to a coarse resolution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import median_step
from drivetool.logs.clocks.batched_times import refuse_batches
from drivetool.logs.clocks.coarse_clock import restore_uniform_times

# Times beyond this [s], 30 million years, are damage; larger ones would overflow in what follows.
MAX_ABS_TIME = 1e15
# A choice: several writers displace a sample by at most so many places. More is a clock that was set back.
MAX_DISPLACEMENT = 64
NO_STAMPS = np.zeros(0)
# Counters that wrap: the register widths that occur in loggers [bit], and what a count may stand for [s].
COUNTER_BITS, SECONDS_PER_COUNT = (32, 31, 24, 16), {"ns": 1e-9, "us": 1e-6, "ms": 1e-3}


def clean_clock(time: np.ndarray, who: str, log: str, values: Sequence[np.ndarray] = (),
                empty_stamps: np.ndarray = NO_STAMPS) -> tuple[np.ndarray, np.ndarray | None, list[Finding]]:
    """The stamps without repeated and missing ones, in order.

    time     (n,) seconds as logged; who: the channels on this clock, for messages
    values   (n,) each, of those channels
    without  (k,) stamps of the same clock at which the channels have no value
    returns  (m,) seconds, strictly increasing; (m,) indices of the samples that are kept, in the order of time,
             None: all, as they are; findings
    raises   BadRecording: the clock was set back (says where), or has receive times in batches; single samples out
             of order are sorted
    """
    findings = []
    keep = np.flatnonzero(np.abs(time) < MAX_ABS_TIME)  # neither NaN nor damaged beyond all time
    if len(keep) < len(time):
        findings.append(Finding(
            "warning", "time-stamps-invalid", f"{len(time) - len(keep)} samples of {who} in {log} have no time "
            "stamp and are left out.", {"samples": len(time) - len(keep), "of": len(time)}))
    if len(keep) == 0:
        raise BadRecording(f"time stamps of {who} in {log}", "none",
                           "Name the time channel in the channel map.")
    keep, more = _sort_stamps(time, keep, who, log)
    findings += more
    coarse = _restore_with_empty_stamps(time[keep], [v[keep] for v in values], empty_stamps)
    if coarse is not None:
        found, resolution = coarse
        step = median_step(found)
        findings.append(Finding(
            "note", "clock-corrected", f"The stamps of {who} in {log} are quantised to {resolution:.4g} s; a "
            f"uniform clock with a step of {step:.6g} s replaces them.",
            {"resolution": resolution, "step": step}, "Log time stamps with full resolution."))
        return found, keep, findings
    refuse_batches(np.unique(time[keep]), who, log)  # with one stamp a batch, it is a coarse clock
    step = np.diff(time[keep])
    if np.any(step == 0):
        repeated = int(np.sum(step == 0))
        findings.append(Finding(
            "warning", "time-stamps-invalid", f"{repeated} samples of {who} in {log} repeat the previous time "
            "stamp and are left out.", {"samples": repeated, "of": len(time)},
            "Check the resolution of the recorder's clock."))
        keep = keep[np.concatenate([[True], step > 0])]
    return (time[keep], keep, findings) if findings else (time, None, findings)


def _restore_with_empty_stamps(time: np.ndarray, values: Sequence[np.ndarray],
                               empty_stamps: np.ndarray) -> tuple[np.ndarray, float] | None:
    """See coarse_clock; stamps without a value distinguish a coarse clock from one that regularly lacks samples."""
    found = restore_uniform_times(time, values)
    if found is None or not len(empty_stamps):
        return found
    every = np.concatenate([time, empty_stamps])
    order = np.argsort(every, kind="stable")
    both = restore_uniform_times(every[order])
    if both is None:
        return found if np.any(np.diff(time) == 0) else None
    return both[0][order < len(time)], both[1]


def _sort_stamps(time: np.ndarray, keep: np.ndarray, who: str, log: str) -> tuple[np.ndarray, list[Finding]]:
    """Indices in the order of time, if single samples were logged too late; BadRecording if the clock jumps."""
    step = np.diff(time[keep])
    if not np.any(step < 0):
        return keep, []
    order = np.argsort(time[keep], kind="stable")
    displacement = np.abs(order - np.arange(len(order)))
    late = int(np.sum(displacement > 0))
    # A clock that was set back leaves two samples where one should be; late samples fill their holes.
    half_step = 0.5 * np.median(np.abs(step))
    crowded = int(np.sum(np.diff(time[keep][order]) < half_step)) > int(np.sum(np.abs(step) < half_step))
    if displacement.max() > MAX_DISPLACEMENT or crowded:
        at = int(np.argmax(step < 0))
        where = f"a step of {step[at]:.6g} s after sample {keep[at]} at {time[keep[at]]:.6f} s"
        counter = _find_wrapped_counter(float(step[at]), float(half_step))
        if counter:
            bits, unit = counter
            raise BadRecording(
                f"time that does not go backwards for {who} in {log}",
                f"{where}, as produced by an overflowing counter of 2^{bits} {unit}",
                f"Write `wrap: {2**bits}` (in counts of the time channel) for `time` in the channel map.")
        raise BadRecording(
            f"time that does not go backwards for {who} in {log}", where,
            "Cut the record there (--condition 'keep to=...'), or choose another time channel in the channel map.")
    return keep[order], [Finding(
        "warning", "time-stamps-invalid",
        f"{late} samples of {who} in {log} were not logged in the order of their time "
        "stamps; they were sorted.", {"samples": late, "of": len(time)}, "Check the recorder.")]


def _find_wrapped_counter(step_back: float, half_step: float) -> tuple[int, str] | None:
    """(bits, what a count is) of a counter whose start makes a step back [s]; None if there is none.

    usual  half the usual step [s], by which the next sample may be off
    """
    return next(((bits, unit) for bits in COUNTER_BITS for unit, count in SECONDS_PER_COUNT.items()
                 if abs(step_back + 2.0**bits * count - 2.0 * half_step) <= half_step), None)
