"""Recorded machines, from the folder that DRIVETOOL_RECORDS names, cut to what is quick."""

from __future__ import annotations

import io
import os
from pathlib import Path

from tests.golden.case import Case, case, tool

MAPS = {
    "emps": b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: {channel: force, unit: N}\n"
            b"  motor_angle: {channel: q, unit: m}\n  reference_angle: {channel: q_ref, unit: m}\n",
    "bench": b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: {channel: iq, unit: A}\n"
             b"  motor_angle: {channel: theta_m, unit: rad}\n  load_angle: {channel: theta_l, unit: rad}\n",
    "damper": b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: {channel: force, unit: N}\n"
              b"  motor_angle: {channel: displacement, unit: m}\n",
    "actuator": b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: {channel: current, unit: A}\n"
                b"  motor_angle: {channel: position, unit: mm}\n",
}
EMPS = b"schema: drivetool/parameters/1\ndrive: {bodies: [motor], shafts: []}\nparameters:\n" \
       b"  motor.inertia: {value: 80, unit: kg}\n"
BENCH = b"schema: drivetool/parameters/1\ndrive: {bodies: [motor, load], shafts: [shaft], torque_unit: A}\n" \
        b"parameters:\n  motor.inertia: {value: 0.0008, unit: A s^2/rad}\n" \
        b"  load.inertia: {value: 0.0008, unit: A s^2/rad}\n  shaft.stiffness: {value: 90, unit: A/rad}\n" \
        b"  shaft.damping: {value: 0.002, unit: A s/rad}\n"
DAMPER = b"schema: drivetool/parameters/1\ndrive: {name: two-mass, torque_unit: N, motion_unit: m}\nparameters:\n" \
         b"  {motor.inertia: 1.0, load.inertia: 60.0, load.coulomb: 9000.0, shaft.stiffness: 1.2e6,\n" \
         b"   shaft.damping: 4000.0, shaft.half_gap: 1.2e-3, shaft.hardening: 2.0, " \
         b"shaft.hardening_twist: 2.0e-3,\n   shaft.hardening_power: 1.0}\n"
SITE = b"schema: drivetool/site/1\nrecordings:\n  - {files: 'logs/**/*.parquet', map: map.yaml}\n" \
       b"recipe:\n  - {command: steady --drive one-body}\nbars: []\n"


def cases() -> list[Case]:
    """None without the folder, which is said."""
    place = os.environ.get("DRIVETOOL_RECORDS")
    if not place:
        print("golden: DRIVETOOL_RECORDS is not set: the 5 cases of recorded machines are left out")
        return []
    folder = Path(place)
    return [_emps(folder), _bench(folder), *_dampers(folder), _actuators(folder)]


def cut(path: Path, duration: float) -> bytes:
    """The first seconds of a recording, units kept."""
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    kept, sink = table.slice(0, sum(t <= duration for t in table["time"].to_pylist())), io.BytesIO()
    pq.write_table(kept, sink, compression="zstd", use_dictionary=False)
    return sink.getvalue()


def _emps(folder: Path) -> Case:
    files = {"emps.parquet": cut(folder / "emps.parquet", 8.0), "whole.parquet": folder / "emps.parquet",
             "map.yaml": MAPS["emps"], "start.yaml": EMPS}
    return case("measured-emps", "measured", files, tool([
        "inspect whole.parquet -m map.yaml -o inspect.yaml",
        "greybox whole.parquet -m map.yaml -p start.yaml --criterion inverse -o inverse.yaml",
        "greybox emps.parquet -m map.yaml -p start.yaml --condition 'decimate factor=2' -o greybox.yaml",
        "validate whole.parquet -m map.yaml -p inverse.yaml -p greybox.yaml --segment 1 -o validate.yaml",
        "diagnose emps.parquet -m map.yaml -p inverse.yaml --criterion inverse -o diagnosis.yaml --explain"]))


def _bench(folder: Path) -> Case:
    files = {"bench.parquet": cut(folder / "motorbench-a.parquet", 2.0), "map.yaml": MAPS["bench"],
             "start.yaml": BENCH}
    return case("measured-bench", "measured", files, tool([
        "inspect bench.parquet -m map.yaml --json",
        "spectra bench.parquet -m map.yaml --method periodic --period 1 -o spectra.yaml --plot p1",
        "blackbox bench.parquet -m map.yaml --structure oe --order 3 -o blackbox.yaml",
        "greybox bench.parquet -m map.yaml -p start.yaml --condition 'keep from=0 to=1' -o greybox.yaml",
        "simulate bench.parquet -m map.yaml -p greybox.yaml --segment 0.5 -o simulated.parquet"]))


def _dampers(folder: Path) -> list[Case]:
    return [case(f"measured-damper-{name}", "measured", {
        "damper.parquet": cut(folder / f"damper-{name}.parquet", 4.0), "map.yaml": MAPS["damper"],
        "start.yaml": DAMPER}, tool([
        "greybox damper.parquet -m map.yaml -p start.yaml --criterion inverse --free shaft.half_gap "
        "--free shaft.hardening --hold motor.inertia --hold motor.viscous --hold motor.coulomb -o inverse.yaml",
        "validate damper.parquet -m map.yaml -p inverse.yaml --criterion inverse"])) for name in "ac"]


def _actuators(folder: Path) -> Case:
    """A site of them: each looked at only, for there is no torque at this rate."""
    files: dict[str, Path | bytes] = {"site.yaml": SITE, "map.yaml": MAPS["actuator"]}
    for path in sorted((folder / "actuator-site").glob("rig-[ab]/000[1-4].parquet")):
        files[f"logs/{path.parent.name}/{path.name}"] = path
    return case("measured-actuators", "measured", files, tool([
        "inspect logs/rig-a/0001.parquet -m map.yaml", "init logs -o first.yaml",
        "steady logs/rig-a/0001.parquet -m map.yaml --drive one-body -o steady.yaml",
        "batch site.yaml -q --workers 1"]))
