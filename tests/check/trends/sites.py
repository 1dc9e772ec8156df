"""Rows of a made-up site, for tests: every machine with the same parameters, some of them changed."""

import numpy as np

from drivetool.logs.formats import Row

# Name -> value, unit; one standard deviation from recording to recording is a 60th of the value.
PARAMETERS = {"shaft.half_gap": (2e-3, "rad"), "motor.viscous": (0.4, "Nm s/rad"), "motor.coulomb": (1.5, "Nm"),
              "motor.inertia": (0.01, "kg m^2"), "derived.total_inertia": (0.03, "kg m^2")}
SD = 1.0 / 60.0
BEGAN, EVERY = 1772323200.0, 2 * 86400.0  # 1 March 2026 0:00 UTC, and two days [s]


def normal(rng, n):
    return rng.normal(size=n)


def student(degrees):
    return lambda rng, n: rng.standard_t(degrees, size=n)


def autoregressive(pole):
    """Unit variance, neighbours correlated by the pole."""
    def noise(rng, n):
        found = rng.normal(size=n)
        for i in range(1, n):
            found[i] = pole * found[i - 1] + np.sqrt(1.0 - pole**2) * found[i]
        return found
    return noise


def site(seed, noise=normal, machines=8, n=25, changed=None, dated=True, stated=0.6):
    """Rows of a site.

    changed  (machine, parameter) -> (n,) what is added, in standard deviations
    stated   std of each row in standard deviations
    """
    rng, rows, changed = np.random.default_rng(seed), [], changed or {}
    for machine in range(1, machines + 1):
        for parameter, (value, unit) in PARAMETERS.items():
            more = np.asarray(changed.get((machine, parameter), 0.0))
            values = value * (1.0 + SD * (noise(rng, n) + more))
            rows += [Row(f"press {machine}/{i:02d}.parquet", f"press {machine}",
                         BEGAN + EVERY * i if dated else None, i, "greybox", parameter, float(v), unit,
                         stated * SD * value, "fitted") for i, v in enumerate(values)]
    return rows


def step(size, place, n=25):
    return size * (np.arange(n) >= place)


def reported(findings):
    """The findings of changes, of alarms and smaller ones."""
    return [f for f in findings if f.code in ("trend-alarm", "small-change")]
