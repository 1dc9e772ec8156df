"""The black-box model: motor speed over motor torque as a transfer function.

Two masses: G = (b2 s^2 + b1 s + b0) / ((s + p) (s^2 + a2 s + a1)); one body: G = b / (s + p). The
thesis has p = 0, a pure integrator. Here p = viscous friction over total inertia where the friction
is known or fitted: with every body's friction in proportion to its inertia the pole moves from zero
to -p and nothing else changes its form. The model runs in the kernel, hence with exact hold,
exact sensitivities and the noise model of every other fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import COLUMN_MULTIPLE, Drive, Dual
from drivetool.drive.arrays import System
from drivetool.drive.simulation import Plant, Trace
from drivetool.quantity import name_of

TWO_MASS = ("b2", "b1", "b0", "a2", "a1", "offset")
ONE_BODY = ("b", "offset")
VISCOUS = "viscous"  # name of the friction among the unknowns, where it is one


@dataclass(frozen=True)
class TransferForm:
    """The unknowns of the model, and its known values.

    names      of the unknowns: TWO_MASS or ONE_BODY, then VISCOUS if it is fitted
    signs      of the inputs after the motor torque, all of which act on the last body
    angle      whether the output is the angle, one more integrator
    ratio      of the shaft
    viscous    known friction, referred to the motor [Nm s/rad], where it is not among the names
    bandwidth, damping, lag_order, dead_time  of the converter
    """

    names: tuple[str, ...]
    signs: tuple[float, ...] = ()
    angle: bool = False
    ratio: float = 1.0
    viscous: float = 0.0
    bandwidth: float = np.inf
    damping: float = 0.69
    lag_order: int = 2
    dead_time: float = 0.0

    @property
    def lag(self) -> int:
        """Number of states of the converter."""
        return self.lag_order if np.isfinite(self.bandwidth) else 0

    @property
    def order(self) -> int:
        """Of the transfer function to speed."""
        return 3 if "b2" in self.names else 1

    @property
    def states(self) -> int:
        """Number of states with free start values: those of the transfer function, and the angle."""
        return self.order + self.angle

    def seeds(self, values: Sequence[float], size: int | None = None) -> dict[str, Dual]:
        """The unknowns as numbers with their gradients; viscous too where it is known."""
        size = len(self.names) if size is None else size
        found = {VISCOUS: Dual(self.viscous, np.zeros(size))}
        for j, name in enumerate(self.names):
            found[name] = Dual(float(values[j]), np.zeros(size))
            if size:
                found[name].d[j] = 1.0
        return found

    def pole(self, c: Mapping[str, Dual]) -> Dual:
        """p, the rate of decay without torque: friction over inertia [1/s]."""
        if self.order == 1:
            return c[VISCOUS] * c["b"]
        return c[VISCOUS] * c["b0"] / c["a1"]  # a1/b0 is the inertia referred to the motor

    def numerators(self, c: Mapping[str, Dual]) -> tuple[list[Dual], list[Dual]]:
        """Coefficients from s^(order-1) down: of the motor torque, of a torque on the last body."""
        if self.order == 1:
            return [c["b"]], [c["b"]]
        far = [0.0 * c["b2"], (c["b1"] - self.pole(c) * c["b2"]) / self.ratio, c["b0"] / self.ratio]
        return [c["b2"], c["b1"], c["b0"]], far

    def denominator(self, c: Mapping[str, Dual]) -> list[Dual]:
        """Coefficients from s^(order-1) down, the leading one is 1."""
        p = self.pole(c)
        return [p] if self.order == 1 else [c["a2"] + p, c["a1"] + p * c["a2"], p * c["a1"]]

    def response(self, values: Sequence[float], frequency: np.ndarray) -> np.ndarray:
        """(n,) complex G from motor torque to motor speed at frequencies [Hz]."""
        c, s = self.seeds(values, 0), 2j * np.pi * np.asarray(frequency)
        top = np.polyval([d.v for d in self.numerators(c)[0]], s)
        return top / np.polyval([1.0] + [d.v for d in self.denominator(c)], s)

    def rest(self, trace: Trace) -> np.ndarray:
        """Default start state: zero, a converter at the first torque."""
        return np.concatenate([np.zeros(self.states), [trace.inputs[0, 0], 0.0][:self.lag]])

    def build(self, values: np.ndarray, trace: Trace, gradient: bool, memory: float | None) -> Plant:
        """The model ready to run, in observer form: the first state is the speed."""
        lag, m = self.lag, self.order
        nx = self.states + lag + (memory is not None)
        nu = 1 + len(self.signs)
        nq = -(-len(self.names) // COLUMN_MULTIPLE) * COLUMN_MULTIPLE if gradient else 0
        c = self.seeds(values, nq)
        rows = np.zeros((nx, nx + nu + 1, 1 + nq))
        motor, far = self.numerators(c)
        enters = [self.states if lag else nx] + ([nx - 1] if memory is not None else [])
        for i, (bottom, top) in enumerate(zip(self.denominator(c), motor, strict=True)):
            rows[i, 0] = (-bottom).jet()
            if i + 1 < m:
                rows[i, i + 1, 0] = 1.0
            for column in enters:
                rows[i, column] = top.jet()
            for k, sign in enumerate(self.signs, nx + 1):
                rows[i, k] = (sign * far[i]).jet()
            rows[i, -1] = (-top * c["offset"]).jet()
        if self.angle:
            rows[m, 0, 0] = 1.0
        i, w = self.states, self.bandwidth
        if lag == 1:
            rows[i, i, 0], rows[i, nx, 0] = -w, w
        elif lag:
            rows[i, i + 1, 0], rows[i + 1, nx, 0] = 1.0, w * w
            rows[i + 1, [i, i + 1], 0] = -w * w, -2.0 * self.damping * w
        return self._plant(rows, trace.step, gradient, memory)

    def _plant(self, rows: np.ndarray, h: float, gradient: bool, memory: float | None) -> Plant:
        """A system without gaps and frictions."""
        nx, nz, jet = rows.shape
        whole = int(self.dead_time / h + 1e-9)
        part = max(self.dead_time - whole * h, 0.0)
        mass, outputs, keep = np.zeros((nx, jet)), np.zeros((1, nx, jet)), np.ones(nx)
        mass[:, 0] = 1.0
        shown = self.order if self.angle else 0
        outputs[0, shown, 0] = 1.0
        if memory is not None:
            keep[-1] = memory
        none, no_rows, no_jets = np.zeros(0, np.int64), np.zeros((0, nx, jet)), np.zeros((0, jet))
        no_pairs = np.zeros((0, 2, jet))
        ns = -(-(jet - 1 + nx + 1) // COLUMN_MULTIPLE) * COLUMN_MULTIPLE if gradient else nx
        return Plant(System(
            rows, mass, no_rows, no_rows, none.reshape(0, 2), no_jets, none.reshape(0, 2), no_pairs, none, no_jets,
            none, none, np.zeros((0, nz, jet)), no_pairs, no_jets, outputs,
            np.full(1, -1, np.int64), np.full(1, shown, np.int64),
            np.array([part, h - part]) if self.dead_time else np.array([h]), int(bool(self.dead_time)),
            np.zeros(jet - 1), keep,
            nx, nz - nx - 1, jet - 1, 0, 0, 0, 1, ns, nx), delay_samples=whole)


def form_of(drive: Drive, inputs: Sequence[str], angle: bool) -> TransferForm:
    """The model of a drive of one or two bodies, with the friction the drive knows."""
    ratio = drive.value(name_of(drive.shafts[0], "ratio")) if drive.shafts else 1.0
    viscous = drive.values.get("total.viscous", drive.referred_to_motor("viscous"))
    return TransferForm(
        names=TWO_MASS if drive.shafts else ONE_BODY,
        signs=tuple(-1.0 if role == "load_torque" else 1.0 for role in inputs[1:]),
        angle=angle, ratio=ratio, viscous=viscous,
        bandwidth=drive.value("converter.bandwidth"), damping=drive.value("converter.damping"),
        lag_order=int(drive.value("converter.order")), dead_time=drive.value("converter.dead_time"))


def to_physical(form: TransferForm, c: Mapping[str, Dual]) -> dict[str, Dual]:
    """Inertias, stiffness and damping of the closed-form conversion, with gradients.

    form, c  the model and its coefficients; c must be those of a drive: see `impossible`
    returns  motor, load [kg m^2], stiffness [Nm/rad], damping [Nm s/rad], and left_over: b1 less
             its value by the parameters [rad/(Nm s^2)]
    source   Tallfors 2005, (5.11)-(5.16), with p = 0; b1 takes no part
    """
    if form.order == 1:
        return {"motor": 1.0 / c["b"]}
    p = form.pole(c)
    motor, total = 1.0 / c["b2"], c["a1"] / c["b0"]
    load = total - motor
    shaft = c["a2"] - p
    square = form.ratio**2
    return {
        "motor": motor, "load": square * load, "stiffness": square * c["b0"] * motor * load,
        "damping": square * shaft * motor * load / total,
        "left_over": c["b1"] - p * c["b2"] - shaft / total,
    }


def why_impossible(values: Mapping[str, float]) -> str:
    """Why coefficients are not those of a drive, in words; empty if they can be."""
    if "b" in values:
        return "" if values["b"] > 0.0 else (
            "the speed does not rise with a constant torque (b <= 0): the estimated inertia is negative")
    if values["b0"] <= 0.0 or values["a1"] <= 0.0:
        return "the speed does not rise with a constant torque (b0 <= 0): the total inertia is negative"
    if values["b2"] <= 0.0:
        return "the initial acceleration is not positive (b2 <= 0): the motor inertia is negative"
    if values["a1"] * values["b2"] <= values["b0"]:
        return "the total inertia is below the motor inertia (a1/b0 <= 1/b2)"
    return ""
