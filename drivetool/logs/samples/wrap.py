"""Counters that wrap, negative numbers read as unsigned: undone where the map says so, else reported."""

from __future__ import annotations

import numpy as np

from drivetool.finding import Finding

# A step of half the range is ambiguous in direction; a choice: from this share of the range on it is uncertain.
MAX_SURE_STEP = 0.4
# Widths [bit] of the registers that values of a drive come from.
REGISTER_BITS = (8, 10, 12, 14, 16, 24, 32)
# A wrap jumps over at least this share of the range. After it, the value continues by at most so many ordinary
# steps. A command that uses its whole range on purpose rests at the ends and returns the same way.
MIN_WRAP_JUMP, MAX_STEP_AFTER_WRAP = 0.8, 3.0


def unwrap(values: np.ndarray, wrap: float, role: str) -> tuple[np.ndarray, list[Finding]]:
    """The values without the jumps at which the counter starts again.

    values   (n,) raw, NaN where missing; wrap: the range of the counter, in the same unit
    returns  (n,) continuous, findings. The shorter way round is taken from sample to sample. A signal
             other than an angle has a physical zero: its median is put next to that
    """
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known])
    turns = np.round(steps / abs(wrap))
    unwrapped = values.copy()
    unwrapped[known[1:]] -= abs(wrap) * np.cumsum(turns)
    if not role.endswith("_angle") and len(known):
        unwrapped -= abs(wrap) * np.round(np.median(unwrapped[known]) / abs(wrap))
    unsure_count = int(np.sum(np.abs(steps - abs(wrap) * turns) > MAX_SURE_STEP * abs(wrap)))
    findings = []
    if unsure_count:
        findings.append(Finding(
            "warning", "wrap-ambiguous", f"{role} moves by more than {MAX_SURE_STEP:g} of its range of {wrap:g} "
            f"between neighbouring samples at {unsure_count} places; its direction of motion is ambiguous there.",
            {"role": role, "samples": unsure_count}, "Record it faster, or correct `wrap` in the channel map."))
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
    reversal_share = np.mean((np.sign(before) == -np.sign(steps[jumps])) & (np.abs(after) < 0.5 * span))
    if reversal_share < 0.8:
        return []
    size = float(np.median(np.abs(steps[jumps]))) + float(usual)
    return [Finding(
        "warning", "value-wraps", f"{role} jumps by about {size:.4g} {unit} {len(jumps)} times, as an overflowing "
        "counter does; the jumps are not corrected.", {"role": role, "jumps": len(jumps), "size": size},
        "Set `wrap:` for it in the channel map.")]


def looks_unsigned(values: np.ndarray, role: str) -> list[Finding]:
    """A warning if whole numbers jump over the range of a register, and continue smoothly after each jump.

    values  (n,) raw, NaN where missing
    """
    values = values[np.isfinite(values)]
    if len(values) < 20 or np.any(values != np.round(values)):
        return []
    least, most = float(values.min()), float(values.max())
    bits = next((n for n in REGISTER_BITS if (least >= 0 and most < 2**n)
                 or (least >= -(2 ** (n - 1)) and most < 2 ** (n - 1))), None)
    if bits is None:
        return []
    size = 2.0**bits
    steps = np.diff(values)
    jumps = np.abs(steps) > MIN_WRAP_JUMP * size
    usual = np.abs(steps[~jumps])
    if not jumps.any() or not usual.any():
        return []
    # After a jump the value continues as if there were none.
    rest = np.abs(steps[jumps] - np.sign(steps[jumps]) * size)
    if np.median(rest) > MAX_STEP_AFTER_WRAP * max(np.quantile(usual, 0.9), 1.0):
        return []
    return [Finding(
        "warning", "value-wraps",
        f"{role} jumps {int(jumps.sum())} times by about {size:g}, the range of {bits} bits: it is a negative "
        "number read as unsigned, or an overflowing counter. The jumps are not corrected.",
        {"role": role, "jumps": int(jumps.sum()), "size": size},
        f"Set `wrap: {size:.0f}` for it in the channel map.")]
