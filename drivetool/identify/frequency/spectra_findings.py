"""What a measured frequency response shows, and what stands against believing it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import find_peaks

from drivetool.errors import Finding
from drivetool.identify.estimate import Exhibit
from drivetool.identify.frequency.frf import Response
from drivetool.identify.frequency.spectrum import Spectrum

POOR = 0.5  # coherence below which a line says little
LOUD = -40.0  # dB of distortion below the signal from which it is a warning
MOST = 12  # peaks listed
PROMINENT = np.log(10.0 ** (3.0 / 20.0))  # 3 dB


def peaks_of(r: Response) -> tuple[Mapping[str, object], ...]:
    """Resonances and anti-resonances that stand out by 3 dB and by four standard deviations.

    returns  kind, hz (of the line), magnitude, and resolution_hz, the distance of the lines
    """
    level = np.log(np.maximum(np.abs(r.g), 1e-300))
    spread = np.sqrt(np.maximum(r.variance, 0.0) / 2.0) / np.maximum(np.abs(r.g), 1e-300)
    found = []
    for kind, sign in (("resonance", 1.0), ("anti-resonance", -1.0)):
        for i, size in zip(*(lambda p: (p[0], p[1]["prominences"]))(
                find_peaks(sign * level, prominence=PROMINENT)), strict=True):
            doubt = spread[i] if np.isfinite(spread[i]) else 0.0
            if size < 4.0 * doubt or r.coherence[max(0, i - 1): i + 2].min() < POOR:
                continue
            gap = float(r.frequency[i + 1] - r.frequency[i - 1]) / 2.0
            found.append({"kind": kind, "hz": float(r.frequency[i]), "magnitude": float(np.abs(r.g[i])),
                          "resolution_hz": gap, "prominence_db": float(20.0 * size / np.log(10.0))})
    strongest = sorted(found, key=lambda p: -p["prominence_db"])[:MOST]
    return tuple(sorted(strongest, key=lambda p: p["hz"]))


def findings_of(s: Spectrum, reference: bool) -> tuple[Finding, ...]:
    """In the order of their weight."""
    return (*_coherence(s), *_loop(s, reference), *_distortion(s), *_empty(s))


def _coherence(s: Spectrum) -> list[Finding]:
    poor = float(np.mean(s.mean.coherence < POOR))
    evidence = {"share_of_lines": poor, "largest_coherence": float(s.mean.coherence.max())}
    if poor == 1.0:
        return [Finding(
            "failure", "incoherent", f"The coherence of {s.input} and {s.output} is below {POOR} at every line: "
            "the response shown is not one.", evidence,
            "Check the channels and their clocks, excite more, or record longer.")]
    if poor > 0.1:
        good = s.mean.frequency[s.mean.coherence >= POOR]
        return [Finding(
            "warning", "low-coherence", f"The coherence is below {POOR} at {100 * poor:.0f} % of the lines; "
            f"those above lie between {good[0]:.4g} and {good[-1]:.4g} Hz.", evidence,
            "Read only the lines above; excite the others more, or lengthen the frames for sharp resonances.")]
    return []


def _loop(s: Spectrum, reference: bool) -> list[Finding]:
    if not s.feedback.there or reference or s.mean.method == "periodic":
        return []
    return [Finding(
        "warning", "closed-loop", f"The torque answers the sensor: {100 * s.feedback.share:.2g} % of what its own "
        f"past does not foretell comes from {s.output}. Noise that is fed back pulls {s.mean.method} towards the "
        "negative inverse of the controller.", {"share": s.feedback.share, "p": s.feedback.p},
        "Log the reference (reference_speed, reference_angle or reference_torque) for the indirect estimate, or "
        "excite with a periodic multisine.")]


def _distortion(s: Spectrum) -> list[Finding]:
    found = []
    if s.mean.method == "periodic" and not s.distortion and len(s.runs) < 2:
        found.append(Finding(
            "note", "distortion-hidden", "The excitation fills every line of its band: what repeats every period "
                "is "
            "taken for the response, nonlinear distortion too.", {"lines": len(s.mean.frequency)},
            "Excite odd lines only, some of them left out, or record several runs with other phases."))
    for d in s.distortion:
        if not d.seen or d.below_signal_db is None:
            continue
        what = ("friction that depends on the direction, or a gap on one side" if d.kind == "even"
                else "Coulomb friction, or backlash")
        found.append(Finding(
            "warning" if -d.below_signal_db > LOUD else "note", f"{d.kind}-distortion",
            f"On {d.lines} empty {d.kind} lines the output is {d.below_signal_db:.0f} dB below the excited ones, "
            f"noise {20 * np.log10(d.signal / max(d.noise, 1e-300)):.0f} dB: {d.kind} nonlinear distortion.",
            {"level": d.level, "noise": d.noise, "signal": d.signal, "lines": d.lines},
            f"Look for {what}; a linear model holds at this amplitude only."))
    total, noise = s.mean.total, s.mean.noise
    known = np.isfinite(total) & np.isfinite(noise)
    if s.mean.method == "periodic" and known.any() and np.median(total[known] / np.maximum(noise[known],
        1e-300)) > 4:
        ratio = float(np.median(total[known] / np.maximum(noise[known], 1e-300)))
        found.append(Finding(
            "note", "distortion-over-runs", f"Over the runs the response varies {np.sqrt(ratio):.1f} times more "
                "than "
            "noise makes it: the drive is not linear, or not the same each time.", {"variance_ratio": ratio},
            "Weigh with the total variance; compare amplitudes."))
    return found


def _empty(s: Spectrum) -> list[Finding]:
    step = np.diff(s.mean.frequency)
    if not len(step) or step.max() < 1.5 * step.min():
        return []
    return [Finding(
        "note", "empty-lines", f"Between {s.mean.frequency[0]:.4g} and {s.mean.frequency[-1]:.4g} Hz the "
            "excitation "
        f"leaves lines empty, up to {step.max():.3g} Hz wide; nothing is said there.",
        {"largest_gap_hz": float(step.max()), "resolution_hz": float(step.min())})]


def pictures(s: Spectrum) -> tuple[Exhibit, ...]:
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
    return (Exhibit("response", title, "frequency [Hz]", f"magnitude [{s.unit}]", curves),)
