"""Which samples a model is fitted to and which it is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from drivetool.drive.simulation import Trace

BLOCK = 1.5  # s, about: long against the memory of the filter, short against the record
LEAST = 8  # blocks, four a side


def blocks_of(traces: Sequence[Trace], length: float = BLOCK) -> list[tuple[int, int, int]]:
    """(trace, first, last+1) of blocks of about equal length; at least LEAST in all."""
    seconds = sum(t.size * t.step for t in traces)
    length = min(length, seconds / LEAST)
    found = []
    for i, t in enumerate(traces):
        edges = np.linspace(0, t.size, max(1, round(t.size * t.step / length)) + 1).round().astype(int)
        found += [(i, int(a), int(b)) for a, b in pairwise(edges)]
    return found


def halves(traces: Sequence[Trace]) -> list[list[np.ndarray]]:
    """Two halves of the blocks, alike in what happens in them: per half a mask per trace.

    Blocks are dealt out in pairs of neighbours in liveliness (spread of the torque, then of the
    motion), so that neither half has all the reversals.
    """
    blocks = blocks_of(traces)
    lively = []
    for i, a, b in blocks:
        u, y = traces[i].inputs[a:b, 0], traces[i].outputs[a:b, 0]
        y = y[np.isfinite(y)]
        turns = np.count_nonzero(np.diff(np.sign(y - 0.02 * np.sign(y).mean())) != 0) if len(y) > 1 else 0
        lively.append((min(turns, 3), float(np.std(u)), float(np.std(y)) if len(y) else 0.0))
    order = sorted(range(len(blocks)), key=lambda k: lively[k])
    masks = [[np.zeros(t.size, bool) for t in traces] for _ in range(2)]
    for place, k in enumerate(order):
        i, a, b = blocks[k]
        # 0 1 1 0 0 1 1 0: neither half gets the livelier block of every pair.
        masks[((place + 1) // 2) % 2][i][a:b] = True
    return masks
