"""Folds of the cross-validation: which samples a model is fitted to and which it is tested on."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from drivetool.drive.simulation import Trace

BLOCK_LENGTH = 1.5  # s, about: long against the memory of the filter, short against the record
MIN_BLOCKS = 8  # four per half. A choice: fewer leave no estimate of the scatter


def blocks_of(traces: Sequence[Trace], length: float = BLOCK_LENGTH) -> list[tuple[int, int, int]]:
    """(trace, first, last+1) of blocks of about equal length; at least MIN_BLOCKS in all."""
    seconds = sum(t.size * t.step for t in traces)
    length = min(length, seconds / MIN_BLOCKS)
    found = []
    for i, t in enumerate(traces):
        edges = np.linspace(0, t.size, max(1, min(round(t.size * t.step / length), t.size)) + 1).round().astype(int)
        found += [(i, int(a), int(b)) for a, b in pairwise(edges)]
    return found


def halves(traces: Sequence[Trace]) -> list[list[np.ndarray]]:
    """Two stratified halves of the blocks: per half a mask per trace.

    Blocks are sorted by excitation (reversals, standard deviation of the torque, then of the motion), and the
    neighbours of each pair go to different halves, so that neither half has all the reversals.
    """
    blocks = blocks_of(traces)
    excitation = []
    for i, a, b in blocks:
        u, y = traces[i].inputs[a:b, 0], traces[i].outputs[a:b, 0]
        y = y[np.isfinite(y)]
        turns = np.count_nonzero(np.diff(np.sign(y - 0.02 * np.sign(y).mean())) != 0) if len(y) > 1 else 0
        excitation.append((min(turns, 3), float(np.std(u)), float(np.std(y)) if len(y) else 0.0))
    order = sorted(range(len(blocks)), key=lambda k: excitation[k])
    masks = [[np.zeros(t.size, bool) for t in traces] for _ in range(2)]
    for rank, k in enumerate(order):
        i, a, b = blocks[k]
        # 0 1 1 0 0 1 1 0: neither half gets the more excited block of every pair.
        masks[((rank + 1) // 2) % 2][i][a:b] = True
    return masks
