"""Records of simulated machines: exact in every event, sampled like a drive's logger.

The torque is held over each sample. The controller sees the sensor, not the truth.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from tests.simulator.laws import Laws
from tests.simulator.linear import LinearRun, simulate_linear
from tests.simulator.machine import Machine, State, at_rest
from tests.simulator.stepper import Stepper

__all__ = ["LinearRun", "Sensor", "Trajectory", "quantise", "simulate", "simulate_linear"]


class Controller(Protocol):
    """Anything that makes a torque from the sensor's value, once per sample, in order."""

    def torque(self, i: int, measured: float) -> float:
        """Torque command [Nm] for sample i."""


@dataclass(frozen=True)
class Sensor:
    """What the logger and the controller see of body 0.

    quantity    "speed" [rad/s] or "angle" [rad]
    noise       (n,) added before the quantiser, or None
    resolution  of the quantiser, in the quantity's unit; zero is none
    """

    quantity: Literal["speed", "angle"] = "speed"
    noise: np.ndarray | None = None
    resolution: float = 0.0

    def read(self, i: int, speed: float, angle: float) -> float:
        """The value of sample i."""
        value = speed if self.quantity == "speed" else angle
        if self.noise is not None:
            value = value + float(self.noise[i])
        return float(quantise(value, self.resolution)) if self.resolution else value


@dataclass(frozen=True)
class Trajectory:
    """What happened, at the n sample instants.

    time            (n,) [s]
    speeds, angles  (n, bodies) [rad/s], [rad]
    shaft_torques   (n, bodies-1) [Nm]
    command         (n,) [Nm] torque command, held over the sample that follows
    applied         (n,) [Nm] torque on body 0 just after the instant: behind dead time and
                    converter, with the torque noise
    measured        (n,) what the sensor gave
    contact         (n, bodies-1) +1, 0 in the gap, -1; without a gap the sign of the torque
    stuck           (n, bodies) held by Coulomb friction
    events          counts of contact_made, contact_lost, stuck, released, reversed
    end             state one sample after the last instant
    """

    time: np.ndarray
    speeds: np.ndarray
    angles: np.ndarray
    shaft_torques: np.ndarray
    command: np.ndarray
    applied: np.ndarray
    measured: np.ndarray
    contact: np.ndarray
    stuck: np.ndarray
    events: Counter[str]
    end: State


def quantise(values, resolution: float):
    """Values as whole counts of the resolution; decimal resolutions give short decimals."""
    return np.rint(np.divide(values, resolution)) / (1.0 / resolution)


def simulate(
    machine: Machine,
    torque: np.ndarray,
    step: float,
    start: State | None = None,
    controller: Controller | None = None,
    torque_noise: np.ndarray | None = None,
    load_torque: np.ndarray | None = None,
    sensor: Sensor | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-13,
) -> Trajectory:
    """One record of a machine.

    torque        (n,) command [Nm]; a controller's output is added to it
    step          sample interval [s]
    start         at rest and without twist if None
    torque_noise  (n,) [Nm] held over each sample, added on body 0 behind the converter
    load_torque   (n,) [Nm] held over each sample, opposes the last body
    sensor        noise-free speed of body 0 if None
    returns       Trajectory
    """
    start, sensor = start or at_rest(machine), sensor or Sensor()
    torque = np.asarray(torque, float)
    noise, load = (np.zeros_like(torque) if a is None else np.asarray(a, float)
                   for a in (torque_noise, load_torque))
    laws = Laws(machine)
    stepper = Stepper(laws, rtol, atol)
    y, angle = _vector(machine, start), start.angle
    laws.begin(y.tolist())
    commands, rows = [], []
    for i, (command, disturbance, load_now) in enumerate(
            zip(torque.tolist(), noise.tolist(), load.tolist(), strict=True)):
        measured = sensor.read(i, float(y[laws.filtered or 0]), angle)
        if controller is not None:
            command += controller.torque(i, measured)
        commands.append(command)
        laws.disturbance, laws.turned = disturbance, angle
        if laws.clock is not None:
            y[laws.clock] = i * step
        pieces = _split_at_load_step(_pieces(commands, machine.dead_time, step, start.torque), machine, i * step)
        laws.command, laws.load = pieces[0][1], load_now + pieces[0][2]
        laws.settle(y)
        rows.append(_row(laws, y.tolist(), angle, measured))
        for length, laws.command, stepped in pieces:
            laws.load = load_now + stepped
            y = stepper.advance(y, length)
        angle += float(y[2 * machine.bodies - 1])
        y[2 * machine.bodies - 1] = 0.0
    return _trajectory(machine, rows, commands, step, laws, _state(machine, y, angle, laws))


def _pieces(commands: list[float], dead_time: float, step: float, before: float):
    """[(length, command)] of the sample after the last command, as they leave the dead time."""
    whole, rest = split_dead_time(dead_time, step)
    late = commands[-1 - whole] if whole < len(commands) else before
    if rest == 0.0:
        return [(step, late)]
    later = commands[-2 - whole] if whole + 1 < len(commands) else before
    return [(rest, later), (step - rest, late)]


def _split_at_load_step(pieces, machine: Machine, start_time: float):
    """[(length, command, stepped load)]: the piece in which the load steps is cut in two."""
    (torque, when), found = machine.effects.load_step, []
    for length, command in pieces:
        before = min(max(when - start_time, 0.0), length)
        if torque and 0.0 < before < length:
            found.append((before, command, 0.0))
        after = length - before if 0.0 < before < length else length
        found.append((after, command, torque if torque and before < length else 0.0))
        start_time += length
    return found


def split_dead_time(dead_time: float, step: float) -> tuple[int, float]:
    """Whole samples and the remaining seconds; a rounding error is not a remainder."""
    whole = int(np.floor(dead_time / step + 1e-9))
    rest = dead_time - whole * step
    return whole, (rest if rest > 1e-9 * step else 0.0)


def _vector(machine: Machine, start: State) -> np.ndarray:
    converter = [start.torque, start.torque_rate] if machine.converter_bandwidth is not None else []
    effects = machine.effects
    extra = [start.speeds[0]] * (effects.filter_time > 0) + [0.0] * bool(effects.drift[0])
    s0, bent = effects.of("lugre_stiffness", machine.bodies), start.bristles or (0.0,) * machine.bodies
    bristles = [s0[i] * bent[i] for i in machine.lugre]
    places = [start.places_in(machine)[k] for k in machine.places]
    return np.array([*start.speeds, *start.twists, 0.0, *converter, *extra, *bristles, *places], float)


def _state(machine: Machine, y: np.ndarray, angle: float, laws: Laws) -> State:
    n, x = machine.bodies, y.tolist()
    torque, rate = x[2 * n:2 * n + 2] if laws.converter else (laws.command, 0.0)
    bristles = tuple(x[laws.bristle[i]] / laws.body[i].lugre_stiffness if i in laws.bristle else 0.0
                     for i in range(n)) if laws.bristle else ()
    end = State(tuple(x[:n]), tuple(x[n:2 * n - 1]), angle, torque, rate, bristles)
    if not laws.place:
        return end
    places = (x[laws.place[k]] if k in laws.place else b for k, b in enumerate(end.places_in(machine)))
    return replace(end, places=tuple(places))


def _row(laws: Laws, x: list[float], angle: float, measured: float) -> list[float]:
    """All that is kept of one instant, in one flat list."""
    n = laws.n
    torques = laws.shaft_torques(x)
    contact = [float(laws.contact[k]) if k in laws.gapped else (t > 0) - (t < 0.0)
               for k, t in enumerate(torques)]
    stuck = [i in laws.direction_dependent and laws.slip[i] == 0 for i in range(n)]
    applied = (x[2 * n] if laws.converter else laws.command) + laws.disturbance
    return [*x[:2 * n - 1], *torques, *contact, *stuck, angle, applied, measured]


def _trajectory(machine, rows, commands, step, laws, end) -> Trajectory:
    n, table = machine.bodies, np.array(rows, float)
    widths = (n, n - 1, n - 1, n - 1, n)
    speeds, twists, torques, contact, stuck, rest = np.split(table, np.cumsum(widths), axis=1)
    angles = np.empty_like(speeds)
    angles[:, 0] = rest[:, 0]
    for k, ratio in enumerate(machine.ratio):
        angles[:, k + 1] = angles[:, k] / ratio - twists[:, k]
    return Trajectory(
        np.arange(len(rows)) * step, speeds, angles, torques, np.array(commands), rest[:, 1],
        rest[:, 2], contact.astype(np.int8), stuck.astype(bool), +laws.events, end)
