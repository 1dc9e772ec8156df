"""Peaks of a measured frequency response, and findings on its validity."""

from __future__ import annotations

import numpy as np
import scipy

from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData
from drivetool.identify.frequency.frf import Response
from drivetool.identify.frequency.sections import PeakSection
from drivetool.identify.frequency.spectrum import Spectrum

# Coherence below which a line is unreliable: more than half of its output power is not linear response.
MIN_COHERENCE = 0.5
# DB of distortion relative to the signal from which it is a warning. A choice: 1 % of the amplitude
MAX_DISTORTION_DB = -40.0
MAX_LISTED_PEAKS = 12  # peaks listed. A choice: more than the modes of a drive, few enough for a table
MIN_PEAK_PROMINENCE = np.log(10.0 ** (3.0 / 20.0))  # 3 dB, the usual half-power limit of a resonance


def peaks_of(r: Response) -> tuple[PeakSection, ...]:
    """Resonances and anti-resonances that stand out by 3 dB and by four standard deviations."""
    level = np.log(np.maximum(np.abs(r.g), 1e-300))
    stds = np.sqrt(np.maximum(r.variance, 0.0) / 2.0) / np.maximum(np.abs(r.g), 1e-300)
    found = []
    for kind, sign in (("resonance", 1.0), ("anti-resonance", -1.0)):
        for i, size in zip(*(lambda p: (p[0], p[1]["prominences"]))(
                scipy.signal.find_peaks(sign * level, prominence=MIN_PEAK_PROMINENCE)), strict=True):
            std = stds[i] if np.isfinite(stds[i]) else 0.0
            if size < 4.0 * std or r.coherence[max(0, i - 1): i + 2].min() < MIN_COHERENCE:
                continue
            gap = float(r.frequency[i + 1] - r.frequency[i - 1]) / 2.0
            found.append(PeakSection(kind, float(r.frequency[i]), float(np.abs(r.g[i])), gap,
                                     float(20.0 * size / np.log(10.0))))
    strongest = sorted(found, key=lambda p: -p.prominence_db)[:MAX_LISTED_PEAKS]
    return tuple(sorted(strongest, key=lambda p: p.hz))


def findings_of(s: Spectrum, reference: bool) -> tuple[Finding, ...]:
    """In the order of their weight."""
    return (*_coherence_findings(s), *_closed_loop_findings(s, reference), *_distortion_findings(s),
            *_empty_line_findings(s))


def _coherence_findings(s: Spectrum) -> list[Finding]:
    poor = float(np.mean(s.mean.coherence < MIN_COHERENCE))
    evidence = {"share_of_lines": poor, "largest_coherence": float(s.mean.coherence.max())}
    if poor == 1.0:
        return [Finding(
            "failure", "low-coherence",
            f"The coherence of {s.input} and {s.output} is below {MIN_COHERENCE} at every line: "
            "the estimated response is unreliable.", evidence,
            "Check the channels and their clocks, excite more, or record longer.")]
    if poor > 0.1:
        good = s.mean.frequency[s.mean.coherence >= MIN_COHERENCE]
        return [Finding(
            "warning", "low-coherence",
            f"The coherence is below {MIN_COHERENCE} at {100 * poor:.0f} % of the lines; "
            f"the other lines lie between {good[0]:.4g} and {good[-1]:.4g} Hz.", evidence,
            "Use only the lines with sufficient coherence; excite the others more, or use longer frames for sharp "
            "resonances.")]
    return []


def _closed_loop_findings(s: Spectrum, reference: bool) -> list[Finding]:
    if not s.feedback.significant or reference or s.mean.method == "periodic":
        return []
    return [Finding(
        "warning", "torque-in-feedback",
        f"The torque depends on the sensor: {100 * s.feedback.share:.2g} % of the "
        f"innovation variance of the torque is explained by {s.output}. Noise in the feedback biases "
        f"{s.mean.method} towards the negative inverse of the controller.",
        {"share": s.feedback.share, "p": s.feedback.p},
        "Log the reference (reference_speed, reference_angle or reference_torque) for the indirect estimate, or "
        "excite with a periodic multisine.")]


def _distortion_findings(s: Spectrum) -> list[Finding]:
    found = []
    if s.mean.method == "periodic" and not s.distortion and len(s.runs) < 2:
        found.append(Finding(
            "note", "distortion-not-separable",
            "The excitation fills every line of its band: the response includes "
                "all "
            "nonlinear distortion that repeats every period.", {"lines": len(s.mean.frequency)},
            "Excite odd lines only, some of them left out, or record several runs with other phases."))
    for d in s.distortion:
        if d.below_signal_db is None:
            continue
        what = ("friction that depends on the direction, or a gap on one side" if d.kind == "even"
                else "Coulomb friction, or backlash")
        found.append(Finding(
            "warning" if -d.below_signal_db > MAX_DISTORTION_DB else "note", "nonlinear-distortion",
            f"On {d.lines} unexcited {d.kind} lines the output is {d.below_signal_db:.0f} dB below the excited "
            f"ones, the noise {20 * np.log10(d.signal / max(d.noise, 1e-300)):.0f} dB below them: {d.kind} "
            "nonlinear distortion.",
            {"level": d.level, "noise": d.noise, "signal": d.signal, "lines": d.lines},
            f"Look for {what}; a linear model holds at this amplitude only."))
    total, noise = s.mean.total, s.mean.noise
    known = np.isfinite(total) & np.isfinite(noise)
    if s.mean.method == "periodic" and known.any() and np.median(total[known] / np.maximum(noise[known],
        1e-300)) > 4:
        ratio = float(np.median(total[known] / np.maximum(noise[known], 1e-300)))
        found.append(Finding(
            "note", "scatter-beyond-noise", f"Over the runs the response varies {np.sqrt(ratio):.1f} times more "
            "than noise explains: the drive is not linear, or changes between runs.", {"variance_ratio": ratio},
            "Weight the fit with the total variance; compare amplitudes."))
    return found


def _empty_line_findings(s: Spectrum) -> list[Finding]:
    step = np.diff(s.mean.frequency)
    if not len(step) or step.max() < 1.5 * step.min():
        return []
    return [Finding(
        "note", "excitation-gaps", f"Between {s.mean.frequency[0]:.4g} and {s.mean.frequency[-1]:.4g} Hz the "
        f"excitation leaves gaps of up to {step.max():.3g} Hz between excited lines; there is no estimate there.",
        {"largest_gap_hz": float(step.max()), "resolution_hz": float(step.min())})]


def pictures(s: Spectrum) -> tuple[PlotData, ...]:
    """Magnitude with band, phase, coherence."""
    m, curves = s.mean, {}
    std = np.sqrt(np.maximum(m.variance, 0.0) / 2.0)
    good = np.isfinite(std)
    size = np.abs(m.g)
    curves["magnitude"] = (m.frequency, size)
    if good.any():
        curves["band low"] = (m.frequency[good], np.maximum(size - 1.96 * std, 0.05 * size)[good])
        curves["band high"] = (m.frequency[good], (size + 1.96 * std)[good])
    for name, r in s.runs if 1 < len(s.runs) <= 8 else ():
        curves[f"run {name}"] = (r.frequency, np.abs(r.g))
    curves["phase"] = (m.frequency, np.degrees(np.angle(m.g)))
    curves["coherence"] = (m.frequency, m.coherence)
    title = f"{s.output.replace('_', ' ')} over {s.input.replace('_', ' ')}: {s.outcome}"
    return (PlotData("response", title, "frequency [Hz]", f"magnitude [{s.unit}]", curves),)
