"""Every peer reaches the optimum of the main job; then one table of what each takes, in one run.

Nothing here asserts a time: machines differ, and so does what else they do.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivetool.identify.fit import by_simulation
from drivetool.identify.noise import Noise, filtered
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import Task, first_point
from drivetool.identify.starts import continue_in_process_noise
from tests.bench import floor
from tests.bench.descent import NAMES, TOLERANCE, Reached, descend, main_job
from tests.bench.peer_casadi import CasadiPeer
from tests.bench.peer_jax import JaxPeer
from tests.bench.peer_numba import NumbaPeer
from tests.bench.peer_numpy import NumpyPeer
from tests.bench.peer_scipy import seconds_per_residual
from tests.bench.records import CASES
from tests.bench.test_convergence import task_of

pytestmark = pytest.mark.bench

PEERS = {"numba RK4": (NumbaPeer, "numba"), "JAX scan RK4": (JaxPeer, "jax"),
         "CasADi RK4, gcc -O3": (CasadiPeer, "casadi"), "NumPy batch RK4": (NumpyPeer, "numpy")}
MIN_TIME_RATIO = {"numba RK4": 4, "JAX scan RK4": 4, "CasADi RK4, gcc -O3": 10, "NumPy batch RK4": 40}
ROUNDS = 3  # of each, in turn, so that a busy machine is busy for all


@cache
def peer(name: str):
    """The peer, compiled; skips where its package is missing."""
    made, package = PEERS[name]
    pytest.importorskip(package, reason=f"{package} is not installed: pip install .[bench]")
    job = main_job()
    ready = made(job)
    ready.outputs(job.start, job.starts, np.zeros(3))
    ready.sensitivities(job.start, job.starts, np.zeros(3))
    return ready


@cache
def reference() -> float:
    """Cost of the fit started at the truth."""
    case = CASES["main"]
    return by_simulation(task_of(case, case.start()), 2.0, [{}]).solution.cost


def started(job) -> Task:
    """The job as the tool's own task."""
    case = CASES["main"]
    return task_of(case, case.start().with_values(dict(zip(NAMES, job.start.tolist(), strict=True))))


def ours(job) -> Reached:
    """One descent by the tool itself, from the same start."""
    task = started(job)
    problem, linear = task.problem(2.0), task.linear_problem(2.0)
    point = Point(first_point(task.drive, problem, task.roles).values, tuple(job.starts))
    point, _ = continue_in_process_noise(problem, linear, point, 10.0)
    solution = solve(problem, point, relative=TOLERANCE, max_iterations=30)
    values = dict(zip(task.free, solution.point.values.tolist(), strict=True))
    return Reached(np.array([values[n] for n in NAMES]), solution.cost, 0, 0)


def check(reached: Reached) -> None:
    job = main_job()
    assert reached.cost < 1.02 * reference()
    assert np.all(np.abs(reached.values / job.truth - 1.0) < 0.05)


def test_the_tool_reaches_the_optimum_in_one_descent():
    check(ours(main_job()))


@pytest.mark.parametrize("name", PEERS)
def test_peer_reaches_the_same_optimum(name):
    check(descend(peer(name), main_job()))


def seconds(call: Callable[[], object]) -> float:
    """Processor time, of all threads: a busy machine stretches the time on the wall."""
    began = time.process_time()
    call()
    return time.process_time() - began


def lowest(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least time of each, taken in turn: what else the machine does comes on top."""
    for call in calls.values():
        call()
    taken = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            taken[name].append(seconds(call))
    return {name: min(t) for name, t in taken.items()}


def test_table_of_fit_times():
    """Each peer against the tool, run in turn with it."""
    job, installed, missing = main_job(), {}, []
    for name in PEERS:
        try:
            installed[name] = peer(name)
        except pytest.skip.Exception:
            missing.append(name)
    print("\n\nmain job, one descent of each   CPU s   times ours   wanted")
    count, ratios = None, {}
    for name, ready in installed.items():
        slow = name.startswith("NumPy")
        took = lowest({"ours": lambda: ours(job), name: lambda r=ready: descend(r, job)}, 1 if slow else ROUNDS)
        print(f"  {name:<28} {took[name]:8.2f} {took[name] / took['ours']:12.1f} {MIN_TIME_RATIO[name]:8d}   "
              f"(ours {took['ours']:.2f} s)")
        ratios[name] = took[name] / took["ours"]
        count = count or descend(ready, job)
    own = lowest({"ours": lambda: ours(job)}, ROUNDS)["ours"]
    if count is not None:
        reckoned = seconds_per_residual(job) * (count.simulations + 11 * count.jacobians)
        print(f"  {'solve_ivp, extrapolated':<28} {reckoned:8.0f} {reckoned / own:12.0f} {1000:8d}   "
              f"({count.jacobians} Jacobians of 11 differences, {count.simulations} residuals)")
    task = started(job)
    whole = lowest({"search": lambda: by_simulation(task, 2.0, [{}])}, ROUNDS)["search"]
    print(f"  the tool looking around and making a second descent: {whole:.2f} s")
    print(f"  {len(missing)} peers not installed {missing}", flush=True)
    assert ratios and all(ratio > MIN_TIME_RATIO[name] for name, ratio in ratios.items()), ratios


DRAG = "load.drag"


def kernel_calls(name: str, law: str = "", most: int | None = None) -> dict[str, Callable[[], object]]:
    """Passes of the kernel over a record, one trace; with a smooth law, whose amplitude is free too.

    most  parameters that are free; None: all of the case
    """
    case = CASES[name]
    task = task_of(case, case.start())
    task = replace(task, free=task.free[:most])
    name = name if most is None else f"{name} with {most} free"
    if law:
        task = replace(task, drive=task.drive.with_values({law: 0.05}), free=(*task.free, law))
        name = f"{name} with {law}"
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    trace, start = problem.traces[0], point.starts[0]
    plain, full = problem.plants(point.values, False)[0], problem.plants(point.values, True)[0]
    return {f"{name}: simulation": lambda: plain.outputs(trace, start),
            f"{name}: sensitivities": lambda: full.jacobian(trace, start),
            f"{name}: Kalman pass": lambda: filtered(problem, point, Noise(3.0, None, problem.scale), keep=False)}


def test_table_of_kernel_times():
    """Per sample, against the floor of the same run, and three masses against two."""
    sizes = {n: CASES[n].record().size for n in ("main", "three")}
    count = len(CASES["main"].free)
    calls = kernel_calls("main") | kernel_calls("three") | kernel_calls("main", DRAG)
    calls |= kernel_calls("three", most=count)
    n = sizes["main"]
    calls["floor: recursion"] = floor.recursion(n)
    if (vectorised := floor.with_sensitivities(n)) is not None:
        calls["floor: C, 11 sensitivities"] = vectorised
    took = lowest(calls, 15)
    each = {k: 1e9 * v / sizes.get(k.split(":")[0].split()[0], n) for k, v in took.items()}
    print("\n\nkernel, ns per sample")
    for name, value in each.items():
        print(f"  {name:<30} {value:8.1f}")
    missed = []

    def compared(name: str, ratio: float, most: float) -> None:
        """Print a ratio beside the largest that is wanted."""
        print(f"  {name:<50} {ratio:8.1f}   wanted {most:.3g}")
        if ratio > most:
            missed.append(name)

    compared("simulation over floor", each["main: simulation"] / each["floor: recursion"], 5)
    if vectorised is not None:
        compared("sensitivities over floor", each["main: sensitivities"] / each["floor: C, 11 sensitivities"], 5)
    for what in ("simulation", "sensitivities"):
        compared(f"three masses over two, {what}", each[f"three: {what}"] / each[f"main: {what}"], 2.5)
    compared("the same with as many free parameters",
             each[f"three with {count} free: sensitivities"] / each["main: sensitivities"], 2.5)
    compared("smooth law with sensitivities over the recursion",
             each[f"main with {DRAG}: sensitivities"] / each["floor: recursion"], 500 / 4.4)
    assert not missed


def test_cost_is_linear_in_samples():
    """Normal equations of 7.2 million samples: time per sample and peak memory."""
    import resource

    case = CASES["main"]
    task = task_of(case, case.start())
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    one = problem.traces[0]
    each: list[float] = []
    print("\n\nnormal equations            samples   ns per sample   peak MB of the process")
    for times in (1, 10, 300):
        long = replace(one, inputs=np.tile(one.inputs, (times, 1)), outputs=np.tile(one.outputs, (times, 1)))
        wide = replace(problem, traces=(long,))
        taken = min(seconds(lambda w=wide: w.normal(point)) for _ in range(2))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"  free run             {long.size:12d} {1e9 * taken / long.size:15.0f} {peak:14.0f}")
        each.append(taken / long.size)
    assert max(each) < 1.5 * each[0]  # a busy machine varies by a third; anything that grows with the record shows
