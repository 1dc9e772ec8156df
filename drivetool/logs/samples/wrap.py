"""Counters that start again, negative numbers read as unsigned: undone where the map says so, else pointed out."""

from __future__ import annotations

import numpy as np

from drivetool.errors import Finding

# A step of more than this share of the range cannot be told from one the other way round.
UNSURE = 0.4
# Digits of the registers that values of a drive come from.
REGISTERS = (8, 10, 12, 14, 16, 24, 32)
# Jumps over most of a range, as a share of it; and of the ordinary steps, by which a value goes on behind one. A
# command that goes to the ends of its range on purpose rests there, and comes back over the same way.
OVER, ORDINARY = 0.8, 3.0


def unwrap(values: np.ndarray, wrap: float, role: str) -> tuple[np.ndarray, list[Finding]]:
    """The values without the jumps at which the counter starts again.

    values   (n,) raw, NaN where missing; wrap: the range of the counter, in the same unit
    returns  (n,) continuous, findings. Taken is the shorter way round from sample to sample; what is no angle
             has a zero of its own, and the half of its values lies nearest to it
    """
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known])
    turns = np.round(steps / abs(wrap))
    unwrapped = values.copy()
    unwrapped[known[1:]] -= abs(wrap) * np.cumsum(turns)
    if not role.endswith("_angle") and len(known):
        unwrapped -= abs(wrap) * np.round(np.median(unwrapped[known]) / abs(wrap))
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


def looks_unsigned(values: np.ndarray, role: str) -> list[Finding]:
    """A warning if whole numbers jump over the range of a register, and go on smoothly behind each jump.

    values  (n,) raw, NaN where missing
    """
    values = values[np.isfinite(values)]
    if len(values) < 20 or np.any(values != np.round(values)):
        return []
    least, most = float(values.min()), float(values.max())
    bits = next((n for n in REGISTERS if (least >= 0 and most < 2**n)
                 or (least >= -(2 ** (n - 1)) and most < 2 ** (n - 1))), None)
    if bits is None:
        return []
    size = 2.0**bits
    steps = np.diff(values)
    jumps = np.abs(steps) > OVER * size
    usual = np.abs(steps[~jumps])
    if not jumps.any() or not usual.any():
        return []
    # Behind a jump the value goes on as if there were none.
    rest = np.abs(steps[jumps] - np.sign(steps[jumps]) * size)
    if np.median(rest) > ORDINARY * max(np.quantile(usual, 0.9), 1.0):
        return []
    return [Finding(
        "warning", "value-wraps",
        f"{role} jumps {int(jumps.sum())} times by about {size:g}, the range of {bits} bits, as a negative number "
        "does that is read as unsigned, or a counter that starts again; nothing was undone.",
        {"role": role, "jumps": int(jumps.sum()), "size": size},
        f"Set `wrap: {size:.0f}` for it in the channel map.")]
