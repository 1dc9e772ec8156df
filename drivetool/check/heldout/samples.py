"""Training and test samples: halves of the records, or training records and held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.check.fit import Masks
from drivetool.check.heldout.folds import blocks_of, halves
from drivetool.drive import Drive, resonances
from drivetool.drive.simulation import Trace
from drivetool.identify.setup import Roles, traces_of
from drivetool.logs import Experiment

MIN_TRANSIENT = 0.1  # s. A choice: the least time for a start state without resonances
TRANSIENT_PERIODS = 2.0  # of the slowest resonance or anti-resonance, after which a start state is identifiable
MAX_BLOCK_TRANSIENT_SHARE = 0.5  # of a block. A choice: half of it must stay for the test


@dataclass(frozen=True)
class Samples:
    """Per trace a mask (n,) of samples of one fold.

    train  that a model is fitted to; test: that it is tested on
    again  the test samples and the initial transients: to fit a model to those
    """

    train: Masks
    test: Masks
    again: Masks


@dataclass(frozen=True)
class Split:
    """Training and test data.

    traces       of all records, those that are held out last; experiments: the records
    fitted       number of traces that are fitted to
    folds        the samples of every fold
    heads        (traces held out,) number of samples of the initial transient
    """

    traces: tuple[Trace, ...]
    experiments: tuple[Experiment, ...]
    fitted: int
    folds: tuple[Samples, ...]
    heads: tuple[int, ...]

    @property
    def held_out(self) -> bool:
        """Whether records are held out; else each half of the blocks tests the model of the other half."""
        return self.fitted < len(self.traces)

    @property
    def held(self) -> list[np.ndarray]:
        """Per trace (n,) the samples of held-out records; none where two halves are used."""
        return [np.full(t.size, i >= self.fitted) for i, t in enumerate(self.traces)] if self.held_out else []


def split_of(experiments: Sequence[Experiment], train: int, drive: Drive, roles: Roles) -> Split:
    """The records split: one fold with records held out, two from the halves of the others.

    train  number of the records that are fitted to, the first ones
    """
    traces = traces_of(experiments, roles)
    heads = initial_transients(traces, drive)
    if train == len(experiments):
        first, second = halves(traces)
        pairs, count = [(second, first), (first, second)], len(traces)
    else:
        count = sum(sum(1 for a, b in e.segments if b - a >= 10) for e in experiments[:train])
        mask = [np.full(t.size, i < count) for i, t in enumerate(traces)]
        pairs = [(mask, [~m for m in mask])]
    folds = tuple(Samples([m | b for m, b in zip(one, heads, strict=True)],
                          [m & ~b for m, b in zip(other, heads, strict=True)],
                          [m | b for m, b in zip(other, heads, strict=True)]) for one, other in pairs)
    return Split(traces, tuple(experiments), count, folds, tuple(int(b.sum()) for b in heads[count:]))


def initial_transients(traces: Sequence[Trace], drive: Drive) -> list[np.ndarray]:
    """The first samples of every trace, which identify its start state: in all training sets, never tested.

    A start state without these samples would be fitted to later ones, and worsen the rest of the first block.
    """
    slowest = min((mode.frequency_hz for mode in resonances(drive)), default=np.inf)
    _, first, last = blocks_of(traces)[0]
    seconds, longest = max(MIN_TRANSIENT, TRANSIENT_PERIODS / slowest), MAX_BLOCK_TRANSIENT_SHARE * (last - first)
    return [np.arange(t.size) < max(20, round(min(seconds / t.step, longest))) for t in traces]
