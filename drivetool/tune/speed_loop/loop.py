"""The speed loop around a drive: a state space that is affine in the controller's settings.

Deviations from steady running (see working_point.py), contact closed.
One motor: u = Kp (1 + 1/(s Ti)) (reference - speed).
Two motors on one chain (Tallfors 2005, ch. 4), controlled by the speed of the first:

    siso  one controller commands both
    miso  the second has its own, Kp2 = K Kp, Ti2 = K Ti; equal shares at rest
    mimo  the second gets a share of the torque measured in the last shaft; equal shares at rest
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import factorial
from typing import Literal

import numpy as np

from drivetool.drive import MOTOR_TORQUE, Drive, chain_alone, linear_drive, state_space
from drivetool.errors import BadParameters
from drivetool.quantity import name_of
from drivetool.tune.speed_loop.working_point import at_working_point

Configuration = Literal["siso", "miso", "mimo"]
DeadTimeForm = Literal["exact", "zero"]
StateSpace = tuple[np.ndarray, np.ndarray, np.ndarray, float]  # (A, b, c, d)
# Of the dead time in time responses; frequency responses are exact. A choice: accuracy of the phase at
# high frequencies against the number of states.
PADE_ORDER = 5
SHAFT_TORQUE_SHARE = 0.5  # of the shaft torque for the second motor: equal shares at rest (Tallfors 2005, ch. 4)


@dataclass(frozen=True)
class Wiring:
    """The connection of controller and drive.

    configuration  see the module
    motors         driven bodies; the speed of the first one is measured
    speed_filter   time constant of the controller's first-order filter of the speed [s], behind the
                   sensor's own (sensor.*)
    dead_time      "exact": e^(-s td); "zero": the printed 1 - s td/2 (Tallfors 2005, 2.3), which
                   is half the delay with a rising gain
    speed          of the first motor at the working point [drive's unit]; zero: slow, forward
    """

    configuration: Configuration = "siso"
    motors: tuple[str, ...] = ("motor",)
    speed_filter: float = 0.0
    dead_time: DeadTimeForm = "exact"
    speed: float = 0.0


@dataclass(frozen=True)
class Settings:
    """The settings entered at the converter.

    gain           Kp [torque/speed]; integral_time: Ti [s]
    second         K of a second controller, Kp2 = K Kp and Ti2 = K Ti; not used elsewhere
    """

    gain: float
    integral_time: float
    second: float = 1.0

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """Gain, integral time and K as (1,) each, for functions of many settings."""
        return tuple(np.array([v]) for v in (self.gain, self.integral_time, self.second))


@dataclass(frozen=True)
class Loop:
    """dx/dt = (a + Kp a_gain + Kp/Ti a_integral + Kp K a_second) x + b load torque.

    drive    at its working point; given: as passed in
    rows     signal -> row over the state
    direct   direct feedthrough from command to motor torque
    command  (channels, n): input vector of each channel's command; used for the speed reference
    """

    drive: Drive
    given: Drive
    wiring: Wiring
    a: np.ndarray
    a_gain: np.ndarray
    a_integral: np.ndarray
    a_second: np.ndarray
    b: np.ndarray
    direct: float
    rows: Mapping[str, np.ndarray] = field(default_factory=dict)
    command: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def at(self, speed: float) -> Loop:
        """The same loop at another working speed."""
        return build(self.given, replace(self.wiring, speed=speed))

    def reference(self, settings: Settings) -> np.ndarray:
        """(n,) input vector of the speed reference: dx/dt = ... + this times reference."""
        found = np.eye(len(self.a))[-1] + settings.gain * self.command[0]
        if self.wiring.configuration == "miso":
            found = found + settings.gain * settings.second * self.command[1]
        return found

    def matrix(self, settings: Settings) -> np.ndarray:
        """(n, n) of the closed loop."""
        return self.matrices(*settings.columns)[0]

    def matrices(self, gain: np.ndarray, integral_time: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(m, n, n) of the closed loops of m settings, each (m,)."""
        k = np.asarray(gain, float)[:, None, None]
        ti = np.asarray(integral_time, float)[:, None, None]
        return self.a + k * (self.a_gain + self.a_integral / ti
                             + np.asarray(second, float)[:, None, None] * self.a_second)

    def outputs(self, names: Sequence[str], gain: np.ndarray, integral_time: np.ndarray,
                second: np.ndarray) -> np.ndarray:
        """(m, ny, n) rows of signals; only a torque with direct feedthrough depends on the settings."""
        found = np.empty((len(gain), len(names), len(self.a)))
        for k, name in enumerate(names):
            found[:, k] = self.rows[name]
            motor = name.removesuffix("_torque")
            if self.direct and motor in self.wiring.motors:
                found[:, k] += self.direct * self.command_rows(motor, gain, integral_time, second)
        return found

    def torque_rows(self, settings: Settings) -> np.ndarray:
        """(motors, n) torque of each motor over the state."""
        return self.outputs([f"{m}_torque" for m in self.wiring.motors], *settings.columns)[0]

    def reference_gain(self, motor: str, settings: Settings) -> float:
        """Direct gain from speed reference to the command of a motor."""
        if motor == self.wiring.motors[0] or self.wiring.configuration == "siso":
            return settings.gain
        return settings.gain * settings.second if self.wiring.configuration == "miso" else 0.0

    def command_rows(self, motor: str, gain: np.ndarray, integral_time: np.ndarray,
                     second: np.ndarray) -> np.ndarray:
        """(m, n) rows of the torque command of a motor at a speed reference of zero."""
        motor, kind = self.wiring.motors.index(motor), self.wiring.configuration
        integral, speed = np.eye(len(self.a))[-1], self.rows["measured_speed"]
        if motor and kind == "mimo":
            return np.broadcast_to(SHAFT_TORQUE_SHARE * self.rows["shaft_torque"], (len(gain), len(self.a)))
        share = second if motor and kind == "miso" else np.ones_like(gain)
        return gain[:, None] * (integral / integral_time[:, None] - share[:, None] * speed)


def check_wiring(drive: Drive, wiring: Wiring) -> None:
    """Reject a configuration that the drive does not allow.

    raises  BadParameters: a motor that is no body, not two motors where two are controlled
    """
    unknown = [m for m in wiring.motors if m not in drive.bodies]
    if unknown or not wiring.motors or wiring.motors[0] != drive.bodies[0]:
        raise BadParameters(
            f"driven bodies of the {drive.name} drive, the first body first", ", ".join(wiring.motors) or "none",
            "Name them with --motors.", drive.bodies)
    if len(wiring.motors) > 2 or len(set(wiring.motors)) != len(wiring.motors):
        raise BadParameters("one or two different driven bodies", ", ".join(wiring.motors),
                            "Drives with more than two motors are not supported.")
    two = len(wiring.motors) == 2
    if wiring.configuration != "siso" and not (two and len(drive.bodies) > 2):
        raise BadParameters(
            f"a chain of at least three bodies, two of them driven, for {wiring.configuration}",
            f"{len(drive.bodies)} bodies, {', '.join(wiring.motors)} driven",
            "Use --configuration siso, or describe the second motor in the drive section.")


def build(drive: Drive, wiring: Wiring) -> Loop:
    """The loop around a drive.

    drive    all inertias and stiffnesses known; its gap and Coulomb friction are ignored
    returns  Loop, with rows motor_speed, load_speed, logged_speed (behind the sensor's filter), measured_speed
             (behind the controller's, too), shaft_torque (of the last shaft), and <motor>_torque of each motor
    raises   BadParameters: a value is missing, see also `check_wiring` and `at_working_point`
    source   Tallfors 2005, (2.1) to (2.4) and ch. 4
    """
    check_wiring(drive, wiring)
    drive.require(drive.missing(), "a controller")
    given, drive = drive, at_working_point(drive, wiring.speed)
    a_m, b_m = mechanics(drive, wiring)
    path, sensor = torque_path(drive, wiring), lag(drive, "sensor").states()
    speed_filter = Lag(1.0 / wiring.speed_filter if wiring.speed_filter else np.inf, order=1)
    reading = _in_series(sensor, speed_filter.states())
    nm, npath, nc = len(a_m), len(path[0]), 1 if wiring.configuration == "siso" else 2
    n = nm + nc * npath + len(reading[0]) + 1
    a, integral = np.zeros((n, n)), n - 1
    a[:nm, :nm] = a_m
    rows = {"motor_speed": np.eye(n)[0], "load_speed": np.eye(n)[len(drive.bodies) - 1]}
    if drive.shafts:
        rows["shaft_torque"] = np.r_[shaft_torque_row(drive), np.zeros(n - nm)]
    read = slice(integral - len(reading[0]), integral)
    a[read, read] = reading[0]
    a[read] += np.outer(reading[1], rows["motor_speed"])
    for name, (_, _, c, d) in (("logged_speed", sensor), ("measured_speed", reading)):
        rows[name] = d * rows["motor_speed"]
        rows[name][read.start:read.start + len(c)] = c
    a[integral] = -rows["measured_speed"]
    by_channel = _channel_inputs(b_m, wiring)
    entry = []  # input vector of each channel's command
    for k in range(nc):
        own = slice(nm + k * npath, nm + (k + 1) * npath)
        a[own, own] = path[0]
        a[:nm, own] = np.outer(by_channel[:, k], path[2])
        column = np.r_[path[3] * by_channel[:, k], np.zeros(n - nm)]
        column[own] += path[1]
        entry.append(column)
    gain = np.outer(entry[0], -rows["measured_speed"])
    integral_part = np.outer(sum(entry) if wiring.configuration == "miso" else entry[0], np.eye(n)[integral])
    second = np.zeros((n, n))
    if wiring.configuration == "miso":
        second = np.outer(entry[1], -rows["measured_speed"])
    if wiring.configuration == "mimo":
        a += SHAFT_TORQUE_SHARE * np.outer(entry[1], rows["shaft_torque"])
    for k, motor in enumerate(wiring.motors):
        at = nm + min(k, nc - 1) * npath
        rows[f"{motor}_torque"] = np.r_[np.zeros(at), path[2], np.zeros(n - at - npath)]
    return Loop(drive, given, wiring, a, gain, integral_part, second, np.r_[b_m[:, -1], np.zeros(n - nm)], path[3],
                rows, np.array(entry))


def mechanics(drive: Drive, wiring: Wiring) -> tuple[np.ndarray, np.ndarray]:
    """(A (n, n), B (n, motors + 1)) of the chain alone; states are the speeds, then the twists.

    The last input is the load torque.
    """
    roles = (MOTOR_TORQUE, *(f"{m}_torque" for m in wiring.motors[1:]), "load_torque")
    a, b, _, _ = state_space(chain_alone(linear_drive(drive)), roles)
    return a, b


@dataclass(frozen=True)
class Lag:
    """A low-pass of first or second order: states for time responses, its response over frequency.

    bandwidth  [rad/s], infinite: no lag; damping: ratio, of order 2
    """

    bandwidth: float
    damping: float = 1.0
    order: int = 2

    @property
    def time(self) -> float:
        """Delay of slow signals [s]."""
        return (1.0 if self.order == 1 else 2.0 * self.damping) / self.bandwidth

    def response(self, s: np.ndarray) -> np.ndarray:
        """(n,) over s (n,)."""
        p = s / self.bandwidth
        return 1.0 / (1.0 + p if self.order == 1 else p**2 + 2.0 * self.damping * p + 1.0)

    def states(self, lead_time: float = 0.0) -> StateSpace:
        """(A, b, c, d) of the lag times 1 + s lead_time; no state without a lag."""
        w, zeta = self.bandwidth, self.damping
        if not np.isfinite(w):
            return _unit_gain()
        if self.order == 1:  # y + lead_time y', with y' = w (u - y)
            one = np.ones(1)
            return -w * np.eye(1), w * one, (1.0 - lead_time * w) * one, lead_time * w
        return (np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([0.0, w * w]),
                np.array([1.0, lead_time]), 0.0)


def lag(drive: Drive, owner: Literal["converter", "sensor"]) -> Lag:
    """The lag of the torque path or of the speed sensor.

    raises  BadParameters: an order that is not 1 or 2
    """
    w, zeta, order = (drive.value(name_of(owner, k)) for k in ("bandwidth", "damping", "order"))
    if order not in (1.0, 2.0):
        raise BadParameters(f"{owner}.order of 1 or 2", f"{order:g}", "Correct it.")
    return Lag(np.inf if w is None else w, zeta, int(order))


def torque_path(drive: Drive, wiring: Wiring) -> StateSpace:
    """(A, b, c, d) from torque command to torque: dead time, then the converter's lag."""
    own_lag, dead_time = lag(drive, "converter"), drive.value("converter.dead_time")
    if wiring.dead_time == "exact":
        return _in_series(_pade_states(dead_time), own_lag.states())
    if dead_time and not np.isfinite(own_lag.bandwidth):
        raise BadParameters("a converter bandwidth for --dead-time zero", "none",
                            "Give converter.bandwidth, or use --dead-time exact.")
    return own_lag.states(-dead_time / 2.0)


def path_response(drive: Drive, wiring: Wiring, s: np.ndarray) -> np.ndarray:
    """(n,) response from command to torque, the dead time exact."""
    dead_time = drive.value("converter.dead_time")
    return lag(drive, "converter").response(s) * (
        np.exp(-s * dead_time) if wiring.dead_time == "exact" else 1.0 - s * dead_time / 2.0)


def sensor_response(drive: Drive, wiring: Wiring, s: np.ndarray) -> np.ndarray:
    """(n,) response from motor speed to measured speed: the filters of sensor and controller."""
    return lag(drive, "sensor").response(s) / (1.0 + s * wiring.speed_filter)


def lag_time(drive: Drive, wiring: Wiring) -> float:
    """Delay of slow signals by all elements of the loop except the drive itself [s]."""
    return (drive.value("converter.dead_time") + wiring.speed_filter + lag(drive, "converter").time
            + lag(drive, "sensor").time)


def _channel_inputs(inputs: np.ndarray, wiring: Wiring) -> np.ndarray:
    """(n, channels) input vectors of the torque of each channel."""
    motors = inputs[:, :-1]
    return motors.sum(axis=1, keepdims=True) if wiring.configuration == "siso" else motors


def shaft_torque_row(drive: Drive) -> np.ndarray:
    """Torque in the last shaft over speeds and twists."""
    nb, last = len(drive.bodies), drive.shafts[-1]
    row = np.zeros(2 * nb - 1)
    row[-1] = drive.value(name_of(last, "stiffness"))
    damping = drive.value(name_of(last, "damping"))
    row[nb - 2], row[nb - 1] = damping / drive.value(name_of(last, "ratio")), -damping
    return row


def _unit_gain() -> StateSpace:
    return np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0


def _pade_states(dead_time: float) -> StateSpace:
    """State space of the diagonal Pade approximant of e^(-s late), with scaled time for good conditioning."""
    if not dead_time:
        return _unit_gain()
    m = PADE_ORDER
    c = np.array([factorial(2 * m - k) / (factorial(k) * factorial(m - k)) for k in range(m + 1)])
    c /= c[-1]  # denominator sum c_k p^k, p = s late; numerator with (-p)
    numerator = c * (-1.0) ** np.arange(m + 1)
    d = numerator[-1]
    a = np.zeros((m, m))
    a[:-1, 1:] = np.eye(m - 1)
    a[-1] = -c[:-1]
    return a / dead_time, np.eye(m)[-1] / dead_time, (numerator - d * c)[:-1], float(d)


def _in_series(first: StateSpace, then: StateSpace) -> StateSpace:
    """The second system fed by the first."""
    if not len(first[0]):
        a, b, c, d = then
        return a, b * first[3], c, d * first[3]
    a1, b1, c1, d1 = first
    a2, b2, c2, d2 = then
    a = np.block([[a1, np.zeros((len(a1), len(a2)))], [np.outer(b2, c1), a2]])
    return a, np.r_[b1, b2 * d1], np.r_[d2 * c1, c2], d2 * d1
