"""Does the tuned loop hunt? The nonlinear drive is kicked and watched until it is quiet or is not.

To a swing, a gap is a shaft of some stiffness between zero and its own, the softer the smaller the
swing. A loop that is stable with its contact closed may be unstable for one of them; it then cycles
with the swing whose stiffness is just stable. With no torque in the shaft nothing else keeps the
contact closed, so that is where it is looked for first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import MOTOR, Assembly, Layout
from drivetool.drive.simulation import Plant
from drivetool.tune.simulation.nonlinear import closed_loop, has_gap, is_nonlinear, moving, run
from drivetool.tune.speed_loop import Loop, Settings, build, speeds_of

KICKS, MIDDLE = (10.0, 3.0, 1.0, 0.3), 2  # in gaps per radian of the lowest resonance
TIMES, MORE = 25, 5  # watched, in units of the slowest time of the loop; and how often that is doubled
CHUNK, MOST = 20000, 400000  # samples simulated at a time, and in all
STEADY = 0.98  # of the swing that is left from one part of a stretch to its last, in a cycle
FREE = "shaft without torque, moving"
SOFT = np.geomspace(1e-3, 1.0, 61)  # shares of the stiffness at which the linear loop is looked at
WORTH = 1e-2  # least swing of a cycle, in gaps per radian of the lowest resonance


@dataclass(frozen=True)
class Cycle:
    """What the loop did after the kicks, in one state of load.

    situation   in words
    hunts       whether a cycle remained after some kick
    amplitude   of the motor speed about its mean [speed]; frequency [Hz]; of the largest cycle
    load_swing  amplitude of the load speed; torque_swing: of the first motor's torque
    kick        change of the load's speed that started it [speed]
    """

    situation: str
    hunts: bool
    amplitude: float = 0.0
    frequency: float = 0.0
    load_swing: float = 0.0
    torque_swing: float = 0.0
    kick: float = 0.0


@dataclass(frozen=True)
class Watch:
    """A situation with what followed its kick, for a picture; all (n,), time [s]."""

    cycle: Cycle
    time: np.ndarray
    motor_speed: np.ndarray
    load_speed: np.ndarray
    motor_torque: np.ndarray
    twist: np.ndarray


def watch(loop: Loop, settings: Settings) -> tuple[Watch, ...]:
    """Every situation in which the nonlinear drive could hunt; empty if it is linear or has no shaft.

    mimo loops with a gap are left out: their second motor listens to a torque that the gap changes
    """
    if not is_nonlinear(loop.drive) or not loop.drive.shafts:
        return ()
    if loop.wiring.configuration == "mimo" and has_gap(loop.drive):
        return ()
    unit, idle, still = _unit(loop), idle_load(loop), loop.at(0.0)
    speed = loop.wiring.speed or 200.0 * unit
    free = -idle - _viscous(loop) * speed / loop.drive.turns()[-1]
    situations = [(loop, FREE, speed, free)]
    if idle:
        situations.append((loop, "no load torque but the idle torque, moving", speed, 0.0))
    if any((still.drive.value(f"{b}.coulomb") or 0.0) for b in still.drive.bodies):
        situations.append((still, "at standstill", 0.0, 0.0))
    return tuple(_situation(own, settings, name, at, load, unit) for own, name, at, load in situations)


def idle_load(loop: Loop) -> float:
    """Constant torque in the last shaft when the load turns at the working point with no load torque."""
    plain = Assembly(loop.drive, Layout((), (MOTOR,), (), 1.0, gradient=False))
    last = len(loop.drive.bodies) - 1
    coulomb = loop.drive.value(f"{loop.drive.bodies[-1]}.coulomb") or 0.0
    return float(plain.of_body(last, "idle_torque").v + np.copysign(coulomb, loop.wiring.speed))


def _unit(loop: Loop) -> float:
    """One gap per radian of the lowest resonance; without a gap, the twist that the idle torque makes."""
    drive = loop.drive
    slow, _ = speeds_of(drive, loop.wiring)
    gaps = [drive.value(f"{s}.half_gap") or 0.0 for s in drive.shafts]
    twists = [(drive.value(f"{b}.coulomb") or 0.0) / drive.value(f"{s}.stiffness")
              for b in drive.bodies for s in drive.shafts]
    return slow * (max(gaps) if max(gaps) > 0.0 else max(max(twists), 1e-9))


def _situation(loop: Loop, settings: Settings, name: str, speed: float, load: float, unit: float) -> Watch:
    """Kick ever softer until a cycle remains; without one, show a kick of middle size."""
    found = []
    for size in KICKS:
        found.append(_kicked(loop, settings, name, speed, load, unit, size))
        if found[-1].cycle.hunts:
            return found[-1]
    return found[MIDDLE]


def _viscous(loop: Loop) -> float:
    """Viscous friction of the last body, which at speed also loads the shaft."""
    plain = Assembly(loop.drive, Layout((), (MOTOR,), (), 1.0, gradient=False))
    return float(plain.of_body(len(loop.drive.bodies) - 1, "viscous").v)


def _kicked(loop: Loop, settings: Settings, name: str, speed: float, load: float, unit: float,
            size: float) -> Watch:
    """One kick of the load's speed, watched longer while the swing neither stays nor dies."""
    rates, (slowest, _) = np.linalg.eigvals(loop.matrix(settings)), speeds_of(loop.drive, loop.wiring)
    length = TIMES * max(-1.0 / rates.real.max(), 1.0 / slowest, settings.integral_time)
    step = 0.3 / np.abs(rates).max()  # events are located inside a sample, but few of them in each
    state = moving(loop, settings, speed, load)
    state[len(loop.drive.bodies) - 1] += size * unit
    plant, rows = closed_loop(loop, settings, step), _rows(loop, settings)
    first, hunts, done = None, False, 0
    for _ in range(MORE):
        count = int(np.clip(length / step, 2000, max(2000, MOST - done)))
        traces, state = _chunks(plant, np.array([speed, load]), state, step, count, rows)
        first, done, length = traces if first is None else first, done + count, 2.0 * length
        verdict = _verdict(traces[:, 0], WORTH * unit)
        hunts = verdict == "cycle"
        if verdict != "open" or done >= MOST:
            break
    tail = traces[len(traces) // 3:]
    swing = np.ptp(tail, axis=0) / 2.0
    frequency = _frequency(tail[:, 0], step)
    cycle = Cycle(name, True, float(swing[0]), frequency, float(swing[1]), float(swing[2]),
                  size * unit) if hunts else Cycle(name, False, kick=size * unit)
    shown = 15.0 / frequency if hunts and frequency else 8.0 / -rates.real.max()
    shown = first[:max(200, int(shown / step))]
    ahead = loop.direct * loop.of_reference(loop.wiring.motors[0], settings) * speed
    shown = shown + np.array([0.0, 0.0, ahead, 0.0])
    return Watch(cycle, np.arange(len(shown)) * step, *shown.T)


def _rows(loop: Loop, settings: Settings) -> np.ndarray:
    """(4, n) motor speed, load speed, torque of the first motor, twist of the last shaft."""
    nb, n = len(loop.drive.bodies), len(loop.a)
    one = [np.array([v]) for v in (settings.gain, settings.integral_time, settings.second)]
    torque = loop.outputs([f"{loop.wiring.motors[0]}_torque"], *one)[0, 0]
    return np.vstack([np.eye(n)[0], np.eye(n)[nb - 1], torque, np.eye(n)[2 * nb - 2]])


def _chunks(plant: Plant, inputs: np.ndarray, state: np.ndarray, step: float, count: int,
            rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((n, 4) signals under constant inputs, last state), a chunk of states in memory at a time."""
    parts = []
    while count > 0:
        _, states = run(plant, np.tile(inputs, (min(CHUNK, count) + 1, 1)), state, step)
        parts.append(states[:-1] @ rows.T)
        state, count = states[-1], count - CHUNK
    return np.concatenate(parts), state


def _verdict(speed: np.ndarray, worth: float) -> str:
    """quiet, cycle, or open: still changing, or too few periods to tell."""
    parts = np.array_split(speed, 3)
    swing = [np.ptp(part) for part in parts]
    if swing[-1] < worth:
        return "quiet"
    if min(len(_passages(part)) for part in parts) < 5 or swing[-1] < STEADY * max(swing[:2]):
        return "open"
    return "cycle" if swing[-1] <= max(swing[:2]) / STEADY or not np.isfinite(swing[-1]) else "open"


def _passages(speed: np.ndarray) -> np.ndarray:
    """Where a signal rises through its middle, in samples, interpolated."""
    x = speed - 0.5 * (speed.max() + speed.min())
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return up + x[up] / (x[up] - x[up + 1])


def _frequency(speed: np.ndarray, step: float) -> float:
    """Of a periodic signal [Hz]; zero if it has no period."""
    at = _passages(speed)
    return float((len(at) - 1) / ((at[-1] - at[0]) * step)) if len(at) > 1 else 0.0


def safe_gain(loop: Loop, settings: Settings) -> float | None:
    """Largest gain, at this integral time, whose loop is stable at every stiffness up to the shaft's own.

    returns  None if the gain is below it
    source   describing function of a dead zone, which lies between 0 and the stiffness: Gelb, Vander
             Velde 1968
    """
    if _stable_when_soft(loop, settings):
        return None
    low, high = 1e-3 * settings.gain, settings.gain
    if not _stable_when_soft(loop, replace(settings, gain=low)):
        return 0.0
    while high > low * 1.002:
        middle = float(np.sqrt(low * high))
        if _stable_when_soft(loop, replace(settings, gain=middle)):
            low = middle
        else:
            high = middle
    return low


def _stable_when_soft(loop: Loop, settings: Settings) -> bool:
    """Whether the closed loop is stable with every shaft that has a gap as soft as the gap can make it."""
    gaps = [s for s in loop.drive.shafts if (loop.drive.value(f"{s}.half_gap") or 0.0) > 0.0]
    for share in SOFT:
        soft = {f"{s}.{k}": share * loop.drive.value(f"{s}.{k}") for s in gaps for k in ("stiffness", "damping")}
        matrix = build(loop.drive.with_values(soft), loop.wiring).matrix(settings)
        if np.linalg.eigvals(matrix).real.max() >= 0.0:
            return False
    return True
