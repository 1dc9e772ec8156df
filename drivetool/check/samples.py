"""Training and test samples: halves of the records, or training records and held-out ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.folds import halves
from drivetool.drive.simulate import Trace
from drivetool.logs.experiment import Experiment

BEGINNING = 0.1  # s


def samples_of(traces: Sequence[Trace], train: Sequence[Experiment], test: Sequence[Experiment],
               ) -> list[tuple[list[np.ndarray], list[np.ndarray]]]:
    """(training, test) masks of every fold: one with held-out records, two from the halves of the others."""
    if not test:
        first, second = halves(traces)
        pairs = [(second, first), (first, second)]
    else:
        stretches = sum(sum(1 for a, b in e.segments if b - a >= 10) for e in train)
        mask = [np.full(t.size, i < stretches) for i, t in enumerate(traces)]
        pairs = [(mask, [~m for m in mask])]
    return [(with_beginnings(first, traces), [m & ~b for m, b in zip(second, beginnings(traces), strict=True)])
            for first, second in pairs]


def beginnings(traces: Sequence[Trace]) -> list[np.ndarray]:
    """The first samples of every trace, which tell its start state: everybody's for training, never tested."""
    return [np.arange(t.size) < max(20, round(BEGINNING / t.step)) for t in traces]


def with_beginnings(masks: Sequence[np.ndarray], traces: Sequence[Trace]) -> list[np.ndarray]:
    """Samples to fit to: the masks, and what the start states need."""
    return [m | b for m, b in zip(masks, beginnings(traces), strict=True)]


def fitted_samples(folds: Sequence[tuple[list[np.ndarray], list[np.ndarray]]]) -> list[np.ndarray]:
    """What a final fit may see: all training samples of all folds."""
    return [np.logical_or.reduce(masks) for masks in zip(*(train for train, _ in folds), strict=True)]
