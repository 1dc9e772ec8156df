"""Memory is bounded by the number of samples, whatever their time stamps say."""

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drivetool.check.heldout.folds import blocks_of
from drivetool.drive import two_mass
from drivetool.drive.simulation import Trace
from drivetool.errors import BadRecording, NotEnoughData
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.laws.law_selection import select_laws, with_laws
from drivetool.identify.laws.laws import law_library
from drivetool.identify.motion.motion import motions_of
from drivetool.identify.setup.setup import roles_of, traces_of
from drivetool.identify.setup.task import Task
from drivetool.logs import Channel, Recording
from drivetool.logs.door.build import build_experiment
from tests.identify.test_law_selection import drawn
from tests.recover import experiment

N, STEP, PAUSE = 1000, 1e-3, 180.0  # samples, s, s
MOST = 100e6  # bytes, beyond what the same samples take with right stamps


@pytest.fixture
def peak():
    """Bytes at most in memory since the test began."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


def record(time, torque_time=None):
    phase = np.arange(len(time))
    channels = {"motor_torque": Channel(time if torque_time is None else torque_time, np.sin(0.1 * phase), "Nm"),
                "motor_speed": Channel(time, 10.0 + np.cos(0.1 * phase), "rad/s")}
    return Recording("log.parquet", "0" * 64, channels)


@pytest.mark.parametrize("step", [1.0, 1e3, 1e9])
def test_pieces_of_a_fit(peak, step):
    e = experiment(np.sin(np.arange(N)), np.cos(np.arange(N)), step=step)
    with pytest.raises(NotEnoughData, match=r"pieces of 2 s, a sample every 1\S* s\. Check the time st"):
        traces_of([e], roles_of([e], two_mass()), 2.0)
    assert peak() < 1e6


@pytest.mark.parametrize("step", [STEP, 1.0, 1e9])
def test_blocks_of_a_cross_validation(peak, step):
    found = blocks_of([Trace(np.zeros((N, 1)), np.zeros((N, 1)), step)])
    assert found[0][1] == 0 and found[-1][2] == N and all(a[2] == b[1] for a, b in pairwise(found))
    assert len(found) <= N and peak() < 1e6


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_clocks_in_different_units(peak, unit):
    time = np.arange(N) * STEP
    try:
        build_experiment(record(time, unit * time))
    except BadRecording as error:
        assert "time stamps" in str(error)
    assert peak() < MOST


@pytest.mark.parametrize("time", [
    np.arange(N) * 1.0, np.arange(N) * 1e3, *(np.arange(N) * STEP + length * (np.arange(N) >= at)
                                              for length in (PAUSE, 900.0, 86400.0, 3e7) for at in (500, N - 1))])
def test_stamps_far_apart(peak, time):
    try:
        build_experiment(record(time))
    except BadRecording as error:
        assert "time stamps" in str(error)
    assert peak() < MOST


def test_laws_over_a_pause(peak):
    task = drawn("white", "", 0, 50)
    e = task.experiments[0]
    pause = np.full(round(PAUSE / STEP), np.nan)
    paused = replace(e, segments=((0, e.size // 2), (e.size // 2 + len(pause), e.size + len(pause))), signals={
        role: np.concatenate([v[:e.size // 2], pause, v[e.size // 2:]]) for role, v in e.signals.items()})
    task = Task(task.drive, task.free, task.roles, (paused,))
    fit = by_innovations(task, [{}])
    laws = law_library(motions_of(task.experiments, task.roles.outputs[0]), True)
    assert len(laws) > 30
    select_laws(task, fit.solution.point, fit.fit.noise, laws)
    traces = with_laws(task, laws[:2]).traces()
    assert [t.size for t in traces] == [b - a for a, b in paused.segments]
    assert peak() < MOST
