"""From a drive to the equations the kernel solves: every effect stamps its law.

Rows are torques of the bodies, then rates of the twists and of the signal path. Each number has its derivatives: a
parameter is a Dual over the free ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import mul

import numpy as np

from drivetool.drive.arrays import System
from drivetool.drive.chain import TOTALS, Drive, body_shares
from drivetool.drive.dual import Dual
from drivetool.drive.effects import EFFECTS, FLUXES, VOLTAGES, Effect, torque_constant
from drivetool.drive.shaft_rows import always_transmitted, in_contact
from drivetool.errors import BadParameters
from drivetool.quantity import name_of, owner_of, shared

Row = dict[int, Dual]  # state -> factor
FRICTION_SUFFIXES = frozenset(suffix for effect in EFFECTS for suffix in effect.friction)
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

    name: str
    parameters: tuple[Dual, ...]
    first: Row
    second: Row
    body: int
    shaft: int
    slides: bool


class Assembly:
    """The equations under construction, which effects add to.

    rows          (row, column) -> factor; masses: which the torques of each body accelerate
    shafts        (stiffness, damping, ratio) of each joint; gaps: shaft -> half width of its dead zone
    open_damping  shaft -> damping whether or not it is in contact
    frictions     body -> level of set-valued friction; laws: smooth ones
    dead_time     by which the motor torque acts later [s]
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
        if "converter.bandwidth" in self.acting:
            self.states += ["converter", "converter.rate"][:self.lag_order("converter.order")]
        if self.filters_speed():
            self.states += ["motor_speed.filtered", "motor_speed.filtered.rate"][:self.lag_order("sensor.order")]
        if self.fed_by_voltages():
            self.states += FLUXES
        if layout.memory is not None:
            self.states.append("disturbance")
        self.nx, self.nu = len(self.states), len(layout.inputs)
        self.constant = self.nx + self.nu
        self.rows: dict[tuple[int, int], Dual] = {}
        self.masses: list[Dual] = []
        self.shafts: list[tuple[Dual, Dual, Dual]] = []
        self.gaps: dict[int, Dual] = {}
        self.open_damping: dict[int, Dual] = {}
        self.frictions: dict[int, Dual] = {}
        self.laws: list[Law] = []
        self.dead_time = self.number(0.0)
        for effect, owner, index in drive.effects():
            if self._is_present(effect, owner):
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
        """A body's parameter; a total is distributed by the rule at TOTALS in chain.py."""
        name = name_of(self.drive.bodies[body], suffix)
        scaled = suffix in FRICTION_SUFFIXES and "friction.factor" in self.acting
        factor = self.parameter("friction.factor") if scaled else self.number(1.0)
        for total, part in TOTALS.items():
            if part == suffix and (total in self.drive.values or total in self.layout.free):
                return self.parameter(total) * self._share(suffix, body) * factor
        return self.parameter(name) * factor

    def _share(self, suffix: str, body: int) -> Dual:
        """A body's parameter for a total of one."""
        masses = []
        for name in self.drive.bodies:
            mass, radius = self.parameter(name_of(name, "carried_mass")), self.parameter(name_of(name, "radius"))
            added = self.parameter(name_of(name, "added_inertia"))
            masses.append(self.parameter(name_of(name, "inertia")) + added + mass * radius * radius)
        ratios = [self.parameter(name_of(shaft, "ratio")) for shaft in self.drive.shafts]
        return body_shares(suffix, masses, list(accumulate([self.number(1.0), *ratios], mul)))[body]

    def of_shaft(self, shaft: int, suffix: str) -> Dual:
        """A shaft's parameter."""
        return self.parameter(name_of(self.drive.shafts[shaft], suffix))

    def acts(self, body: int, suffix: str) -> bool:
        """Whether a body's effect is present: not neutral, or free."""
        return name_of(self.drive.bodies[body], suffix) in self.acting

    def filters_speed(self) -> bool:
        """Whether the motor speed is low-pass filtered before it is logged."""
        return "motor_speed" in self.layout.outputs and "sensor.bandwidth" in self.acting

    def fed_by_voltages(self) -> bool:
        """Whether the motor's torque is computed from its stator voltages."""
        return self.acts(0, "magnetizing_inductance")

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

    def law(self, name: str, parameters: Sequence[Dual], first: Row, second: Row | None = None, *,
            body: int = -1, shaft: int = -1, slides: bool = False) -> None:
        """Add a smooth law: a torque on a body, or one in a shaft that acts on both its ends.

        body           index of a body; or of another state, whose rate it adds to
        first, second  its arguments over the state
        slides         whether it is friction, which acts while the body slides
        """
        self.laws.append(Law(name, tuple(parameters), first, second or {}, body, shaft, slides))

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

    def lag_order(self, name: str) -> int:
        """Order of a lag, which cannot be a free parameter."""
        value = self.drive.value(name)
        if value not in self.drive.quantity(name).choice or name in self.layout.free:
            raise BadParameters(f"{name} of 1 or 2, held", "a free parameter" if name in self.layout.free
                                else f"{value:g}", "Correct it.")
        return int(value)

    def lag(self, state: int, source: int, owner: str) -> None:
        """Let a state follow a column as the owner's lag; of order 2 its rate is the next state."""
        bandwidth, damping = (self.parameter(name_of(owner, s)) for s in ("bandwidth", "damping"))
        if self.lag_order(name_of(owner, "order")) == 1:
            self.torque(state, source, bandwidth)
            self.torque(state, state, -bandwidth)
            return
        square = bandwidth * bandwidth
        self.torque(state, state + 1, self.number(1.0))
        self.torque(state + 1, state, -square)
        self.torque(state + 1, state + 1, -2.0 * damping * bandwidth)
        self.torque(state + 1, source, square)

    # given by the chain itself

    def _kinematics(self) -> None:
        one = self.number(1.0)
        if "converter" not in self.states:
            self.torque(0, self.nx, torque_constant.gain(self, 0))
        for column, role in enumerate(self.layout.inputs[1:], self.nx + 1):
            if role in VOLTAGES:
                continue
            if role in self.drive.known_torques:
                self.torque(self.drive.bodies.index(owner_of(role)), column, -self.parameter(role))
                continue
            body = self.body_of(role)
            self.torque(body, column, -one if role == "load_torque" else torque_constant.gain(self, body))
        for k, (_, _, ratio) in enumerate(self.shafts):
            twist = self.n + k
            self.torque(twist, k, 1.0 / ratio)
            self.torque(twist, k + 1, -one)
            for column, factor in always_transmitted(self, k).items():
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
            return always_transmitted(self, k), list(self.gaps).index(k) if k in self.gaps else -1
        body = self.body_of(role)
        one = self.number(1.0)
        if role == "motor_speed" and self.filters_speed():
            return {self.states.index("motor_speed.filtered"): one}, -1
        if role.endswith("speed"):
            return {body: one}, -1
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
        spring = np.zeros((len(self.gaps), nx, 1 + nq))
        gains, reach = [], []
        for g, (shaft, half) in enumerate(self.gaps.items()):
            for j, dual in in_contact(self, shaft, self.drive.damping_law == "inside").items():
                spring[g, j] = dual.jet()
            gains += [-1.0 / self.shafts[shaft][2], self.number(1.0)]
            reach.append(self.shafts[shaft][0] * half)
        outputs, output_gap = self._outputs()
        h = self.layout.step
        samples = self.dead_time.v / h
        part = max(samples - int(samples + 1e-9), shortest) * h  # as the whole samples are counted
        part_lengths = np.array([part, h - part]) if "converter.dead_time" in self.acting else np.array([h])
        bodies = sorted(self.frictions)
        memory = np.ones(nx)
        if self.layout.memory is not None:
            memory[self.states.index("disturbance")] = self.layout.memory
        ns = -(-(nq + nx + self.layout.gradient) // COLUMN_MULTIPLE) * COLUMN_MULTIPLE
        return System(
            rows, self._jets(self.masses + [self.number(1.0)] * (nx - self.n)), spring,
            self._jets(reach), np.array([(k, k + 1) for k in self.gaps], np.int64).reshape(-1, 2),
            self._jets(gains).reshape(-1, 2, 1 + nq),
            np.array(bodies, np.int64), self._jets([self.frictions[b] for b in bodies]), outputs, output_gap,
            _output_states(outputs, output_gap), np.repeat(part_lengths, pieces) / pieces,
            (len(part_lengths) - 1) * pieces,
            self.dead_time.d, memory, nx, self.nu, nq, len(self.gaps), len(self.frictions),
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
