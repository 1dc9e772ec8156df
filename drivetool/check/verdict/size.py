"""How large a cause is: its size parameter with its interval, and a torque in per cent of the motor's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.fit import Model
from drivetool.check.search import SelectedCauses
from drivetool.check.starts import largest_torque
from drivetool.identify.estimate import Estimate, Parameter
from drivetool.quantity import owner_of, quantity_of

MAX_DIGITS = 10  # digits: as many as the files have
SINE, COSINE = "_sine", "_cosine"


def sizes_of(found: SelectedCauses, estimate: Estimate, base: Model) -> dict[str, str]:
    """Cause -> 'load.coulomb 0.402 Nm (0.381 to 0.423, 95 %), 3.1 % of the largest torque'; without any, nothing.

    base  over the records, for the largest torque that the motor gives there
    """
    sizes = {}
    for code in found.causes:
        names, cause = set(found.added.get(code, ())), CAUSES[code]
        mine = [p for p in estimate.parameters if p.name in names and quantity_of(p.name) == cause.sizes[0]]
        words = [_size_text(_as_amplitude(p, estimate), base) for p in mine]
        if words:
            sizes[code] = " and ".join(words)
    return sizes


def _as_amplitude(p: Parameter, estimate: Estimate) -> Parameter:
    """A sine with its cosine as one amplitude, without interval where one of them has none; others unchanged."""
    if not p.name.endswith(SINE):
        return p
    name = p.name.removesuffix(SINE)
    other = next((o for o in estimate.parameters if o.name == name + COSINE), None)
    if other is None:
        return p
    size = float(np.hypot(p.value, other.value))
    has_intervals = p.ci95 is not None and other.ci95 is not None
    along = np.array([p.value, other.value]) / max(size, 1e-300)
    std = _std_along(estimate, (p.name, other.name), along) if has_intervals else None
    line = Parameter(name=name, value=size, unit=p.unit)
    return line if std is None else line.with_interval(std, (0.0, np.inf))


def _std_along(estimate: Estimate, names: Sequence[str], direction: np.ndarray) -> float | None:
    """Standard deviation of a combination of parameters, None where it has none."""
    known = estimate.covariance
    if known is None or not set(names) <= set(known.names):
        return None
    return float(np.sqrt(max(direction @ known.part(names).matrix @ direction, 0.0)))


def _size_text(p: Parameter, base: Model) -> str:
    """Name, value, unit, interval; of a torque its share, of a bandwidth its time constant."""
    name, value, ends, unit = p.name, p.value, p.ci95, p.unit
    if quantity_of(name) == "bandwidth" and value > 0.0:
        name, value, unit = f"the time constant of {name}", 1.0 / value, "s"
        ends = (1.0 / ends[1], 1.0 / ends[0]) if ends and ends[0] > 0.0 else None
    # As many digits as show the width of the interval with two, at most those that files have.
    ends = ends if ends and np.isfinite(ends[1] - ends[0]) and ends[1] > ends[0] else None
    digits = 3 if not ends else int(np.clip(
        2.0 + np.log10(max(abs(value), 1e-300) / (ends[1] - ends[0])), 3, MAX_DIGITS))
    interval = f" ({ends[0]:.{digits}g} to {ends[1]:.{digits}g}, 95 %)" if ends else ""
    largest = largest_torque(base, owner_of(p.name)) if p.unit == base.task.drive.torque_unit else 0.0
    share = f", {100.0 * abs(value) / largest:.2g} % of the largest torque" if largest > 0.0 else ""
    return f"{name} {value:.{digits}g} {unit}{interval}{share}"
