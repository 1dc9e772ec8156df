"""Faults of a shaft torque channel: zeros throughout, or an inverted sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadRecording
from drivetool.identify.plateaus import block_means
from drivetool.logs import Experiment

# Blocks of a recording over which torques are compared: slower than a resonance, above which a shaft torque opposes
# the motor's. An oscillation does not imitate a wrong sign at both lengths.
SHAFT_TORQUE_BLOCKS = (100, 25)
# Standard deviations of the share below zero. Of 104 simulated recordings with a right sign, under any law or load,
# none was below +0.9; with an inverted sign four in five are beyond five.
SHAFT_SIGN_SIGNIFICANCE = 5.0


def check_shaft_torque(experiments: Sequence[Experiment], drive: Drive) -> None:
    """Raise BadRecording where a logged shaft torque is zero throughout, or falls when the motor's rises.

    The motor torque, less what accelerates and brakes the motor, goes through the first shaft. At low frequency the
    shaft torque therefore rises with the motor torque, on every drive and under every load.
    """
    if not drive.shafts:
        return
    role = next((r for r in (f"{drive.shafts[0]}_torque", "shaft_torque")
                 if all(r in e.signals for e in experiments)), None)
    for e in experiments if role is not None else ():
        values = e.signals[role]
        if not np.nanmax(np.abs(values), initial=0.0) > 0.0:
            raise BadRecording(
                f"a {role} that was measured in {e.name}", "zeros throughout",
                "Leave it out of the channel map; or check the amplifier and its channel, and record again.")
        if "motor_torque" in e.magnitudes or "motor_torque" not in e.signals:
            continue
        shares = [shaft_torque_share(e, role, count) for count in SHAFT_TORQUE_BLOCKS]
        if all(s is not None and s[0] < -SHAFT_SIGN_SIGNIFICANCE * s[1] for s in shares):
            raise BadRecording(
                f"a {role} in the direction of the motor torque in {e.name}",
                f"one in the opposite direction, by {-shares[0][0]:.2g} of the motor torque",
                f"Invert it with sign: -1 at {role} in the channel map.")


def shaft_torque_share(experiment: Experiment, role: str, count: int) -> tuple[float, float] | None:
    """(share of the motor torque that a shaft torque follows it by, its std), by means over a recording's blocks.

    returns  None where the motor torque hardly changes from block to block
    """
    length = max(1, experiment.used // count)
    rows = []
    for a, b in experiment.segments:
        speed = experiment.signals.get("motor_speed", np.zeros(experiment.size))[a:b]
        rows.append(np.column_stack([block_means(x, length) for x in (
            experiment.signals[role][a:b], experiment.signals["motor_torque"][a:b], speed, np.sign(speed))]))
    table = np.concatenate(rows)
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < count // 2:
        return None
    size = np.abs(table).max(axis=0)
    size[size == 0.0] = 1.0
    table = table / size
    columns = np.column_stack([table[:, 1:], np.ones(len(table))])
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-9)
    found = inverse @ (columns.T @ table[:, 0])
    left = table[:, 0] - columns @ found
    std = float(np.sqrt(max(inverse[0, 0], 0.0) * np.sum(left**2) / max(len(left) - 4, 1)))
    scale = float(size[0] / size[1])
    return (float(found[0]) * scale, std * scale) if inverse[0, 0] > 0.0 else None
