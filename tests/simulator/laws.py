"""The equations of a machine within one mode, and the guards that end the mode.

A mode is one contact state per shaft (+1, 0 in the gap, -1) and one slip state per body with
Coulomb friction (+1, 0 stuck, -1). Within it every law is smooth. Plain Python numbers: for a
handful of states they are faster than small arrays.

State vector: speeds, twists, angle of body 0 since the start of the sample, with a converter its
torque and torque rate, with a sensor filter the filtered speed, with friction that drifts the time,
with LuGre friction the torques s0 z of the bristles. The slip state of such a body is the sign of its speed
(its law has a kink there); it is never stuck. With the law "contact" the places in the gaps.
A body behind a transmission with losses slips and sticks as with Coulomb friction, and the mode has the sign of
the torque that is passed on to it.

Twists are states of their own because the difference of two large angles would lose the digits that
the shaft torque needs.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from tests.simulator.machine import Machine

SPEED_NOISE = 1e-14
KINK_NOISE = 1e-12  # [rad/s] of speeds at which LuGre friction, which does not jump, need not know the sign


class Laws:
    """Derivatives, guards and mode changes of one machine; holds the current mode.

    command, disturbance, load  [Nm] constant until the caller changes them: the command as it
    reaches the converter, a torque added on body 0, a torque that opposes the last body
    turned  [rad] angle of body 0 at the start of the sample, set by the caller too
    """

    def __init__(self, machine: Machine):
        self.machine = machine
        self.n = n = machine.bodies
        self.command = self.disturbance = self.load = self.turned = 0.0
        self.gapped = [k for k in range(n - 1) if machine.half_gap[k] > 0]
        self.body = _bodies(machine)
        self.losses = machine.losses
        self.direction_dependent = [i for i, b in enumerate(self.body)
                                    if (b.direction_dependent and i not in machine.lugre) or i in self.losses]
        self.contact = [0] * (n - 1)
        self.slip = [0] * n
        self.pull = dict.fromkeys(self.losses, 1)
        self.events: Counter[str] = Counter()
        inside = machine.law != "always"  # "contact" differs within the gap only
        # z = twist + lead * rate decides on contact; extra * rate is added in any state.
        self.shafts = [
            (k, ks, (cs / ks if inside else 0.0), (0.0 if inside else cs), gap, ratio)
            for k, (ks, cs, gap, ratio) in enumerate(zip(
                machine.stiffness, machine.damping, machine.half_gap, machine.ratio, strict=True))]
        e = machine.effects
        rows = zip(*(e.of(name, n - 1) for name in (
            "hardening_twist", "hardening_power", "damping_torque")), strict=True)
        # Shaft -> hardening twist, power, T0 of the damping.
        self.bent = {k: row for k, row in enumerate(rows) if min(row[0], row[2]) < math.inf}
        self.converter = machine.converter_bandwidth is not None
        size = 2 * n + 2 * self.converter
        self.filtered = size if e.filter_time > 0 else None
        self.clock = size + (e.filter_time > 0) if e.drift[0] else None
        # Body -> where its bristle's torque is in the state vector; shaft -> where its place in the gap is.
        size += (e.filter_time > 0) + bool(e.drift[0])
        self.bristle = {i: size + j for j, i in enumerate(machine.lugre)}
        self.place = {k: size + len(machine.lugre) + j for j, k in enumerate(machine.places)}

    def begin(self, x: list[float]) -> None:
        """Choose the contact states that belong to state x; call once before the first piece."""
        for k in self.gapped:
            up, down = self.ends(x, k)
            self.contact[k] = (up and self.touch(x, k, 1) > 0) - (down and self.touch(x, k, -1) < 0)

    def ends(self, x: list[float], k: int) -> tuple[bool, bool]:
        """Whether shaft k may touch on the upper and on the lower side, if its twist wants to."""
        gap = self.machine.half_gap[k]
        return (x[self.place[k]] >= gap, x[self.place[k]] <= -gap) if k in self.place else (True, True)

    def reach(self, x: list[float], k: int) -> float:
        """z of shaft k [rad]: what the dead zone acts on."""
        _, _, lead, _, _, ratio = self.shafts[k]
        return x[self.n + k] + lead * (x[k] / ratio - x[k + 1])

    def touch(self, x: list[float], k: int, side: int) -> float:
        """Of the sign of the torque that shaft k has if it touches on `side`: a twist [rad]."""
        if k not in self.bent:
            return self.reach(x, k) - side * self.machine.half_gap[k]
        return self._load_dependent_torque(x, k, side) / self.machine.stiffness[k]

    def _load_dependent_torque(self, x: list[float], k: int, side: int) -> float:
        """Torque of a shaft whose stiffness or damping changes with its load."""
        _, ks, lead, _, gap, ratio = self.shafts[k]
        twist, power, torque = self.bent[k]
        bend = x[self.n + k] - side * gap
        elastic = ks * bend * (1.0 + (abs(bend) / twist) ** power)
        return elastic + lead * ks * (1.0 + abs(elastic) / torque) * (x[k] / ratio - x[k + 1])

    def shaft_torques(self, x: list[float]) -> list[float]:
        """(n-1,) torque that each shaft passes on to its next body [Nm]."""
        torques = []
        for k, ks, lead, extra, gap, ratio in self.shafts:
            rate = x[k] / ratio - x[k + 1]
            side = self.contact[k] if gap > 0 else 0
            if gap > 0 and not side:
                closed = 0.0
            elif k in self.bent:
                closed = self._load_dependent_torque(x, k, side)
            else:
                closed = ks * (x[self.n + k] + lead * rate - side * gap)
            torques.append(closed + extra * rate)
        return torques

    def friction_factor(self, x: list[float]) -> float:
        """Factor of viscous and Coulomb friction."""
        if self.clock is None:
            return 1.0
        share, time = self.machine.effects.drift
        return 1.0 + share * math.exp(-x[self.clock] / time)

    def hold(self, x: list[float], i: int, way: int) -> float:
        """Torque that body i at standstill can hold against motion in direction `way` [Nm]."""
        b = self.body[i]
        level = (b.coulomb if way > 0 else b.coulomb_back) * self.friction_factor(x) + b.stribeck
        if i not in self.losses:
            return level
        through = self._through(x, i)
        return level + self.losses[i][through * way <= 0.0] * abs(through)

    def _through(self, x: list[float], i: int) -> float:
        """Torque that the transmission passes on to body i, if body i is not accelerated where it is the first."""
        return self.shaft_torques(x)[i - 1] if i else sum(self._motor_torques(x))

    def transmitted(self, x: list[float], i: int) -> float:
        """Torque that the transmission passes on to body i [Nm]."""
        rotor = self.machine.effects.rotor_inertia
        return self._through(x, i) - (rotor * self._accelerations(x)[i] if rotor else 0.0)

    def _motor_torques(self, x: list[float]) -> list[float]:
        """Torques on body 0 from the motor's side: behind the converter with its noise, ripples."""
        angle, e = self.turned + x[2 * self.n - 1], self.machine.effects
        ripples = [a * math.sin(order * angle + phase) for a, order, phase in (e.ripple, e.ripple2) if a]
        return [(x[2 * self.n] if self.converter else self.command) + self.disturbance, *ripples]

    def net_torques(self, x: list[float]) -> list[float]:
        """(n,) sum of all torques on each body except its set-valued friction [Nm]."""
        n, e, worn, net = self.n, self.machine.effects, self.friction_factor(x), []
        for i, b in enumerate(self.body):
            back = self.slip[i] < 0 if b.direction_dependent else x[i] < 0
            viscous = (b.viscous_back if back else b.viscous) * worn
            net.append(-viscous * x[i] - b.idle - b.quadratic * x[i] * abs(x[i]))
        for i, at in self.bristle.items():
            net[i] -= x[at] + self.body[i].lugre_damping * self._bending(x, i)
        applied, *ripples = self._motor_torques(x)
        net[0] += applied
        net[-1] -= self.load
        for ripple in ripples:
            net[0] += ripple
        angle = self.turned + x[2 * n - 1]
        for k, torque in enumerate(self.shaft_torques(x)):
            net[k] -= torque / self.shafts[k][5]
            net[k + 1] += torque
            angle = angle / self.shafts[k][5] - x[n + k]
        if e.imbalance[0]:
            net[-1] -= e.imbalance[0] * math.sin(angle / e.imbalance[1] + e.imbalance[2])
        return net

    def _accelerations(self, x: list[float]) -> list[float]:
        """(n,) [rad/s^2] in the current mode."""
        net, inertia = self.net_torques(x), self.machine.inertia
        for i in self.direction_dependent:
            net[i] = net[i] - self.slip[i] * self._sliding(x, i) if self.slip[i] else 0.0
        for i, shares in self.losses.items():
            if self.slip[i]:
                same = self.slip[i] * self.pull[i]
                share = same * shares[same < 0]
                net[i] -= share * self._through(x, i)
                if i == 0:  # What accelerates the rotor does not pass the transmission.
                    net[i] /= 1.0 - share * self.machine.effects.rotor_inertia / inertia[i]
        return [torque / j for torque, j in zip(net, inertia, strict=True)]

    def derivative(self, _t, y):
        """d/dt of the state vector in the current mode."""
        x = y.tolist()
        rates = self._accelerations(x)
        for k, shaft in enumerate(self.shafts):
            rates.append(x[k] / shaft[5] - x[k + 1])
        rates.append(x[0])
        if self.converter:
            w0, zeta = self.machine.converter_bandwidth, self.machine.converter_damping
            torque, slope = x[2 * self.n], x[2 * self.n + 1]
            if math.isinf(zeta):
                rates += [w0 * (self.command - torque), 0.0]
            else:
                rates += [slope, w0 * w0 * (self.command - torque) - 2.0 * zeta * w0 * slope]
        if self.filtered is not None:
            rates.append((x[0] - x[self.filtered]) / self.machine.effects.filter_time)
        if self.clock is not None:
            rates.append(1.0)
        rates += [self.body[i].lugre_stiffness * self._bending(x, i) for i in self.bristle]
        for k, at in self.place.items():
            _, _, lead, _, _, ratio = self.shafts[k]
            relaxing = x[k] / ratio - x[k + 1] + (x[self.n + k] - x[at]) / lead
            rates.append(0.0 if self.contact[k] else relaxing)
        return rates

    def _bending(self, x: list[float], i: int) -> float:
        """dz/dt of the bristle of a body [rad/s]."""
        return x[i] - self.slip[i] * x[i] * x[self.bristle[i]] / self._sliding(x, i)

    def _sliding(self, x: list[float], i: int) -> float:
        """Coulomb and Stribeck friction of a body that slides [Nm]."""
        b = self.body[i]
        level = (b.coulomb if self.slip[i] > 0 else b.coulomb_back) * self.friction_factor(x)
        if not b.stribeck:
            return level
        return level + b.stribeck * math.exp(-((abs(x[i]) / b.stribeck_speed) ** b.stribeck_power))

    def guards(self, x: list[float]) -> list[float]:
        """Values that are positive for as long as the mode is right; order as in `exits`."""
        values = []
        for k in self.gapped:
            side, gap = self.contact[k], self.machine.half_gap[k]
            if side:
                values.append(side * self.touch(x, k, side))
            elif k in self.place:
                values += [gap - x[self.place[k]], gap + x[self.place[k]]]
            else:
                values += [-self.touch(x, k, 1), self.touch(x, k, -1)]
        net = self.net_torques(x) if any(self.slip[i] == 0 for i in self.direction_dependent) else ()
        for i in self.direction_dependent:
            values += [self.slip[i] * x[i]] if self.slip[i] else [
                self.hold(x, i, 1) - net[i], self.hold(x, i, -1) + net[i]]
        values += [self.slip[i] * x[i] for i in self.bristle]
        return values + [self.pull[i] * self.transmitted(x, i) for i in self.losses if self.slip[i]]

    def exits(self) -> list[tuple[str, int, int, float]]:
        """(kind, index, new contact, slip or pull, rounding error of the guard) for every guard."""
        found = []
        for k in self.gapped:
            noise = 1e-15 + 1e-13 * self.machine.half_gap[k]
            sides = (0,) if self.contact[k] else (1, -1)
            found += [("contact", k, side, noise) for side in sides]
        for i in self.direction_dependent:
            b = self.body[i]
            noise = 1e-12 * (max(b.coulomb, b.coulomb_back) + b.stribeck)
            if self.slip[i]:
                found.append(("halt", i, 0, SPEED_NOISE))
            else:
                found += [("release", i, 1, noise), ("release", i, -1, noise)]
        found += [("turn", i, -self.slip[i], KINK_NOISE) for i in self.bristle]
        return found + [("pull", i, -self.pull[i], 1e-14 * self.shafts[i - 1][1] if i else 1e-12)
                        for i in self.losses if self.slip[i]]

    def leave(self, y, kind: str, index: int, new: int) -> None:
        """Change the mode at an event; a body that halts gets exactly zero speed in y."""
        if kind == "contact":
            self.contact[index] = new
            if new and index in self.place:
                y[self.place[index]] = new * self.machine.half_gap[index]
            self.events["contact_made" if new else "contact_lost"] += 1
        elif kind == "release":
            self.slip[index] = new
            self.events["released"] += 1
        elif kind == "turn":
            self.slip[index] = new
        elif kind == "pull":
            self.pull[index] = new
            return
        else:
            y[index] = 0.0
            before, now = self.slip[index], self._direction(y.tolist(), index)
            self.slip[index] = now
            if now != before:
                self.events["reversed" if now else "stuck"] += 1
        self._choose_pulls(y)

    def _choose_pulls(self, y) -> None:
        """The signs of the torques that transmissions pass on; one fits, as 1 - loss rotor / inertia > 0."""
        for i in self.losses:
            self.pull[i] = 1
            self.pull[i] = 1 if self.transmitted(y.tolist(), i) >= 0.0 else -1

    def settle(self, y) -> None:
        """Choose slip states and signs of passed torques after the torques may have jumped.

        A speed that has passed zero by a rounding error only, too little for the guard, is
        made zero in y: it is for the torques to say where the body goes from there.
        """
        for i in self.direction_dependent:
            before = self.slip[i]
            if before * y[i] < 0.0 and abs(y[i]) <= SPEED_NOISE:
                y[i] = 0.0
            now = (1 if y[i] > 0 else -1) if y[i] else self._direction(y.tolist(), i)
            self.slip[i] = now
            if now != before and y[i] == 0.0:
                self.events["released" if not before else "reversed" if now else "stuck"] += 1
        for i in self.bristle:
            self.slip[i] = 1 if (y[i] or self.net_torques(y.tolist())[i]) >= 0.0 else -1
        self._choose_pulls(y)

    def _direction(self, x: list[float], body: int) -> int:
        """Where a body at standstill goes: nowhere while friction can hold it."""
        torque = self.net_torques(x)[body]
        return (torque > self.hold(x, body, 1)) - (torque < -self.hold(x, body, -1))


@dataclass(frozen=True)
class _Body:
    """What resists one body; direction_dependent: its friction depends on the direction it moves in."""

    viscous: float
    viscous_back: float
    coulomb: float
    coulomb_back: float
    stribeck: float
    stribeck_speed: float
    stribeck_power: float
    quadratic: float
    lugre_stiffness: float
    lugre_damping: float
    idle: float

    @property
    def direction_dependent(self) -> bool:
        return max(self.coulomb, self.coulomb_back, self.stribeck) > 0 or self.viscous_back != self.viscous


def _bodies(machine: Machine) -> list[_Body]:
    """Values of every body; what is not given for negative motion is as for positive."""
    e, n = machine.effects, machine.bodies
    found = []
    for viscous, back, coulomb, other, *rest in zip(
            machine.viscous, e.of("viscous_back", n), machine.coulomb, e.of("coulomb_back", n),
            e.of("stribeck", n), e.of("stribeck_speed", n), e.of("stribeck_power", n), e.of("quadratic", n),
            e.of("lugre_stiffness", n), e.of("lugre_damping", n), machine.idle_torque, strict=True):
        found.append(_Body(viscous, viscous if math.isnan(back) else back, coulomb,
                           coulomb if math.isnan(other) else other, *rest))
    return found
