"""The speed loop: criteria and options of `tune`, and what judges its gains."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import yaml

from tests.golden import places
from tests.golden.case import Case, case, tool
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, running
from tests.simulator.records import write_parquet

RIG = places.ROOT / "fixtures" / "rig"
TWO = {"motor.inertia": 0.587, "motor.viscous": 0.000176, "load.inertia": 5.179, "load.viscous": 0.0017,
       "load.idle_torque": 15.14, "shaft.stiffness": 3310.0, "shaft.damping": 3.115}
GAP = TWO | {"shaft.half_gap": 0.075, "converter.bandwidth": 433.0, "converter.dead_time": 0.002}
FRICTION = TWO | {"motor.coulomb": 2.0, "load.coulomb": 4.0, "load.stribeck": 2.0, "load.stribeck_speed": 0.5,
               "sensor.bandwidth": 500.0}
LAWS = TWO | {"motor.drag": 1e-4, "shaft.hardening": 0.5, "shaft.hardening_twist": 0.06, "shaft.load_damping": 1e-3,
              "motor.viscous_asymmetry": 1e-4, "motor.ripple_sine": 1.0, "motor.ripple_order": 4.0}
ONE = {"motor.inertia": 5.0, "motor.viscous": 0.01, "motor.coulomb": 1.0}
THREE = {"motor.inertia": 0.587, "gear.inertia": 2.0, "arm.inertia": 3.0, "shaft.stiffness": 3310.0,
         "shaft2.stiffness": 8000.0, "shaft.damping": 3.0, "shaft2.damping": 5.0, "shaft.ratio": 2.0}
TANDEM = {"motor.inertia": 1e3, "motor2.inertia": 1e3, "load.inertia": 4e3, "motor.viscous": 0.3,
          "motor2.viscous": 0.3, "load.viscous": 1.2, "shaft.stiffness": 8e6, "shaft.damping": 8e3,
          "shaft2.stiffness": 8e6, "shaft2.damping": 8e3, "converter.bandwidth": 433.0,
          "converter.dead_time": 0.002}
CRITERIA = ("IAE", "ISE", "IE", "ITSE", "IT2SE", "IT5SE", "best")
CONVERTER = "--converter '433,0.69,2 ms'"


def parameters(values: dict[str, float], name: str = "two-mass", **more: object) -> bytes:
    """A parameter file written by hand; a drive of more than a name is among `more`."""
    return yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": {"name": name}, **more,
                           "parameters": values}, sort_keys=False).encode()


def load_step() -> bytes:
    """A step of the load torque under a speed controller, on the machine of GAP."""
    machine = Machine(inertia=(0.587, 5.179), viscous=(0.000176, 0.0017), idle_torque=(0.0, 15.14),
                      stiffness=(3310.0,), damping=(3.115,), half_gap=(0.075,), rated_torque=200.0,
                      converter_bandwidth=433.0, dead_time=0.0015)
    n, start = 3000, running(machine, 30.0)
    load = np.where(np.arange(n) * 1e-3 < 1.0, 0.0, 40.0)
    pi = PI(np.full(n, 30.0), 40.0, 120.0, start.torque, 200.0)
    run = simulate_fast(machine, np.zeros(n), 1e-3, start, pi, load_torque=load)
    channels = {"motor_torque": (run.command, "Nm"), "motor_speed": (run.speeds[:, 0], "rad/s"),
                "load_speed": (run.speeds[:, 1], "rad/s"), "load_torque": (load, "Nm")}
    with tempfile.TemporaryDirectory() as folder:
        write_parquet(Path(folder) / "step.parquet", channels, 1e-3)
        return (Path(folder) / "step.parquet").read_bytes()


def cases() -> list[Case]:
    """Few commands a case, so that both workers have some."""
    files = {"two.yaml": parameters(TWO), "gap.yaml": parameters(GAP), "rough.yaml": parameters(FRICTION),
             "laws.yaml": parameters(LAWS), "one.yaml": parameters(ONE, "one-body"),
             "three.yaml": parameters(THREE, "three-mass"),
             "tandem.yaml": parameters(TANDEM, drive={"name": "tandem", "bodies": ["motor", "motor2", "load"]}),
             "rated.yaml": parameters(TWO, ratings={
                "torque": {"value": 200, "unit": "Nm"}, "speed": {"value": 1500, "unit": "rpm"}}),
             "map.yaml": b"schema: drivetool/channel-map/1\nroles:\n  motor_torque: a\n  motor_speed: b\n"
                         b"  shaft_torque: c\n"}
    chains = {
        "criteria": [f"tune -p two.yaml {CONVERTER} --criterion {name} -o {name}.yaml" for name in CRITERIA],
        "structures": [f"tune -p {name}.yaml {CONVERTER} -o {name}.gains.yaml --plot {name}"
                       for name in ("one", "two", "gap", "rough", "laws", "three")],
        "options": [
            "tune -p gap.yaml --max-sensitivity 1.6 --max-gain 200 --weight motor_speed=0.5 "
            "--weight motor_torque=0.01 -o weighted.yaml",
            f"tune -p two.yaml {CONVERTER} --configuration siso --speed-filter '2 ms' --speed '1500 rpm' "
            f"--dead-time zero --json",
            "tune -p tandem.yaml -m map.yaml --dead-time exact --motors motor,motor2 "
            "-o tandem.gains.yaml --plot p1",
            "tune -p tandem.yaml --configuration siso --configuration miso -o miso.yaml",
            "show tandem.gains.yaml",
            f"tune -p rated.yaml {CONVERTER} --per-unit --set load.inertia=4 --strict -o rated.gains.yaml",
            "show rated.gains.yaml", "show weighted.yaml",
            f"tune -p two.yaml {CONVERTER} -q --debug | drivetool show -"],
        "steps": [f"simulate gap.parquet -p {name}.yaml -o {name}.simulated.parquet" for name in (
            "two", "gap", "rough", "laws")]}
    found = [case(f"tune-{name}", "tune", files | ({"gap.parquet": RIG / "gap.parquet"} if name == "steps" else {}),
                  tool(chain)) for name, chain in chains.items()]
    records = {name: RIG / name for name in ("steps.parquet", "gap.parquet", "gap_holdout.parquet")}
    records["step.parquet"] = load_step()
    found.append(case("tune-fitted", "tune", files | records, tool([
        "greybox steps.parquet -p two.yaml --criterion innovations -o fitted.yaml",
        f"tune -p fitted.yaml {CONVERTER} --confidence 0.9 --draws 40 --seed 3 -o robust.yaml --plot p1",
        f"tune -p fitted.yaml {CONVERTER} --draws 20 -o drawn.yaml",
        "validate step.parquet -p gap.yaml --gains robust.yaml --configuration siso -o replay.yaml --plot p2",
        "validate gap_holdout.parquet -p gap.yaml --min-fit 90 --max-correlation 0.1 --strict -o bars.yaml",
        "validate gap_holdout.parquet -p gap.yaml -p fitted.yaml --drive two-mass --start rest --seed 2 "
        "-q -o rest.yaml",
        "show replay.yaml", "show bars.yaml"])))
    return found
