"""From a drive to the equations the kernel solves: every effect stamps its law.

Rows are torques of the bodies, then rates of the twists and of the signal path. Each number has its derivatives: a
parameter is a Dual over the free ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import mul

import numpy as np

from drivetool.drive.arrays import System
from drivetool.drive.chain import Drive, body_shares, mass_of
from drivetool.drive.dual import Dual
from drivetool.drive.effects import EFFECT_INPUTS, FRICTION_SUFFIXES, LAW_TORQUES, TOTALS, Effect
from drivetool.errors import BadParameters
from drivetool.quantity import name_of, owner_of, shared

Row = dict[int, Dual]  # state -> factor
# Parameter columns are padded to multiples of this: a 256-bit vector register holds four float64.
COLUMN_MULTIPLE = 4


@dataclass(frozen=True)
class Layout:
    """What is simulated: the free parameters and the input and output signals.

    free         names of the nq free parameters, in the order of the columns
    inputs       roles, the motor torque first; outputs: roles; step: sample interval [s]
    memory       None, or the AR(1) pole of a motor torque disturbance per sample, which is then a state
    gradient     whether derivatives over the free parameters are computed
    """

    free: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    step: float
    memory: float | None = None
    gradient: bool = True


@dataclass(frozen=True)
class Law:
    """A smooth law as an effect stamped it: see `Assembly.law`."""

    torque: Callable
    parameters: tuple[Dual, ...]
    first: Row
    second: Row
    body: int
    shaft: int
    slides: bool
    into: Row
    drives: bool


class Assembly:
    """The equations under construction, which effects add to.

    states        names; own_states: (effect, index of its owner, its states) of the effects that have some
    rows          (row, column) -> factor; masses: which the torques of each body accelerate
    shafts        (stiffness, damping, ratio) of each joint; gaps: shaft -> half width of its dead zone
    relaxing      shaft -> column of its elastic twist, which relaxes in the gap
    always_damping, contact_damping    shaft -> damping whether or not it is in contact, and only in contact
    frictions     body -> level of set-valued friction; laws: smooth ones
    losses        body -> (loss where it is driven, loss where it drives, rotor's share of its mass) of the
                  transmission in front of it
    friction_factor  on all friction; input_gain: body -> factor on its input; sensed: role -> column that it reads
    replaced      (body, suffix) of friction that another law contains
    law_rate      at which a law's torque changes over the rate of the linear modes
    motor_column  of the torque that acts on the motor
    dead_time     by which the motor torque acts later [s], or None; interpolation: see `Plant`
    """

    def __init__(self, drive: Drive, layout: Layout):
        self.drive, self.layout = drive, layout
        self.nq = -(-len(layout.free) // COLUMN_MULTIPLE) * COLUMN_MULTIPLE if layout.gradient else 0
        self.n = len(drive.bodies)
        # Present in any recording: the start state has the same length in all.
        self.acting = {shared(n) for n in layout.free} | {
            shared(n) for n, v in drive.values.items() if v is not None and v != drive.quantity(n).neutral}
        self.states = [f"{b}.speed" for b in drive.bodies] + [f"{s}.twist" for s in drive.shafts]
        angles = [role for role in layout.outputs if role.endswith("angle")]
        if angles or self._needs_angle():
            self.states.append("angle")
        # The first encoder defines where the motor's angle is zero; each further one has its own, a constant in the
        # start state.
        self.states += [f"{role}.zero" for role in angles[1:]]
        self.own_states = [(effect, index, names) for effect, _, index in drive.effects()
                           if (names := tuple(effect.states(self, index)))]
        self.states += [name for _, _, names in self.own_states for name in names]
        if layout.memory is not None:
            self.states.append("disturbance")
        self.nx, self.nu = len(self.states), len(layout.inputs)
        self.constant = self.nx + self.nu
        self.rows: dict[tuple[int, int], Dual] = {}
        self.shafts: list[tuple[Dual, Dual, Dual]] = []
        self.gaps: dict[int, Dual] = {}
        self.always_damping: dict[int, Dual] = {}
        self.contact_damping: dict[int, Dual] = {}
        self.relaxing: dict[int, int] = {}
        self.frictions: dict[int, Dual] = {}
        self.losses: dict[int, tuple[Dual, Dual, Dual]] = {}
        self.laws: list[Law] = []
        self.friction_factor = self.number(1.0)
        self.input_gain = {body: self.number(1.0) for body in range(self.n)}
        self.sensed: dict[str, int] = {}
        self.law_rate = 1.0
        self.replaced: set[tuple[int, str]] = set()
        self.motor_column, self.dead_time, self.interpolation = self.nx, None, 0.0
        self.own_masses = [mass_of(lambda suffix, b=b: self.parameter(name_of(b, suffix))) for b in drive.bodies]
        self.masses = list(self.own_masses)
        present = [(effect, index) for effect, owner, index in drive.effects() if self._is_present(effect, owner)]
        for effect, index in present:
            effect.prepare(self, index)
        for effect, index in present:
            effect.stamp(self, index)
        self._kinematics()

    # used by the effects

    def number(self, value: float) -> Dual:
        """A constant."""
        return Dual(value, np.zeros(self.nq))

    def parameter(self, name: str) -> Dual:
        """The value of a parameter with its gradient."""
        value = self.drive.value(name)
        if value is None:
            raise BadParameters(f"a value of {name}", "none",
                                "Give it in the parameter file or with --set.")
        dual = self.number(value)
        if self.layout.gradient and name in self.layout.free:
            dual.d[self.layout.free.index(name)] = 1.0
        return dual

    def of_body(self, body: int, suffix: str) -> Dual:
        """A body's parameter; a total is distributed by the rule of its effect."""
        name = name_of(self.drive.bodies[body], suffix)
        factor = self.friction_factor if suffix in FRICTION_SUFFIXES else self.number(1.0)
        for total, part in TOTALS.items():
            if part == suffix and (total in self.drive.values or total in self.layout.free):
                return self.parameter(total) * self._share(suffix, body) * factor
        return self.parameter(name) * factor

    def _share(self, suffix: str, body: int) -> Dual:
        """A body's parameter for a total of one."""
        ratios = [self.parameter(name_of(shaft, "ratio")) for shaft in self.drive.shafts]
        return body_shares(suffix, self.own_masses, list(accumulate([self.number(1.0), *ratios], mul)))[body]

    def of_shaft(self, shaft: int, suffix: str) -> Dual:
        """A shaft's parameter."""
        return self.parameter(name_of(self.drive.shafts[shaft], suffix))

    def acts(self, body: int, suffix: str) -> bool:
        """Whether a body's effect is present: not neutral, or free."""
        return name_of(self.drive.bodies[body], suffix) in self.acting

    def _needs_angle(self) -> bool:
        """Whether a torque depends on the angle."""
        return any(effect.over_angle and self._is_present(effect, owner)
                   for effect, owner, _ in self.drive.effects())

    def _is_present(self, effect: Effect, owner: str) -> bool:
        """Whether an effect acts: always, by a parameter that is not neutral or is free, or by its total."""
        return not effect.present or any(
            suffix in TOTALS.values() or name_of(owner, suffix) in self.acting for suffix in effect.present)

    def speed(self, body: int) -> int:
        """Column of a body's speed."""
        return body

    def torque(self, row: int, column: int, factor: Dual) -> None:
        """Add factor * z[column] to a row."""
        old = self.rows.get((row, column))
        self.rows[row, column] = factor if old is None else old + factor

    def carry(self, body: int, more: Dual) -> None:
        """Add to the mass that a body's torques accelerate."""
        self.masses[body] = self.masses[body] + more

    def friction(self, body: int, level: Dual) -> None:
        """Set-valued friction of a level on a body; levels add up."""
        self.frictions[body] = self.frictions[body] + level if body in self.frictions else level

    def law(self, torque: Callable, parameters: Sequence[Dual], first: Row, second: Row | None = None, *,
            body: int = -1, shaft: int = -1, slides: bool = False, into: Row | None = None,
            drives: bool = False) -> None:
        """Add a smooth law: a torque on a body, or one in a shaft that acts on both its ends.

        torque         of an effect of the catalogue, called as `Effect.torque`
        body           index of a body; or of another state, whose rate it adds to
        first, second  its arguments over the state
        slides         whether it is friction, which acts while the body slides
        drives         whether it is a torque of the motor, in front of any transmission
        into           rows that it adds to and its factors there, unless it is the torque itself on the body
        """
        if torque not in LAW_TORQUES:
            raise ValueError(f"{torque.__module__} adds a law that its EFFECT does not declare as `torque`")
        self.laws.append(Law(torque, tuple(parameters), first, second or {}, body, shaft, slides, into or {},
                             drives))

    def twist(self, shaft: int) -> Row:
        """Twist of a shaft over the state."""
        return {self.n + shaft: self.number(1.0)}

    def twist_rate(self, shaft: int) -> Row:
        """Rate of the twist of a shaft over the state."""
        return {shaft: 1.0 / self.shafts[shaft][2], shaft + 1: self.number(-1.0)}

    def angle_of(self, body: int) -> Row:
        """Angle of a body over the state."""
        row = {self.states.index("angle"): self.number(1.0)}
        for k in range(body):
            ratio = self.shafts[k][2]
            row = {column: factor / ratio for column, factor in row.items()}
            row[self.n + k] = self.number(-1.0)
        return row

    def damping_of(self, shaft: int) -> Dual:
        """Damping of a shaft in contact."""
        parts = [d[shaft] for d in (self.contact_damping, self.always_damping) if shaft in d]
        return sum(parts[1:], parts[0])

    def closed_shaft(self, shaft: int) -> Row:
        """Torque of a shaft in contact over the state."""
        return {self.n + shaft: self.shafts[shaft][0]} | self._damper(shaft, self.damping_of(shaft))

    def always_transmitted(self, shaft: int) -> Row:
        """Torque of a shaft independent of contact; all of it where there is no gap."""
        if shaft not in self.gaps:
            return self.closed_shaft(shaft)
        return self._damper(shaft, self.always_damping[shaft]) if shaft in self.always_damping else {}

    def transmitted(self, body: int) -> Row:
        """Torque over state and inputs that a transmission passes on to a body at rest, but for a gap's contact.

        Of the first body it is that of the motor: the transmission is behind the rotor.
        """
        if body:
            return self.always_transmitted(body - 1)
        own = {self.motor_column: self.input_gain[0]}
        return own | ({self.states.index("disturbance"): self.number(1.0)} if "disturbance" in self.states else {})

    def in_contact(self, shaft: int) -> Row:
        """Torque of a shaft in the contact of a gap only: its spring, and the damping that is part of it."""
        found = {self.n + shaft: self.shafts[shaft][0]}
        return found | self._damper(shaft, self.contact_damping[shaft]) if shaft in self.contact_damping else found

    def _damper(self, shaft: int, damping: Dual) -> Row:
        return {shaft: damping / self.shafts[shaft][2], shaft + 1: -damping}

    # given by the chain itself

    def _kinematics(self) -> None:
        one = self.number(1.0)
        self.torque(0, self.motor_column, self.input_gain[0])
        for column, role in enumerate(self.layout.inputs[1:], self.nx + 1):
            if role in EFFECT_INPUTS:
                continue
            if role in self.drive.known_torques:
                self.torque(self.drive.bodies.index(owner_of(role)), column, -self.parameter(role))
                continue
            body = self.body_of(role)
            self.torque(body, column, -one if role == "load_torque" else self.input_gain[body])
        for k, (_, _, ratio) in enumerate(self.shafts):
            twist = self.n + k
            self.torque(twist, k, 1.0 / ratio)
            self.torque(twist, k + 1, -one)
            for column, factor in self.always_transmitted(k).items():
                self.torque(k, column, -factor / ratio)
                self.torque(k + 1, column, factor)
        if "angle" in self.states:
            self.torque(self.states.index("angle"), 0, one)
        if "disturbance" in self.states:
            self.torque(0, self.states.index("disturbance"), one)

    def body_of(self, role: str) -> int:
        """Index of the body that a role is measured at or acts on."""
        owner = role.rsplit("_", 1)[0]
        if owner in self.drive.bodies:
            return self.drive.bodies.index(owner)
        if owner == "motor":
            return 0
        if owner == "load":
            return self.drive.bodies.index(self.drive.load)
        raise BadParameters(f"a body called {owner} for the role {role}",
                            f"the {self.drive.name} drive", "Choose another drive or role.",
                            self.drive.bodies)

    def shaft_of(self, role: str) -> int:
        """Index of the shaft whose torque a role is: shaft_torque of the first, others by their name."""
        owner = role.rsplit("_", 1)[0]
        if owner in self.drive.shafts:
            return self.drive.shafts.index(owner)
        if self.shafts and owner == "shaft":
            return 0
        raise BadParameters(f"a drive with a shaft for the role {role}", f"the {self.drive.name} drive",
                            "Use --drive two-mass.", self.drive.shafts)

    def output(self, role: str) -> tuple[dict[int, Dual], int]:
        """(row over the state, gap whose torque adds to it or -1) of a measured role."""
        if role.endswith("torque"):
            k = self.shaft_of(role)
            return self.always_transmitted(k), list(self.gaps).index(k) if k in self.gaps else -1
        body = self.body_of(role)
        one = self.number(1.0)
        if role.endswith("speed"):
            return {self.sensed.get(role, body): one}, -1
        row = self.angle_of(body)
        if f"{role}.zero" in self.states:
            row[self.states.index(f"{role}.zero")] = one
        return row, -1

    def system(self, pieces: int = 1, shortest: float = 0.0) -> System:
        """The arrays for the kernel.

        pieces    number of pieces of every part of a sample
        shortest  least length of the part before the dead time switches, over a sample
        """
        nx, nz, nq = self.nx, self.constant + 1, self.nq
        rows = np.zeros((nx, nz, 1 + nq))
        for (r, j), dual in self.rows.items():
            rows[r, j] = dual.jet()
        spring, relaxing = np.zeros((len(self.gaps), nx, 1 + nq)), np.full((len(self.gaps), 2), -1, np.int64)
        gains, reach = [], []
        for g, (shaft, half) in enumerate(self.gaps.items()):
            for j, dual in self.in_contact(shaft).items():
                spring[g, j] = dual.jet()
            gains += [-1.0 / self.shafts[shaft][2], self.number(1.0)]
            reach.append(self.shafts[shaft][0] * half)
        open_guard = spring.copy()
        for g, shaft in enumerate(self.gaps):
            if shaft in self.relaxing:
                relaxing[g] = self.relaxing[shaft], self.n + shaft
                stiffness = self.shafts[shaft][0].jet()
                open_guard[g] = 0.0
                open_guard[g, relaxing[g]] = -stiffness, stiffness
        outputs, output_gap = self._outputs()
        bodies = sorted(self.frictions)
        losses = sorted(self.losses)
        gaps = list(self.gaps)
        loss_gap = [gaps.index(b - 1) if b - 1 in gaps else -1 for b in losses]
        transmitted = np.zeros((len(losses), nz, 1 + nq))
        for t, b in enumerate(losses):
            for j, dual in self.transmitted(b).items():
                transmitted[t, j] = dual.jet()
        h = self.layout.step
        dead_time = self.number(0.0) if self.dead_time is None else self.dead_time
        samples = dead_time.v / h
        part = max(samples - int(samples + 1e-9), shortest) * h  # as the whole samples are counted
        part_lengths = np.array([h]) if self.dead_time is None else np.array([part, h - part])
        memory = np.ones(nx)
        if self.layout.memory is not None:
            memory[self.states.index("disturbance")] = self.layout.memory
        ns = -(-(nq + nx + self.layout.gradient) // COLUMN_MULTIPLE) * COLUMN_MULTIPLE
        return System(
            rows, self._jets(self.masses + [self.number(1.0)] * (nx - self.n)), spring, open_guard, relaxing,
            self._jets(reach), np.array([(k, k + 1) for k in self.gaps], np.int64).reshape(-1, 2),
            self._jets(gains).reshape(-1, 2, 1 + nq),
            np.array(bodies, np.int64), self._jets([self.frictions[b] for b in bodies]),
            np.array([losses.index(b) if b in losses else -1 for b in bodies], np.int64),
            np.array(loss_gap, np.int64), transmitted,
            self._jets([share for b in losses for share in self.losses[b][:2]]).reshape(-1, 2, 1 + nq),
            self._jets([self.losses[b][2] for b in losses]), outputs, output_gap,
            _output_states(outputs, output_gap), np.repeat(part_lengths, pieces) / pieces,
            (len(part_lengths) - 1) * pieces,
            dead_time.d, memory, nx, self.nu, nq, len(self.gaps), len(bodies), len(losses),
            len(outputs), ns, nx)

    def _jets(self, duals: Sequence[Dual]) -> np.ndarray:
        return np.array([d.jet() for d in duals]).reshape(len(duals), 1 + self.nq)

    def _outputs(self) -> tuple[np.ndarray, np.ndarray]:
        ny = len(self.layout.outputs)
        rows, gap = np.zeros((ny, self.nx, 1 + self.nq)), np.full(ny, -1, np.int64)
        for m, role in enumerate(self.layout.outputs):
            row, gap[m] = self.output(role)
            for j, dual in row.items():
                rows[m, j] = dual.jet()
        return rows, gap


def _output_states(outputs: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(ny,) the state that an output equals, or -1."""
    found = np.full(len(outputs), -1, np.int64)
    for m, rows in enumerate(outputs):
        used = np.flatnonzero(rows.any(axis=1))
        if gap[m] < 0 and used.size == 1 and rows[used[0], 0] == 1.0 and not rows[used[0], 1:].any():
            found[m] = used[0]
    return found
