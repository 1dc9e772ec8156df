"""A small site: `init`, `batch` with its pages and verdicts, `trend`."""

from __future__ import annotations

import io

import numpy as np

from tests.golden import places
from tests.golden.case import Case, case

N, STEP = 2_000, 0.004
SITE = b"""schema: drivetool/site/1
recordings:
  - {files: 'logs/**/*.parquet'}
recipe:
  - {command: steady --drive one-body}
  - {command: greybox --drive one-body --criterion inverse --set motor.inertia=0.1, params: [steady]}
  - {command: validate --criterion inverse, params: [greybox], judge: next}
bars:
  - {figure: motor.coulomb, at_most: {value: 0.32, unit: Nm}}
  - {findings: no-failure}
"""
JOINT = b"""schema: drivetool/site/1
recordings:
  - {files: 'logs/*/0[1-3].parquet', kind: fit, machine: {folder: 1}}
  - {files: 'logs/*/0[45].parquet', kind: judge}
recipe:
  - {kind: fit, name: each, command: steady --drive one-body}
  - {kind: fit, name: together, params: [each], joint: true,
     command: greybox --drive one-body --criterion inverse --set motor.inertia=0.1}
  - {kind: judge, command: validate --criterion inverse, params: [together]}
bars:
  - {figure: motor.inertia, at_least: {value: 1, unit: kg m^2}}
"""
RECIPE = b"schema: drivetool/site/1\nrecipe:\n  - {command: steady --drive one-body}\n"
MAP = b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: motor_torque\n  motor_speed: motor_speed\n"
CLUSTER = b"""import subprocess
import sys

from distributed import LocalCluster

if __name__ == "__main__":
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        sys.exit(subprocess.call(["drivetool", "batch", "site.yaml", "--scheduler", cluster.scheduler_address]))
"""


def recording(seed: int, coulomb: float, metadata: dict[str, str] | None = None) -> bytes:
    """Both directions at two speeds with ramps between, one body of 0.2 kg m^2."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng, held = np.random.default_rng(seed), N // 4
    speed = np.repeat([10.0, -10.0, 30.0, -30.0], held)
    ramp = np.ones(80) / 80.0
    speed = np.convolve(np.concatenate((np.full(79, speed[0]), speed)), ramp)[79:79 + N]
    torque = 0.2 * np.gradient(speed, STEP) + 0.05 * speed + coulomb * np.sign(speed)
    torque, speed = torque + 0.01 * rng.standard_normal(N), speed + 0.01 * rng.standard_normal(N)
    units = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units.items()],
                       metadata=metadata)
    sink = io.BytesIO()
    pq.write_table(pa.table([np.arange(N) * STEP, torque, speed], schema=schema), sink)
    return sink.getvalue()


def logs() -> dict[str, bytes]:
    """Two machines, one of which changes; one recording that cannot be used."""
    found = {}
    for i, machine in enumerate(("press1", "press2")):
        for k in range(6):
            level = 0.3 + 0.004 * k if machine == "press1" else 0.3 + 0.03 * (k > 3)
            found[f"logs/{machine}/{k + 1:02d}.parquet"] = recording(100 * i + k, level, {"serial": f"a{i}"})
    return found | {"logs/press2/07.parquet": b"no recording"}


def cases() -> list[Case]:
    """By site file, by recipe, again after a change, and the trend of a summary."""
    files = logs()
    good = {path: data for path, data in files.items() if "07" not in path}
    trend = {"summary.parquet": places.ROOT / "fixtures" / "site" / "summary.parquet"}
    return [
        case("site-file", "site", files | {"site.yaml": SITE}, [
            "drivetool batch site.yaml --workers 1 --junit verdicts.xml --markdown verdicts.md",
            "drivetool batch site.yaml --workers 1 --verify --explain",
            "drivetool batch site.yaml --retry -q --junit -",
            "rm site-results/logs/press1/01/steady.yaml; cp logs/press1/02.parquet logs/press1/06.parquet",
            "drivetool batch site.yaml --workers 1 --explain -q", "drivetool trend site-results/summary.parquet",
            "drivetool show site-results/trends.yaml"]),
        case("site-joint", "site", good | {"site.yaml": JOINT}, [
            "drivetool batch site.yaml --workers 1 --markdown - --time-limit 600 --memory-limit 4000 -o results",
            "drivetool trend results/summary.parquet --json -q --alarm 2"]),
        case("site-recipe", "site", good | {"recipe.yaml": RECIPE, "map.yaml": MAP}, [
            "drivetool batch 'logs/**/*.parquet' --recipe recipe.yaml -m map.yaml -o results --workers 2 --debug"]),
        # Whoever starts the cluster knows its address.
        case("site-cluster", "site", good | {"site.yaml": SITE, "cluster.py": CLUSTER}, ["python cluster.py"]),
        case("site-init", "site", files, [
            "drivetool init logs", "drivetool init logs -o site.yaml", "drivetool init logs/press1 -o - -q --debug",
            "drivetool init logs/press1/01.parquet logs/press2/01.parquet -o two.yaml"]),
        case("site-trend", "site", trend, [
            "drivetool trend summary.parquet -o trends.yaml --plot p1 --strict --debug -q",
            "drivetool trend summary.parquet --alarm 2.5 --json"])]
