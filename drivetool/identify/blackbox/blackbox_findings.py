"""What a black-box fit tells about the record: seen or not seen, in the band or not, gap opened or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.errors import Finding
from drivetool.identify.blackbox.transfer import Form
from drivetool.identify.estimate import Exhibit, Parameter, experiment_for
from drivetool.identify.fit import free_run, opened_gaps, shut
from drivetool.identify.setup import Outcome, Task, reverses

# Log likelihood that the shaft must bring over one rigid body. Chance brings 6 on average and at most
# 16 in 360 records of mere noise; the resonance of a 2 s record in heavy noise brings 28 and more.
VISIBLE = 20.0
LEFT_OVER, LEFT_OVER_SHARE = 4.0, 0.1  # standard deviations, and of what it should be
BINS_PER_DECADE = 12
RECORD = ("Record torque steps upward from a constant speed, sudden ones, as large as the drive allows, "
          "with several periods of the oscillation between them.")


def lacking(gain: float) -> str:
    """Why the shaft cannot be told, in words; empty if it can."""
    if gain >= VISIBLE:
        return ""
    return "the oscillation of the shaft does not show: one rigid body explains the record as well"


def findings_of(task: Task, lines: Sequence[Parameter], lack: tuple[str, ...], details: Mapping,
                traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> list[Finding]:
    """Everything the step itself found.

    task      with the fitted drive
    lack      (reason, code) if there is no conversion
    details   of the fit; traces and runs: what was measured and what the model simulates
    """
    found = []
    if lack:
        found.append(_no_conversion(task, lack, details))
    else:
        found += [f for line in lines for f in _of_line(line, task.drive)]
        found += _left_over(details)
    if "resonance" in details:
        if not lack:
            found += _band(details["resonance"]["hz"]["value"], traces, runs)
        found += _sampling(details["resonance"]["hz"]["value"], traces)
    if not lack and task.drive.shafts:
        found += opened_gaps(task, "the black box has none")
    if reverses(task.experiments):
        found.append(Finding(
            "warning", "direction-changes", "The motor turns both ways in this record: Coulomb friction "
            "changes its sign, and the black box has none.", {},
            "Use a record of one direction, or go on to greybox."))
    return found


def _no_conversion(task: Task, lack: tuple[str, ...], details: Mapping) -> Finding:
    """That no parameters came out, and what to record instead."""
    reason, code = lack
    what = "inertias and stiffness" if task.drive.shafts else "an inertia"
    evidence = {n: f["value"] for n, f in details["coefficients"].items()}
    if "total_inertia_at_motor" in details:
        evidence["total_inertia_at_motor"] = details["total_inertia_at_motor"]["value"]
    do = RECORD if code == "shaft-not-excited" else (
        f"Check the signs and units of torque and speed in the channel map. {RECORD}")
    return Finding("failure", code, f"This record gives no {what}: {reason}.".replace("no an ", "no "),
                   evidence, do)


def _of_line(line: Parameter, drive: Drive) -> list[Finding]:
    """What there is to say about one parameter."""
    if line.status == "not-identifiable":
        # Friction is what the steady step is for.
        return [Finding("note" if line.name.endswith(".viscous") else "warning", "not-identifiable",
                        f"{line.name} cannot be told from this record: {line.reason}.",
                        {"value": line.value} if np.isfinite(line.value) else {},
                        experiment_for(line.name, drive), line.name)]
    if line.status == "at-bound":
        surely = line.ci95 is not None and line.ci95[1] <= 0.0
        return [Finding("warning" if surely else "note", "damping-not-told",
                        f"{line.name} {line.reason}; it was set to zero.", {},
                        "Longer between the steps the oscillation shows how it dies out.", line.name)]
    return []


def _left_over(details: Mapping) -> list[Finding]:
    """b1 took no part in the conversion, so it can contradict it."""
    left = details.get("left_over", {})
    if left.get("in_std") is None or abs(left["in_std"]) <= LEFT_OVER:
        return []
    if abs(left["b1"] - left["b1_from_parameters"]) <= LEFT_OVER_SHARE * abs(left["b1_from_parameters"]):
        return []
    return [Finding(
        "warning", "conversion-left-over",
        f"The coefficient that the conversion leaves out, b1, is {left['b1']:.4g}; two masses with a shaft "
        f"have {left['b1_from_parameters']:.4g}, {abs(left['in_std']):.1f} standard deviations away.", left,
        "A lag or dead time between logged torque and motor does this, or a filter on the speed, or other "
        "friction: state what is known of them, then see greybox and diagnose.")]


def _sampling(resonance: float, traces: Sequence[Trace]) -> list[Finding]:
    rate = 1.0 / max(t.step for t in traces)
    if resonance <= rate / 3.0:
        return []
    return [Finding(
        "warning", "resonance-near-sampling-rate",
        f"The resonance, {resonance:.4g} Hz, lies above a third of the sampling rate, {rate:.4g} Hz.",
        {"resonance": resonance, "sampling_rate": rate}, "Record with a higher sampling rate.")]


def _band(resonance: float, traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> list[Finding]:
    """Whether the torque makes more motion near the resonance than there is noise."""
    frequency, ratio = excitation(traces, runs)
    near = np.abs(np.log(frequency / resonance)) < np.log(1.3)
    if near.any() and ratio[near].max() > 1.0:
        return []
    seen = frequency[ratio > 1.0]
    band = f"{seen.min():.3g} to {seen.max():.3g} Hz" if len(seen) else "no band at all"
    best = float(np.sqrt(ratio[near].max())) if near.any() else 0.0
    return [Finding(
        "warning", "resonance-outside-band",
        f"The resonance of {resonance:.4g} Hz lies where the torque moves the drive less than the noise "
        f"does; the record excites {band}.", {"resonance": resonance, "signal_over_noise": best}, RECORD)]


def excitation(traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(frequency [Hz], power of the simulated motion over that of the residual) in logarithmic bins."""
    h = min(t.step for t in traces)
    low, high = 1.0 / max(t.size * t.step for t in traces), 0.5 / h
    edges = np.geomspace(low, high, max(2, int(BINS_PER_DECADE * np.log10(high / low))))
    signal, noise = np.zeros(len(edges) + 1), np.zeros(len(edges) + 1)
    for t, run in zip(traces, runs, strict=True):
        good = np.isfinite(t.outputs[:, 0])
        rest = np.where(good, t.outputs[:, 0] - run[:, 0], 0.0)
        # Differences, because a ramp leaks over all frequencies; the ratio does not mind.
        window = np.hanning(t.size - 1)
        place = np.searchsorted(edges, np.fft.rfftfreq(t.size - 1, t.step))
        for total, x in ((signal, run[:, 0]), (noise, rest)):
            total += np.bincount(place, np.abs(np.fft.rfft(window * np.diff(x))) ** 2, len(total))
    inside = slice(1, len(edges))
    kept = noise[inside] > 0.0
    middle = np.sqrt(edges[:-1] * edges[1:])
    return middle[kept], signal[inside][kept] / noise[inside][kept]


def converted_run(task: Task) -> np.ndarray | None:
    """(n,) free run of the drive that the step hands on, gap closed; None if it lacks a value."""
    if task.drive.missing():
        return None
    _, _, runs = free_run(shut(task))
    return np.concatenate([r[:, 0] for r in runs])


def bode(form: Form, outcome: Outcome, drive: Drive) -> Exhibit:
    """The fitted transfer function over frequency."""
    values, traces = outcome.solution.point.values, outcome.problem.traces
    low = 1.0 / max(t.size * t.step for t in traces)
    frequency = np.geomspace(low, 0.5 / min(t.step for t in traces), 400)
    v = dict(zip(form.names, values, strict=True))
    total = v["b"] if form.order == 1 else v["b0"] / v["a1"]
    if form.order > 1:
        near = np.sqrt(v["a1"]) / (2.0 * np.pi) * np.geomspace(0.8, 1.25, 200)
        frequency = np.unique(np.concatenate([frequency, near[near < frequency[-1]]]))
    return Exhibit(
        "bode", "Motor speed over motor torque", "frequency [Hz]",
        f"[({drive.motion_unit}/s)/{drive.torque_unit}]", {
            "model": (frequency, np.abs(form.response(values, frequency))),
            "rigid body": (frequency, np.abs(total) / (2.0 * np.pi * frequency))})
