"""Whether stated intervals hold the truth, judged by the interval of their share."""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest


def interval(k, n, confidence):
    """Of a share of which k of n were seen."""
    return binomtest(int(k), n).proportion_ci(confidence)


def distances(line, truth):
    """Error of a parameter over its std and over the part by noise; infinite where none is stated."""
    stds = (line.std or 0.0, (line.std if line.std_noise is None else line.std_noise) or 0.0)
    return [abs(line.value - truth) / std if std else np.inf for std in stds]


def judge_coverage(found):
    """The mean by noise lies between 0.92 and 0.97 unless its whole 99 % interval is beyond; none lies below 0.92.

    The interval counts the parameters of one record as independent, so it is rather too narrow.

    found  name -> (records, 2) distances
    """
    for name, rows in found.items():
        (ci95, noise), n = (rows < 1.96).sum(axis=0), len(rows)
        print(f"\n{name}: by ci95 {ci95}, by noise {noise} of {n}; rms of error over std "
              f"{np.sqrt(np.mean(rows**2, axis=0)).round(2)}, most {rows.max(axis=0).round(1)}", end="")
    within, n = (np.concatenate(list(found.values())) < 1.96).sum(axis=0), sum(map(len, found.values()))
    for part, k in zip(("ci95", "noise"), within, strict=True):
        low, high = interval(k, n, 0.99)
        print(f"\n{part}: {k} of {n}, {k / n:.3f}, 99 % interval {low:.3f} to {high:.3f}")
        assert high > 0.92 and (part == "ci95" or low < 0.97)
    assert all(interval((rows[:, 1] < 1.96).sum(), len(rows), 1.0 - 0.01 / len(found))[1] > 0.92
               for rows in found.values())
