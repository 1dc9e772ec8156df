"""Limit cycles of the tuned loop: the nonlinear drive is simulated after a kick until the swing decays or stays.

For an oscillation, a gap reduces the shaft stiffness to an effective value between zero and its own, the
lower the smaller the swing. A loop that is stable with closed contact may be unstable for one of these values.
It then has a limit cycle with the swing whose stiffness is just stable. Without torque in the shaft nothing keeps
the contact closed, so this case is simulated first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import MOTOR_TORQUE, Assembly, Layout
from drivetool.drive.simulation import Plant
from drivetool.quantity import name_of
from drivetool.tune.simulation.nonlinear import closed_loop, has_gap, is_nonlinear, simulate_loop, steady_state
from drivetool.tune.simulation.sections import HuntingSection
from drivetool.tune.speed_loop import Loop, Settings, build, rate_range, steady_torques

# In gaps per radian of the lowest resonance: a kick of 1 moves the load through about one gap. Sizes over 1.5
# decades, as some kicks may not reach a cycle. The index is that of the kick shown without a cycle.
KICK_SIZES, DEFAULT_KICK = (10.0, 3.0, 1.0, 0.3), 2
# Simulated time in slowest time constants of the loop, and how often it is extended, each time to the double. After
# 25 of them a linear swing is below 1e-10. A choice: further extensions cost time for loops near their limit.
WATCHED_TIME_CONSTANTS, MAX_EXTENSIONS = 25, 5
CHUNK_SAMPLES, MAX_SIMULATED_SAMPLES = 20000, 400000  # at a time (memory) and in all (computing time). A choice.
# Smallest ratio of the last swing to that before, in a cycle. A choice: sampling changes the swing slightly.
STEADY_SWING_RATIO = 0.98
NO_SHAFT_TORQUE = "shaft without torque, moving"
STIFFNESS_SHARES = np.geomspace(1e-3, 1.0, 61)  # of the stiffness, 20 a decade, for tests of the linear loop
MIN_CYCLE_SWING = 1e-2  # of a cycle, in gaps per radian of the lowest resonance. A choice: 1 % of a gap.


class DisturbanceResponse(HuntingSection):
    """A load state with the response to its kick, for a picture; all (n,), time [s]."""

    time: np.ndarray
    motor_speed: np.ndarray
    load_speed: np.ndarray
    motor_torque: np.ndarray
    twist: np.ndarray


def disturbance_responses(loop: Loop, settings: Settings) -> tuple[DisturbanceResponse, ...]:
    """The responses in every load state with a possible limit cycle; empty for a linear drive or one body.

    mimo loops with a gap are left out: the gap changes the torque to which their second motor responds
    """
    if not is_nonlinear(loop.drive) or not loop.drive.shafts:
        return ()
    if loop.wiring.configuration == "mimo" and has_gap(loop.drive):
        return ()
    kick_unit, at_standstill = _kick_unit(loop), loop.at(0.0)
    # The constant torque in the last shaft when the load turns at the working point with no load torque.
    idle = float(steady_torques(loop.drive, 0.0, 0.0, np.copysign(1.0, loop.wiring.speed))[0][-1])
    speed = loop.wiring.speed or 200.0 * kick_unit
    plain = Assembly(loop.drive, Layout((), (MOTOR_TORQUE,), (), 1.0, gradient=False))
    viscous = float(plain.of_body(len(loop.drive.bodies) - 1, "viscous").v)  # at speed it loads the shaft, too
    no_shaft_torque = -idle - viscous * speed / loop.drive.gear_ratios()[-1]
    situations = [(loop, NO_SHAFT_TORQUE, speed, no_shaft_torque)]
    if idle:
        situations.append((loop, "no load torque but the idle torque, moving", speed, 0.0))
    if any((at_standstill.drive.value(name_of(b, "coulomb")) or 0.0) for b in at_standstill.drive.bodies):
        situations.append((at_standstill, "at standstill", 0.0, 0.0))
    return tuple(_watch_situation(own, settings, name, at, load, kick_unit) for own, name, at, load in situations)


def _kick_unit(loop: Loop) -> float:
    """One gap per radian of the lowest resonance; without a gap, the twist by the Coulomb friction."""
    drive = loop.drive
    slow, _ = rate_range(drive, loop.wiring)
    gaps = [drive.value(name_of(s, "half_gap")) or 0.0 for s in drive.shafts]
    twists = [(drive.value(name_of(b, "coulomb")) or 0.0) / drive.value(name_of(s, "stiffness"))
              for b in drive.bodies for s in drive.shafts]
    return slow * (max(gaps) if max(gaps) > 0.0 else max(max(twists), 1e-9))


def _watch_situation(loop: Loop, settings: Settings, name: str, speed: float, load: float,
                     kick_unit: float) -> DisturbanceResponse:
    """Kicks of decreasing size until a cycle remains; without one, the response to the default kick."""
    found = []
    for size in KICK_SIZES:
        found.append(_simulate_disturbance(loop, settings, name, speed, load, kick_unit, size))
        if found[-1].hunts:
            return found[-1]
    return found[DEFAULT_KICK]


def _simulate_disturbance(loop: Loop, settings: Settings, name: str, speed: float, load: float, kick_unit: float,
                size: float) -> DisturbanceResponse:
    """The response to one kick of the load's speed, extended while the swing neither stays nor decays."""
    rates, (slowest, _) = np.linalg.eigvals(loop.matrix(settings)), rate_range(loop.drive, loop.wiring)
    length = WATCHED_TIME_CONSTANTS * max(-1.0 / rates.real.max(), 1.0 / slowest, settings.integral_time)
    step = 0.3 / np.abs(rates).max()  # events are located inside a sample, but only few per sample
    state = steady_state(loop, settings, speed, load)
    state[len(loop.drive.bodies) - 1] += size * kick_unit
    plant, rows = closed_loop(loop, settings, step), _signal_rows(loop, settings)
    first, hunts, simulated = None, False, 0
    for _ in range(MAX_EXTENSIONS):
        count = int(np.clip(length / step, 2000, max(2000, MAX_SIMULATED_SAMPLES - simulated)))
        traces, state = _simulate_in_chunks(plant, np.array([speed, load]), state, step, count, rows)
        first, simulated, length = traces if first is None else first, simulated + count, 2.0 * length
        verdict = _swing_verdict(traces[:, 0], MIN_CYCLE_SWING * kick_unit)
        hunts = verdict == "cycle"
        if verdict != "open" or simulated >= MAX_SIMULATED_SAMPLES:
            break
    tail = traces[len(traces) // 3:]
    swing = np.ptp(tail, axis=0) / 2.0
    frequency = _cycle_frequency(tail[:, 0], step)
    cycle = (float(swing[0]), frequency, float(swing[1]), float(swing[2])) if hunts else (0.0,) * 4
    segment = 15.0 / frequency if hunts and frequency else 8.0 / -rates.real.max()
    segment = first[:max(200, int(segment / step))]
    ahead = loop.direct * loop.reference_gain(loop.wiring.motors[0], settings) * speed
    segment = segment + np.array([0.0, 0.0, ahead, 0.0])
    return DisturbanceResponse(name, hunts, *cycle, size * kick_unit, np.arange(len(segment)) * step, *segment.T)


def _signal_rows(loop: Loop, settings: Settings) -> np.ndarray:
    """(4, n) motor speed, load speed, torque of the first motor, twist of the last shaft."""
    nb, states = len(loop.drive.bodies), np.eye(len(loop.a))
    return np.vstack([states[0], states[nb - 1], loop.torque_rows(settings)[0], states[2 * nb - 2]])


def _simulate_in_chunks(plant: Plant, inputs: np.ndarray, state: np.ndarray, step: float, count: int,
                        rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((n, 4) signals under constant inputs, last state), a chunk of states in memory at a time."""
    parts = []
    while count > 0:
        _, states = simulate_loop(plant, np.tile(inputs, (min(CHUNK_SAMPLES, count) + 1, 1)), state, step)
        parts.append(states[:-1, :rows.shape[1]] @ rows.T)
        state, count = states[-1], count - CHUNK_SAMPLES
    return np.concatenate(parts), state


def _swing_verdict(speed: np.ndarray, min_swing: float) -> str:
    """quiet, cycle, or open: still changing, or too few periods to decide."""
    parts = np.array_split(speed, 3)
    swing = [np.ptp(part) for part in parts]
    if swing[-1] < min_swing:
        return "quiet"
    if min(len(_upward_crossings(part)) for part in parts) < 5 or swing[-1] < STEADY_SWING_RATIO * max(swing[:2]):
        return "open"
    return "cycle" if swing[-1] <= max(swing[:2]) / STEADY_SWING_RATIO or not np.isfinite(swing[-1]) else "open"


def _upward_crossings(speed: np.ndarray) -> np.ndarray:
    """Where a signal rises through its middle, in samples, interpolated."""
    x = speed - 0.5 * (speed.max() + speed.min())
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return up + x[up] / (x[up] - x[up + 1])


def _cycle_frequency(speed: np.ndarray, step: float) -> float:
    """Of a periodic signal [Hz]; zero if it has no period."""
    at = _upward_crossings(speed)
    return float((len(at) - 1) / ((at[-1] - at[0]) * step)) if len(at) > 1 else 0.0


def safe_gain(loop: Loop, settings: Settings) -> float | None:
    """Largest gain, at this integral time, whose loop is stable at every stiffness up to that of the shaft.

    returns  None if the gain is below it
    source   describing function of a dead zone, which lies between 0 and the stiffness: Gelb, Vander
             Velde 1968
    """
    if _stable_at_all_stiffnesses(loop, settings):
        return None
    low, high = 1e-3 * settings.gain, settings.gain
    if not _stable_at_all_stiffnesses(loop, replace(settings, gain=low)):
        return 0.0
    while high > low * 1.002:
        middle = float(np.sqrt(low * high))
        if _stable_at_all_stiffnesses(loop, replace(settings, gain=middle)):
            low = middle
        else:
            high = middle
    return low


def _stable_at_all_stiffnesses(loop: Loop, settings: Settings) -> bool:
    """Whether the closed loop is stable at every effective stiffness of the shafts with a gap."""
    gaps = [s for s in loop.drive.shafts if (loop.drive.value(name_of(s, "half_gap")) or 0.0) > 0.0]
    for share in STIFFNESS_SHARES:
        soft = {f"{s}.{k}": share * loop.drive.value(f"{s}.{k}") for s in gaps for k in ("stiffness", "damping")}
        matrix = build(loop.drive.with_values(soft), loop.wiring).matrix(settings)
        if np.linalg.eigvals(matrix).real.max() >= 0.0:
            return False
    return True
