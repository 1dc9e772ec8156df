"""Encoders that start again from zero: undone where the map says so, pointed out where it does not."""

from __future__ import annotations

import numpy as np

from drivetool.errors import Finding

# A step of more than this share of the range cannot be told from one the other way round.
UNSURE = 0.4


def unwrap(values: np.ndarray, wrap: float, role: str) -> tuple[np.ndarray, list[Finding]]:
    """The values without the jumps at which the counter starts again.

    values   (n,) raw, NaN where missing; wrap: the range of the counter, in the same unit
    returns  (n,) continuous, findings. Taken is the shorter way round from sample to sample
    """
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known])
    turns = np.round(steps / abs(wrap))
    unwrapped = values.copy()
    unwrapped[known[1:]] -= abs(wrap) * np.cumsum(turns)
    unsure = int(np.sum(np.abs(steps - abs(wrap) * turns) > UNSURE * abs(wrap)))
    findings = []
    if unsure:
        findings.append(Finding(
            "warning", "wrap-unsure", f"{role} moves by more than {UNSURE:g} of its range of {wrap:g} between "
            f"neighbouring samples at {unsure} places; the way round is a guess there.",
            {"role": role, "samples": unsure}, "Record it faster, or correct `wrap` in the channel map."))
    return unwrapped, findings


def looks_wrapped(values: np.ndarray, role: str, unit: str) -> list[Finding]:
    """A warning if an angle jumps back over its range whenever it gets to an end.

    values  (n,) in `unit`, NaN where missing
    """
    values = values[np.isfinite(values)]
    if len(values) < 20:
        return []
    steps = np.diff(values)
    span = np.ptp(values)
    jumps = np.flatnonzero(np.abs(steps) > 0.8 * span)
    usual = np.median(np.abs(steps))
    if not len(jumps) or usual == 0 or usual > 0.1 * span:
        return []
    # Before and after a wrap the angle goes the other way than the jump; an outlier comes back at once.
    before, after = steps[np.maximum(jumps - 1, 0)], steps[np.minimum(jumps + 1, len(steps) - 1)]
    against = np.mean((np.sign(before) == -np.sign(steps[jumps])) & (np.abs(after) < 0.5 * span))
    if against < 0.8:
        return []
    size = float(np.median(np.abs(steps[jumps]))) + float(usual)
    return [Finding(
        "warning", "angle-wraps", f"{role} jumps by about {size:.4g} {unit} {len(jumps)} times, as a counter does "
        "that starts again; nothing was undone.", {"role": role, "jumps": len(jumps), "size": size},
        "Set `wrap:` for it in the channel map.")]
