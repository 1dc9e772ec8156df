"""Series of any kind and size have a trend or none, without a warning and with a file."""

import numpy as np
import pytest
import yaml

from drivetool.files.results import dump
from drivetool.logs.formats import Row
from drivetool.site.trends import trends_file, trends_of

KINDS = {
    "normal": lambda rng, n: rng.normal(size=n), "counts": lambda rng, n: rng.integers(0, 3, size=n).astype(float),
    "line": lambda rng, n: np.arange(n) * 1.0, "step": lambda rng, n: (np.arange(n) > n // 2) * 1.0,
    "Cauchy": lambda rng, n: rng.standard_cauchy(size=n), "far from zero": lambda rng, n: 1e9 + rng.normal(size=n),
    "equal": lambda rng, n: np.full(n, 3.0), "zero": lambda rng, n: np.zeros(n),
    "walk": lambda rng, n: np.cumsum(rng.normal(size=n)), "spike": lambda rng, n: (np.arange(n) == n - 1) * 1.0}
STDS = (None, 0.0, 1e-3, 1e3, 1e-160)
CLOCKS = (None, 86400.0, 3600.0, 0.0)  # s from one recording to the next


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [1.0, 1e-120, 1e90])
def test_any_series_ends_in_a_file(kind, scale):
    rng = np.random.default_rng(3)
    for n in (1, 2, 6, 7, 8, 25):
        values = scale * KINDS[kind](rng, n)
        for i, std in enumerate(STDS):
            every = CLOCKS[(n + i) % len(CLOCKS)]
            rows = [Row(f"r{k}", "m", None if every is None else 1.7e9 + every * k, k, "s", "p", float(v), "rad",
                        std and std * scale * (1.0 + rng.random()), "fitted") for k, v in enumerate(values)]
            findings, trends = trends_of(rows)
            series, = yaml.safe_load(dump(trends_file(findings, trends, {})))["series"]
            low, high = series["mean"]["ci95"] or [series["mean"]["value"]] * 2
            assert low <= series["mean"]["value"] <= high
            if kind in ("line", "step") and n == 25 and every != 3600.0:  # two days do not identify a change
                assert [f.code for f in findings if "alarm" in f.code] == ["trend-alarm"]
            if kind in ("equal", "zero", "spike", "normal"):
                assert not series["changes"]
