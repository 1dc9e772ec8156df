"""Findings of a black-box fit: whether the shaft is identifiable, the resonance excited, the gap opened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.finding import Finding
from drivetool.identify.blackbox.transfer import TransferForm
from drivetool.identify.estimate import Parameter, PlotData, experiment_for
from drivetool.identify.fit import free_run, opened_gap_findings, with_closed_gaps
from drivetool.identify.setup import Outcome, Task, reverses
from drivetool.quantity import quantity_of

# Standard deviations, and share of the value by the parameters, of the conversion error. A choice: both, since in a
# long record a significant error may be small, and in a short one a large error may be noise.
CONVERSION_ERROR_STDS, CONVERSION_ERROR_SHARE = 4.0, 0.1
BINS_PER_DECADE = 12  # a choice: a bin of 21 % width is narrower than the band of 1.3 about the resonance
RECORDING_ADVICE = ("Record sudden torque steps upward from a constant speed, as large as the drive allows, "
                    "several oscillation periods apart.")


def blackbox_findings(task: Task, lines: Sequence[Parameter], lack: tuple[str, ...], details: Mapping,
                traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> list[Finding]:
    """All findings of the step itself.

    task      with the fitted drive
    lack      (reason, code) if there is no conversion
    details   of the fit; traces and runs: measured and simulated
    """
    found = []
    if lack:
        found.append(_no_conversion(task, lack, details))
    else:
        found += [f for line in lines for f in _parameter_findings(line, task.drive)]
        found += _conversion_findings(details)
    if "resonance" in details:
        if not lack:
            found += _band_findings(details["resonance"]["hz"]["value"], traces, runs)
        found += _sampling_rate_findings(details["resonance"]["hz"]["value"], traces)
    if not lack and task.drive.shafts:
        found += opened_gap_findings(task, "the black-box model has none")
    if reverses(task.experiments):
        found.append(Finding(
            "warning", "direction-changes", "The motor reverses in this record: Coulomb friction changes its "
            "sign, and the linear black-box model does not include it.", {},
            "Use a record of one direction, or go on to greybox."))
    return found


def _no_conversion(task: Task, lack: tuple[str, ...], details: Mapping) -> Finding:
    """The finding that the conversion gives no parameters, and what to record instead."""
    reason, code = lack
    what = "inertias and stiffness" if task.drive.shafts else "an inertia"
    evidence = {n: f["value"] for n, f in details["coefficients"].items()}
    if "total_inertia_at_motor" in details:
        evidence["total_inertia_at_motor"] = details["total_inertia_at_motor"]["value"]
    do = RECORDING_ADVICE if code == "shaft-not-identifiable" else (
        f"Check the signs and units of torque and speed in the channel map. {RECORDING_ADVICE}")
    return Finding("failure", code, f"This record gives no {what}: {reason}.".replace("no an ", "no "),
                   evidence, do)


def _parameter_findings(line: Parameter, drive: Drive) -> list[Finding]:
    """The findings on one parameter."""
    if line.status == "not-identifiable":
        # The steady step identifies friction.
        return [Finding("note" if quantity_of(line.name) == "viscous" else "warning", "not-identifiable",
                        f"{line.name} is not identifiable from this record: {line.reason}.",
                        {"value": line.value} if np.isfinite(line.value) else {},
                        experiment_for(line.name, drive), line.name)]
    if line.status == "at-bound":
        certainly_negative = line.ci95 is not None and line.ci95[1] <= 0.0
        return [Finding("warning" if certainly_negative else "note", "negative-estimate",
                        f"{line.name} is {line.reason}; the value is set to zero.", {},
                        "Leave more time between torque steps, so that the oscillation decays.",
                        line.name)]
    return []


def _conversion_findings(details: Mapping) -> list[Finding]:
    """A finding where b1, which the conversion does not use, contradicts it."""
    error = details.get("left_over", {})
    if error.get("in_std") is None or abs(error["in_std"]) <= CONVERSION_ERROR_STDS:
        return []
    if abs(error["b1"] - error["b1_from_parameters"]) <= CONVERSION_ERROR_SHARE * abs(error["b1_from_parameters"]):
        return []
    return [Finding(
        "warning", "residual-conversion-error",
        "The conversion to two masses leaves an error in b1, a coefficient that it does not use. It is "
        f"{error['b1']:.4g}; the converted parameters imply {error['b1_from_parameters']:.4g}, a difference of "
        f"{abs(error['in_std']):.1f} standard deviations.", error,
        "Possible causes: a lag or dead time of the torque, a filter of the speed, another friction law. State "
        "what is known of them, then run greybox and diagnose.")]


def _sampling_rate_findings(resonance: float, traces: Sequence[Trace]) -> list[Finding]:
    rate = 1.0 / max(t.step for t in traces)
    if resonance <= rate / 3.0:
        return []
    return [Finding(
        "warning", "resonance-out-of-range",
        f"The resonance, {resonance:.4g} Hz, lies above a third of the sampling rate, {rate:.4g} Hz.",
        {"resonance": resonance, "sampling_rate": rate}, "Record with a higher sampling rate.")]


def _band_findings(resonance: float, traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> list[Finding]:
    """A finding where the motion by the torque near the resonance is below the noise."""
    frequency, ratio = excitation(traces, runs)
    near = np.abs(np.log(frequency / resonance)) < np.log(1.3)
    if near.any() and ratio[near].max() > 1.0:
        return []
    excited = frequency[ratio > 1.0]
    band = f"{excited.min():.3g} to {excited.max():.3g} Hz" if len(excited) else "no band at all"
    best = float(np.sqrt(ratio[near].max())) if near.any() else 0.0
    return [Finding(
        "warning", "resonance-out-of-range",
        f"At the resonance of {resonance:.4g} Hz the response to the torque is below the noise; the record "
        f"excites {band}.", {"resonance": resonance, "signal_over_noise": best}, RECORDING_ADVICE)]


def excitation(traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(frequency [Hz], power of the simulated motion over that of the residual) in logarithmic bins."""
    h = min(t.step for t in traces)
    low, high = 1.0 / max(t.size * t.step for t in traces), 0.5 / h
    edges = np.geomspace(low, high, max(2, int(BINS_PER_DECADE * np.log10(high / low))))
    signal, noise = np.zeros(len(edges) + 1), np.zeros(len(edges) + 1)
    for t, run in zip(traces, runs, strict=True):
        good = np.isfinite(t.outputs[:, 0])
        residual = np.where(good, t.outputs[:, 0] - run[:, 0], 0.0)
        # Differences, because a ramp leaks over all frequencies; they leave the ratio unchanged.
        window = np.hanning(t.size - 1)
        place = np.searchsorted(edges, np.fft.rfftfreq(t.size - 1, t.step))
        for total, x in ((signal, run[:, 0]), (noise, residual)):
            total += np.bincount(place, np.abs(np.fft.rfft(window * np.diff(x))) ** 2, len(total))
    inside = slice(1, len(edges))
    filled = noise[inside] > 0.0
    middle = np.sqrt(edges[:-1] * edges[1:])
    return middle[filled], signal[inside][filled] / noise[inside][filled]


def converted_run(task: Task) -> np.ndarray | None:
    """(n,) free run of the resulting drive, gap closed; None if a value is missing."""
    if task.drive.missing():
        return None
    _, _, runs = free_run(with_closed_gaps(task))
    return np.concatenate([r[:, 0] for r in runs])


def bode(form: TransferForm, outcome: Outcome, drive: Drive) -> PlotData:
    """The fitted transfer function over frequency."""
    values, traces = outcome.solution.point.values, outcome.problem.traces
    low = 1.0 / max(t.size * t.step for t in traces)
    frequency = np.geomspace(low, 0.5 / min(t.step for t in traces), 400)
    v = dict(zip(form.names, values, strict=True))
    total = v["b"] if form.order == 1 else v["b0"] / v["a1"]
    if form.order > 1:
        near = np.sqrt(v["a1"]) / (2.0 * np.pi) * np.geomspace(0.8, 1.25, 200)
        frequency = np.unique(np.concatenate([frequency, near[near < frequency[-1]]]))
    return PlotData(
        "bode", "Motor speed over motor torque", "frequency [Hz]",
        f"[({drive.motion_unit}/s)/{drive.torque_unit}]", {
            "model": (frequency, np.abs(form.response(values, frequency))),
            "rigid body": (frequency, np.abs(total) / (2.0 * np.pi * frequency))})
