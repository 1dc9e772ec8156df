"""Training and test samples: halves of the records, or training records and held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drivetool.check.folds import blocks_of, halves
from drivetool.drive.chain import Drive
from drivetool.drive.linearise import resonances
from drivetool.drive.simulate import Trace
from drivetool.logs.experiment import Experiment

BEGINNING = 0.1  # s, at least
PERIODS = 2.0  # of the slowest resonance or anti-resonance, after which a start state is told
MOST = 0.5  # of a block that a beginning may take


class Samples(NamedTuple):
    """Per trace a mask (n,) of samples of one fold.

    train  that a model is fitted to; test: that it is judged by
    again  the test samples and what the start states need: to fit a model to those
    """

    train: list[np.ndarray]
    test: list[np.ndarray]
    again: list[np.ndarray]


def samples_of(traces: Sequence[Trace], train: Sequence[Experiment], test: Sequence[Experiment],
               drive: Drive) -> list[Samples]:
    """The samples of every fold: one with held-out records, two from the halves of the others."""
    if not test:
        first, second = halves(traces)
        pairs = [(second, first), (first, second)]
    else:
        stretches = sum(sum(1 for a, b in e.segments if b - a >= 10) for e in train)
        mask = [np.full(t.size, i < stretches) for i, t in enumerate(traces)]
        pairs = [(mask, [~m for m in mask])]
    start = beginnings(traces, drive)
    return [Samples([m | b for m, b in zip(first, start, strict=True)],
                    [m & ~b for m, b in zip(second, start, strict=True)],
                    [m | b for m, b in zip(second, start, strict=True)]) for first, second in pairs]


def beginnings(traces: Sequence[Trace], drive: Drive) -> list[np.ndarray]:
    """The first samples of every trace, which tell its start state: everybody's for training, never tested.

    A start state that its own samples do not tell would be chosen by what comes long after, and spoil the rest of
    the first block.
    """
    slowest = min((mode.frequency_hz for mode in resonances(drive)), default=np.inf)
    _, first, last = blocks_of(traces)[0]
    seconds, most = max(BEGINNING, PERIODS / slowest), MOST * (last - first)
    return [np.arange(t.size) < max(20, round(min(seconds / t.step, most))) for t in traces]


def fitted_samples(folds: Sequence[Samples]) -> list[np.ndarray]:
    """What a final fit may see: all training samples of all folds."""
    return [np.logical_or.reduce(masks) for masks in zip(*(fold.train for fold in folds), strict=True)]


def held_out(folds: Sequence[Samples]) -> list[np.ndarray]:
    """Per trace the samples of records that only judge; none where halves of all records judge in turn."""
    if len(folds) != 1:
        return []
    return [again & test.any() for again, test in zip(folds[0].again, folds[0].test, strict=True)]
