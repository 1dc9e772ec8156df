"""Records of simulated machines in a few hundredths of a second: the compiled twin of `simulate`."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from tests.simulator import fast_kernel as kernel
from tests.simulator.machine import Machine, State, at_rest
from tests.simulator.simulate import Trajectory, split_dead_time

EVENTS = ("contact_made", "contact_lost", "stuck", "released", "reversed")


@dataclass(frozen=True)
class PI:
    """The SpeedPI of `controllers`, as values.

    reference    (n,) [rad/s]
    gain, reset  [Nm s/rad], integral gain [Nm/rad]
    start        [Nm] the integral at the first sample
    limit, resolution  [Nm] of the command; zero resolution is none
    """

    reference: np.ndarray
    gain: float
    reset: float
    start: float = 0.0
    limit: float = np.inf
    resolution: float = 0.0


def simulate_fast(machine: Machine, torque: np.ndarray, step: float, start: State | None = None,
                  controller: PI | None = None, torque_noise: np.ndarray | None = None,
                  load_torque: np.ndarray | None = None, sensor_noise: np.ndarray | None = None,
                  resolution: float = 0.0, finer: int = 1) -> Trajectory:
    """One record of a machine, as `simulate` gives it.

    torque        (n,) command [Nm]; with a controller what is added before its saturation
    start         at rest and without twist if None; the filter starts at the speed
    torque_noise, load_torque  (n,) [Nm] held over each sample
    sensor_noise  (n,) on the speed of body 0; resolution of its quantiser, zero is none
    finer         the steps of the integrator are so many times shorter than they need be; guards are
                  looked at between them only, so that 4 to 16 is wanted where samples are long against
                  the resonance and contacts short: with 1 some are missed (1e-5 to 1e-3 rad/s)
    raises        RuntimeError: too many mode changes in one sample
    """
    start = start or at_rest(machine)
    torque = np.asarray(torque, float)
    zero = np.zeros_like(torque)
    reference = zero if controller is None else controller.reference
    signals = np.array([zero if a is None else a for a in (
        torque, torque_noise, load_torque, sensor_noise, reference)], float)
    pi = controller or PI(zero, 0.0, 0.0)
    control = (float(pi.gain), float(pi.reset), float(pi.start), float(pi.limit), float(pi.resolution),
               float(resolution))
    plant, n = plant_of(machine), machine.bodies
    mode = np.zeros((4, max(n, 5)), np.int64)
    whole, rest = split_dead_time(machine.dead_time, step)
    timing = (float(step), step / (substeps(machine, step) * finer), float(whole), float(rest),
              float(start.torque))
    bristles = np.multiply(plant[kernel.BRK, :n], start.bristles or 0.0) if machine.lugre else ()
    places = start.places_in(machine) if machine.places else ()
    first = (*start.speeds, *start.twists, start.angle, start.torque, start.torque_rate, start.speeds[0],
             *bristles, *places)
    states = np.zeros((kernel.ROWS, len(first)))
    states[kernel.NOW] = first
    kept, commands = np.zeros((torque.size, 5 * n)), np.zeros(torque.size)
    at = kernel.whole_record(states, plant, mode, signals, control, timing, kept, commands)
    if at >= 0:
        raise RuntimeError(f"more than {kernel.MAX_EVENTS_PER_SAMPLE} mode changes in sample {at}")
    return _trajectory(machine, kept, commands, step, mode[kernel.EVENTS], states[kernel.NOW])


def plant_of(machine: Machine) -> np.ndarray:
    """(quantities, bodies or more) the machine's numbers as the kernel takes them."""
    m, e, n = machine, machine.effects, machine.bodies
    body = {name: np.array(getattr(m, name)) for name in ("inertia", "viscous", "coulomb")}
    body |= {name: np.array(e.of(name, n)) for name in (
        "viscous_back", "coulomb_back", "stribeck", "stribeck_speed", "stribeck_power", "quadratic",
        "lugre_stiffness", "lugre_damping")}
    for name in ("viscous", "coulomb"):
        back = f"{name}_back"
        body[back] = np.where(np.isnan(body[back]), body[name], body[back])
    body["idle"] = np.array(m.idle_torque)
    body["direction_dependent"] = (body["lugre_stiffness"] == 0) & (
        (body["coulomb"] > 0) | (body["coulomb_back"] > 0) | (body["stribeck"] > 0)
        | (body["viscous_back"] != body["viscous"]))
    for row, name in enumerate(("loss_driving", "loss_driven")):
        body[name] = np.array([m.losses.get(i, (0.0, 0.0))[row] for i in range(n)])
    body["direction_dependent"] |= np.isin(np.arange(n), list(m.losses))
    shaft = {name: np.array(getattr(m, name)) for name in ("stiffness", "damping", "half_gap", "ratio")}
    shaft |= {name: np.array(e.of(name, n - 1)) for name in (
        "hardening_twist", "hardening_power", "damping_torque")}
    path = (m.converter_bandwidth or 0.0, m.converter_damping, *e.ripple, *e.ripple2, *e.imbalance, *e.drift,
            *e.load_step, e.filter_time, float(m.law == "always"), n, (2 * n + 3) * bool(m.lugre),
            (2 * n + 3 + n * bool(m.lugre)) * bool(m.places), e.rotor_inertia)
    rows = [*(body[name] for name in kernel.BODY), *(shaft[name] for name in kernel.SHAFT), path]
    table = np.zeros((len(rows), max(n, len(path))))
    for row, values in zip(table, rows, strict=True):
        row[:len(values)] = values
    return table


def substeps(machine: Machine, step: float) -> int:
    """Steps of the integrator per sample: a third of a radian of the fastest rate each.

    At least 6 where something switches, because guards are looked at between steps only.
    """
    m, e, n = machine, machine.effects, machine.bodies
    fastest = [m.converter_bandwidth or 0.0, 1.0 / e.filter_time if e.filter_time > 0 else 0.0]
    shafts = zip(m.stiffness, m.damping, m.ratio, *(e.of(name, n - 1) for name in (
        "hardening_twist", "hardening_power", "damping_torque")), strict=True)
    for k, (stiffness, damping, ratio, twist, power, torque) in enumerate(shafts):
        ease = 1.0 / m.inertia[k] / ratio**2 + 1.0 / m.inertia[k + 1]
        most = 2.0 * (m.rated_torque or 0.0)
        harder = 1.0 + (power + 1.0) * max(1.0, most / stiffness / twist) ** power if twist < np.inf else 1.0
        fastest += [np.sqrt(stiffness * harder * ease), damping * (1.0 + most / torque) * ease]
    fastest += [m.stiffness[k] / m.damping[k] for k in m.places]
    for i, (extra, speed) in enumerate(zip(e.of("stribeck", n), e.of("stribeck_speed", n), strict=True)):
        fastest.append(extra / speed / m.inertia[i])
    for inertia, s0, s1 in zip(m.inertia, e.of("lugre_stiffness", n), e.of("lugre_damping", n), strict=True):
        fastest += [np.sqrt(s0 / inertia), s1 / inertia]
    smooth = not (any(m.half_gap) or any(m.coulomb) or any(e.stribeck) or e.coulomb_back or e.viscous_back
                  or e.hardening_twist or e.damping_torque or m.losses)
    return max(3 if smooth else 6, int(np.ceil(3.0 * step * max(fastest))))


def _trajectory(machine, kept, commands, step, counts, y) -> Trajectory:
    n = machine.bodies
    speeds, twists, torques = kept[:, :n], kept[:, n:2 * n - 1], kept[:, 2 * n:3 * n - 1]
    angles = np.empty_like(speeds)
    angles[:, 0] = kept[:, 2 * n - 1]
    for k, ratio in enumerate(machine.ratio):
        angles[:, k + 1] = angles[:, k] / ratio - twists[:, k]
    lagged = machine.converter_bandwidth is not None
    s0 = machine.effects.of("lugre_stiffness", n)
    bristles = [y[2 * n + 3 + i] / s0[i] if s0[i] else 0.0 for i in range(n)] if machine.lugre else ()
    torque, rate = y[2 * n:2 * n + 2] if lagged else (commands[-1], 0.0)
    end = State(tuple(y[:n]), tuple(y[n:2 * n - 1]), float(y[2 * n - 1]), float(torque), float(rate),
                tuple(bristles))
    if machine.places:
        inside = (y[k - (n - 1)] if k in machine.places else b for k, b in enumerate(end.places_in(machine)))
        end = replace(end, places=tuple(inside))
    events = Counter(dict(zip(EVENTS, counts[:5].tolist(), strict=True)))
    return Trajectory(
        np.arange(len(kept)) * step, speeds.copy(), angles, torques.copy(), commands, kept[:, 3 * n - 1],
        kept[:, 3 * n], kept[:, 3 * n + 1:4 * n].astype(np.int8), kept[:, 4 * n:].astype(bool),
        +events, end)
