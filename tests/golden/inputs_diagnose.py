"""Short records, 4 s at 500 Hz, of machines with hidden effects, and what `diagnose` says of them."""

from __future__ import annotations

from tests.golden.case import Case, case
from tests.golden.machines import hidden

# Effects, machine, bodies, words for `diagnose`, what is logged more.
PLAIN = "-o extended.yaml"
PAGE = "-o extended.yaml --report page.html --plot p1"
FEW = "-o extended.yaml --rounds 1 --explain"
RUNS: tuple[tuple[str, int, int, str], ...] = (
    ("none", 1, 2, PAGE), ("none", 2, 1, f"{PLAIN} --criterion simulation --record record1.parquet start=free"),
    ("none", 3, 3, FEW),
    ("backlash", 4, 2, PAGE), ("backlash", 5, 2, "--json --rounds 2"), ("backlash", 6, 3, FEW),
    ("coulomb-motor", 7, 2, PLAIN), ("coulomb-motor", 8, 1, PAGE), ("coulomb-load", 9, 2, PLAIN),
    ("stribeck-motor", 10, 1, PAGE), ("stribeck-load", 11, 2, f"{FEW} --candidates stribeck-load,coulomb-load"),
    ("asymmetric-friction", 12, 1, PLAIN), ("asymmetric-friction", 13, 2, FEW),
    ("quadratic-drag", 14, 1, PLAIN), ("quadratic-drag", 15, 2, FEW), ("hardening-stiffness", 16, 2, PAGE),
    ("load-dependent-damping", 17, 2, PLAIN), ("third-mass", 18, 2, FEW), ("torque-ripple", 19, 1, PAGE),
    ("torque-ripple", 20, 2, FEW), ("imbalance", 21, 1, PLAIN), ("imbalance", 22, 2, FEW),
    ("dead-time", 23, 2, PLAIN), ("converter-lag", 24, 2, FEW), ("speed-filter", 25, 2, PLAIN),
    ("quantisation", 26, 2, PLAIN), ("torque-offset", 27, 2, PLAIN), ("load-step", 28, 2, PAGE),
    ("load-step", 29, 1, PLAIN), ("outliers", 30, 2, PLAIN), ("friction-drift", 31, 1, PAGE),
    ("friction-drift", 32, 2, FEW), ("wrong-sign", 33, 2, PLAIN), ("wrong-scale", 34, 2, PLAIN),
    ("wrong-sign-shaft", 35, 2, PLAIN), ("wrong-scale-shaft", 36, 2, FEW),
    ("backlash coulomb-load", 37, 2, f"{FEW} --error-budget 0.05 --seed 3 --strict"),
    ("quadratic-drag torque-ripple", 38, 1, "-o extended.yaml --rounds 2 --holdout holdout.parquet"),
    ("coulomb-motor load-step", 39, 1, "-o extended.yaml -q --debug --condition 'keep from=0.2 to=3.8'"),
    ("asymmetric-friction", 40, 1, "-o extended.yaml --criterion inverse"))


def cases() -> list[Case]:
    """A plain fit, the diagnosis, and its table."""
    found = []
    for effects, seed, bodies, words in RUNS:
        machine = hidden(effects.split() if effects != "none" else [], seed, bodies, duration=4.0)
        name = f"diagnose-{seed:02d}-{effects.replace(' ', '-')}"
        criterion = " --criterion inverse" if "inverse" in words else ""
        found.append(case(name, "diagnose", machine.files, [
            f"drivetool greybox record1.parquet -p start.yaml -o base.yaml{machine.options}{criterion}",
            f"drivetool diagnose record1.parquet -p base.yaml {words}",
            *([] if "--json" in words else ["drivetool show extended.yaml"])]))
    return found
