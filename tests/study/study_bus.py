"""The bus of the literature from acceleration, from a clamped record, and from both in one fit: errors and bounds.

    python -m tests.study.study_bus 20

Per experiment and parameter: how many of the records have the truth within three stated standard deviations, how
many within the 95 % interval, and the median of the stated std over the Cramer-Rao bound of the record.

The bound is that of a Gaussian mean: torque noise is white and held over a sample, so that the noise of the speed
has the covariance s^2 I + q^2 G G', with G from the response to one sample of torque. Derivatives of the mean are
differences of the simulator's noise-free runs; the start state is not known to it either.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from scipy.linalg import cho_factor, cho_solve, toeplitz

from tests.bus_fixtures import BUS as TRUE
from tests.hidden.command import run
from tests.places import FIXTURES
from tests.simulator.machine import Machine, State, running
from tests.simulator.papers import (
    BUS,
    BUS_NOISE,
    BUS_OFFSET,
    BUS_STEP,
    MASS,
    RADIUS,
    WHEELS,
    bus_record,
    bus_torque,
)
from tests.simulator.simulate import simulate_linear
from tests.study.shared.command import write

FIRST_SEED = 990_000
ROUNDING = 1e-2  # of the logged speed
RATIO = BUS.ratio[0]
TRUTH = {"motor.inertia": 4.5, "wheels.carried_mass": MASS, "shaft.stiffness": 1520e3, "shaft.damping": 3600.0,
         "motor.coulomb": 0.0, "total.viscous": 0.02 + 40.0 / RATIO**2,
         "total.idle_torque": TRUE["wheels.idle_torque"] / RATIO}
# Parameters that each experiment estimates; the rest is known to it.
ESTIMATED = {"acceleration": ("wheels.carried_mass", "total.viscous", "total.idle_torque"),
         "clamped": ("motor.inertia", "shaft.stiffness", "shaft.damping", "motor.coulomb"), "both": tuple(TRUTH)}


def machine_of(values: Mapping[str, float], held: bool) -> Machine:
    """The bus with some values; the friction sums stand at the wheels but for the motor's own 0.02."""
    v = {**TRUTH, **values}
    wheels = 1e12 if held else WHEELS + v["wheels.carried_mass"] * RADIUS**2
    viscous, idle = (v["total.viscous"] - 0.02) * RATIO**2, v["total.idle_torque"] * RATIO
    return replace(BUS, inertia=(v["motor.inertia"], wheels), viscous=(0.02, 0.0 if held else viscous),
                   idle_torque=() if held else (0.0, idle), stiffness=(v["shaft.stiffness"],),
                   damping=(v["shaft.damping"],))


def setup(kind: str) -> tuple[np.ndarray, State]:
    """(torque, start state) of an experiment."""
    if kind == "clamped":
        torque = bus_torque("prbs", 507)
        return torque, State((0.0, 0.0), (BUS_OFFSET * RATIO / BUS.stiffness[0],), 0.0, BUS_OFFSET)
    n = round(12.0 / BUS_STEP)
    return np.concatenate([np.full(n, 450.0), np.zeros(n)]), running(BUS, 20.0)


def mean_of(kind: str, values: Mapping[str, float], start: Sequence[float]) -> np.ndarray:
    """(n,) noise-free speed; start: motor speed, twist, and, where the wheels turn, theirs."""
    torque, _ = setup(kind)
    if dry := values.get("motor.coulomb", 0.0):  # so little that the direction of the motion stays as it is
        torque = torque - dry * np.sign(mean_of(kind, {}, start))
    state = State((start[0], start[2] if len(start) > 2 else 0.0), (start[1],), 0.0, torque[0])
    machine = machine_of(values, kind == "clamped")
    return simulate_linear(machine, torque, BUS_STEP, state, np.zeros(len(torque))).speeds[:, 0]


def information(kind: str, names: Sequence[str]) -> np.ndarray:
    """(k, k) Fisher information of a record on some parameters, start states eliminated."""
    torque, begin = setup(kind)
    start = [begin.speeds[0], begin.twists[0]] + ([] if kind == "clamped" else [begin.speeds[1]])
    columns = []
    for name in names:
        step = 1e-4 * abs(TRUTH[name] or 1.0)
        ends = [mean_of(kind, {name: TRUTH[name] + side * step}, start) for side in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    for i, size in enumerate((1e-2, 1e-6, 1e-2)[:len(start)]):
        ends = [mean_of(kind, {}, [s + side * size * (j == i) for j, s in enumerate(start)])
                for side in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    one = simulate_linear(machine_of({}, kind == "clamped"), np.zeros(len(torque)), BUS_STEP,
                          State((0.0, 0.0), (0.0,), 0.0, 0.0), np.eye(1, len(torque))[0]).speeds[:, 0]
    still = simulate_linear(machine_of({}, kind == "clamped"), np.zeros(len(torque)), BUS_STEP,
                            State((0.0, 0.0), (0.0,), 0.0, 0.0), np.zeros(len(torque))).speeds[:, 0]
    response = toeplitz(one - still, np.zeros(len(torque)))
    noise = BUS_NOISE[0] ** 2 * response @ response.T
    noise[np.diag_indices(len(torque))] += BUS_NOISE[1] ** 2 + ROUNDING**2 / 12.0
    slopes = np.array(columns).T
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    whole = (slopes / size).T @ cho_solve(cho_factor(noise), slopes / size) * np.outer(size, size)
    k = len(names)
    return whole[:k, :k] - whole[:k, k:] @ np.linalg.solve(whole[k:, k:], whole[k:, :k])


def bounds(experiment: str) -> dict[str, float]:
    """Cramer-Rao bound of the std of each parameter."""
    names = ESTIMATED[experiment]
    kinds = ("clamped", "acceleration") if experiment == "both" else (experiment,)
    found = np.linalg.inv(sum(information(kind, names) for kind in kinds))
    return dict(zip(names, np.sqrt(np.diag(found)).tolist(), strict=True))


def fitted(experiment: str, seed: int, folder: Path) -> Mapping[str, Mapping]:
    """The parameters that the command line finds in an experiment of its own."""
    for i, kind in enumerate(("clamped", "acceleration")):
        torque, start = setup(kind)
        write(BUS_STEP, {role: np.asarray(values) for role, (values, _) in bus_record(
            torque, start, seed + i, machine_of({}, kind == "clamped")).items()}, folder / f"{kind}.parquet")
    given = ["--params", FIXTURES / "bus" / "drive.yaml", "--out", "found.yaml", "--quiet"]
    clamp = ["--record", "clamped.parquet", "clamped=wheels"]
    if experiment == "acceleration":
        words = ["steady", "acceleration.parquet", "--method", "acceleration", "--set", "motor.inertia=4.5", *given]
    elif experiment == "clamped":
        words = ["greybox", "clamped.parquet", *clamp, *given]
    else:
        words = ["greybox", "clamped.parquet", "acceleration.parquet", *clamp, *given]
    run(folder, words)
    return yaml.safe_load((folder / "found.yaml").read_text())["parameters"]


def main(count: int) -> None:
    for experiment, names in ESTIMATED.items():
        least, within, held, ratios = bounds(experiment), dict.fromkeys(names, 0), dict.fromkeys(names, 0), {}
        for k in range(count):
            with tempfile.TemporaryDirectory() as room:
                found = fitted(experiment, FIRST_SEED + 10 * k, Path(room))
            for name in names:
                value, std = found[name]["value"], found[name]["std"] or np.nan
                low, high = found[name]["ci95"] or (np.nan, np.nan)
                on_bound = found[name]["status"] == "at-bound" and low <= TRUTH[name] <= high
                within[name] += on_bound or abs(value - TRUTH[name]) < 3.0 * std
                held[name] += low <= TRUTH[name] <= high
                ratios.setdefault(name, []).append(std / least[name])
        print(f"\n{experiment}, {count} records")
        for name in names:
            print(f"{name:<22} 3 std {within[name]:>3}  95 % {held[name]:>3}  bound {least[name]:.4g}  "
                  f"stated over bound {np.nanmedian(ratios[name]):.2f} (worst {np.nanmax(ratios[name]):.2f})")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
