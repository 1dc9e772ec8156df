"""The equations of a machine within one mode, and the guards that end the mode.

A mode is one contact state per shaft (+1, 0 in the gap, -1) and one slip state per body with
Coulomb friction (+1, 0 stuck, -1). Within it every law is smooth. Plain Python numbers: for a
handful of states they are faster than small arrays.

State vector: speeds, twists, angle of body 0 since the start of the piece, and with a converter
its torque and torque rate. Twists are states of their own because the difference of two large
angles would lose the digits that the shaft torque needs.
"""

from __future__ import annotations

from collections import Counter

from tests.simulator.machine import Machine

SPEED_NOISE = 1e-14


class Laws:
    """Derivatives, guards and mode changes of one machine; holds the current mode.

    command, disturbance, load  [Nm] constant until the caller changes them: the command as it
    reaches the converter, a torque added on body 0, a torque that opposes the last body
    """

    def __init__(self, machine: Machine):
        self.machine = machine
        self.n = n = machine.bodies
        self.command = self.disturbance = self.load = 0.0
        self.gapped = [k for k in range(n - 1) if machine.half_gap[k] > 0]
        self.rough = [i for i in range(n) if machine.coulomb[i] > 0]
        self.contact = [0] * (n - 1)
        self.slip = [0] * n
        self.events: Counter[str] = Counter()
        inside = machine.law == "inside"
        # z = twist + lead * rate decides on contact; extra * rate is added in any state.
        self.shafts = [
            (k, ks, (cs / ks if inside else 0.0), (0.0 if inside else cs), gap, ratio)
            for k, (ks, cs, gap, ratio) in enumerate(zip(
                machine.stiffness, machine.damping, machine.half_gap, machine.ratio, strict=True))]
        self.resisting = list(zip(machine.viscous, machine.idle_torque, strict=True))
        self.converter = machine.converter_bandwidth is not None

    def begin(self, x: list[float]) -> None:
        """Choose the contact states that belong to state x; call once before the first piece."""
        for k in self.gapped:
            reach, gap = self.reach(x, k), self.machine.half_gap[k]
            self.contact[k] = (reach > gap) - (reach < -gap)

    def reach(self, x: list[float], k: int) -> float:
        """z of shaft k [rad]: what the dead zone acts on."""
        _, _, lead, _, _, ratio = self.shafts[k]
        return x[self.n + k] + lead * (x[k] / ratio - x[k + 1])

    def shaft_torques(self, x: list[float]) -> list[float]:
        """(n-1,) torque that each shaft passes on to its next body [Nm]."""
        torques = []
        for k, ks, lead, extra, gap, ratio in self.shafts:
            rate = x[k] / ratio - x[k + 1]
            if gap > 0:
                side = self.contact[k]
                closed = ks * (x[self.n + k] + lead * rate - side * gap) if side else 0.0
            else:
                closed = ks * (x[self.n + k] + lead * rate)
            torques.append(closed + extra * rate)
        return torques

    def net_torques(self, x: list[float]) -> list[float]:
        """(n,) sum of all torques on each body except its Coulomb friction [Nm]."""
        net = [-c * w - idle for (c, idle), w in zip(self.resisting, x, strict=False)]
        net[0] += (x[2 * self.n] if self.converter else self.command) + self.disturbance
        net[-1] -= self.load
        for k, torque in enumerate(self.shaft_torques(x)):
            net[k] -= torque / self.shafts[k][5]
            net[k + 1] += torque
        return net

    def derivative(self, _t, y):
        """d/dt of the state vector in the current mode."""
        x = y.tolist()
        net = self.net_torques(x)
        for i in self.rough:
            net[i] = net[i] - self.slip[i] * self.machine.coulomb[i] if self.slip[i] else 0.0
        rates = [torque / inertia for torque, inertia in zip(net, self.machine.inertia, strict=True)]
        for k, shaft in enumerate(self.shafts):
            rates.append(x[k] / shaft[5] - x[k + 1])
        rates.append(x[0])
        if self.converter:
            w0, zeta = self.machine.converter_bandwidth, self.machine.converter_damping
            torque, slope = x[2 * self.n], x[2 * self.n + 1]
            rates += [slope, w0 * w0 * (self.command - torque) - 2.0 * zeta * w0 * slope]
        return rates

    def guards(self, x: list[float]) -> list[float]:
        """Values that are positive for as long as the mode is right; order as in `exits`."""
        values = []
        for k in self.gapped:
            reach, gap, side = self.reach(x, k), self.machine.half_gap[k], self.contact[k]
            values += [side * reach - gap] if side else [gap - reach, gap + reach]
        net = self.net_torques(x) if any(self.slip[i] == 0 for i in self.rough) else ()
        for i in self.rough:
            level = self.machine.coulomb[i]
            values += [self.slip[i] * x[i]] if self.slip[i] else [level - net[i], level + net[i]]
        return values

    def exits(self) -> list[tuple[str, int, int, float]]:
        """(kind, index, new contact or slip, rounding error of the guard) for every guard."""
        found = []
        for k in self.gapped:
            noise = 1e-15 + 1e-13 * self.machine.half_gap[k]
            sides = (0,) if self.contact[k] else (1, -1)
            found += [("contact", k, side, noise) for side in sides]
        for i in self.rough:
            noise = 1e-12 * self.machine.coulomb[i]
            if self.slip[i]:
                found.append(("halt", i, 0, SPEED_NOISE))
            else:
                found += [("release", i, 1, noise), ("release", i, -1, noise)]
        return found

    def leave(self, y, kind: str, index: int, new: int) -> None:
        """Change the mode at an event; a body that halts gets exactly zero speed in y."""
        if kind == "contact":
            self.contact[index] = new
            self.events["contact_made" if new else "contact_lost"] += 1
        elif kind == "release":
            self.slip[index] = new
            self.events["released"] += 1
        else:
            y[index] = 0.0
            before, now = self.slip[index], self._direction(y.tolist(), index)
            self.slip[index] = now
            if now != before:
                self.events["reversed" if now else "stuck"] += 1

    def settle(self, y) -> None:
        """Choose slip states after the torques may have jumped.

        A speed that has passed zero by a rounding error only, too little for the guard, is
        made zero in y: it is for the torques to say where the body goes from there.
        """
        for i in self.rough:
            before = self.slip[i]
            if before * y[i] < 0.0 and abs(y[i]) <= SPEED_NOISE:
                y[i] = 0.0
            now = (1 if y[i] > 0 else -1) if y[i] else self._direction(y.tolist(), i)
            self.slip[i] = now
            if now != before and y[i] == 0.0:
                self.events["released" if not before else "reversed" if now else "stuck"] += 1

    def _direction(self, x: list[float], body: int) -> int:
        """Where a body at standstill goes: nowhere while friction can hold it."""
        torque, level = self.net_torques(x)[body], self.machine.coulomb[body]
        return (torque > level) - (torque < -level)
