"""120 generated recordings, 3 s at 500 Hz: each effect, structure, criterion and option."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field

import yaml

from tests.golden.case import Case, case, tool
from tests.golden.inputs_generated_options import OPTIONS
from tests.golden.machines import hidden

FIT = "greybox record1.parquet -p start.yaml -o fit.yaml"
CHECK = "validate holdout.parquet -p fit.yaml --segment 0.5 -o validate.yaml"
SHOW = "show fit.yaml"


@dataclass(frozen=True)
class Made:
    """One machine and its chain.

    effects  of the hidden machines, separated by blanks; bodies of its chain
    more     for `make_case`
    values   put into the parameter file to start from; damped: with forty times the damping
    """

    name: str
    effects: str
    bodies: int
    commands: Sequence[str]
    more: dict = field(default_factory=dict)
    values: dict = field(default_factory=dict)
    damped: bool = False


def _freed(*names: str) -> str:
    return "".join(f" --free {name}" for name in names)


# Name -> (hidden effects, bodies, what is freed, start values; None takes one away): what a fit can free.
EFFECTS: dict[str, tuple[str, int, tuple[str, ...], dict[str, float | None]]] = {
    "viscous": ("", 2, ("motor.viscous", "load.viscous"), {"total.viscous": None, "motor.viscous": 0.1}),
    "idle-torque": ("", 2, ("motor.idle_torque", "load.idle_torque"), {
        "total.idle_torque": None, "load.idle_torque": 1.0}),
    "coulomb-one": ("coulomb-motor", 1, ("motor.coulomb",), {}),
    "coulomb-two": ("coulomb-load", 2, ("load.coulomb",), {}),
    "coulomb-both": ("coulomb-motor coulomb-load", 2, ("motor.coulomb", "load.coulomb"), {}),
    "stribeck-one": ("stribeck-motor", 1, ("motor.stribeck", "motor.stribeck_speed"), {
        "motor.stribeck_speed": 1.0}),
    "stribeck-load": ("stribeck-load", 2, ("load.stribeck",), {"load.stribeck_speed": 1.5}),
    "stribeck-power": ("stribeck-motor", 2, ("motor.stribeck",), {"motor.stribeck_power": 1.0}),
    "breakaway": ("stribeck-motor", 1, ("motor.breakaway",), {"motor.breakaway_speed": 1.0}),
    "asymmetric-one": ("asymmetric-friction", 1, ("motor.viscous_asymmetry",), {}),
    "asymmetric-two": ("asymmetric-friction", 2, ("motor.viscous_asymmetry",), {}),
    "drag-one": ("quadratic-drag", 1, ("motor.drag",), {}),
    "drag-two": ("quadratic-drag", 2, ("load.drag",), {}),
    "drift": ("friction-drift", 1, ("motor.drift_coulomb", "motor.drift_viscous"), {"motor.drift_time": 1.0}),
    "warm-up": ("friction-drift", 2, ("friction.drift_coulomb", "friction.drift_viscous"), {
        "friction.drift_time": 1.0}),
    "factor": ("coulomb-motor", 1, ("friction.factor",), {"motor.coulomb": 1.0}),
    "ripple-one": ("torque-ripple", 1, ("motor.ripple_sine", "motor.ripple_cosine", "motor.ripple_order"), {
        "motor.ripple_order": 5.0}),
    "ripple-two": ("torque-ripple", 2, ("motor.ripple_sine", "motor.ripple2_cosine"), {
        "motor.ripple_order": 4.0, "motor.ripple2_order": 8.0}),
    "imbalance": ("imbalance", 2, ("load.imbalance_sine", "load.imbalance_cosine"), {}),
    "imbalance-one": ("imbalance", 1, ("motor.imbalance_sine", "motor.imbalance_cosine"), {}),
    "step": ("load-step", 2, ("load.step_torque", "load.step_time"), {"load.step_time": 1.5}),
    "step-one": ("load-step", 1, ("motor.step_torque", "motor.step2_torque"), {
        "motor.step_time": 1.4, "motor.step2_time": 2.2}),
    "gap": ("backlash", 2, ("shaft.half_gap",), {"shaft.half_gap": 3e-4}),
    "gap-damping": ("backlash", 2, ("shaft.half_gap", "shaft.gap_damping"), {"shaft.half_gap": 3e-4}),
    "gap-friction": ("backlash coulomb-load", 2, ("shaft.half_gap", "load.coulomb"), {"shaft.half_gap": 3e-4}),
    "hardening": ("hardening-stiffness", 2, ("shaft.hardening",), {"shaft.hardening_twist": 3e-3}),
    "hardening-power": ("hardening-stiffness", 2, ("shaft.hardening", "shaft.hardening_power"), {
        "shaft.hardening_twist": 3e-3, "shaft.hardening_power": 1.5}),
    "load-damping": ("load-dependent-damping", 2, ("shaft.load_damping",), {}),
    "third-mass": ("third-mass", 2, ("all",), {}),
    "converter": ("converter-lag", 2, ("converter.bandwidth",), {"converter.bandwidth": 600.0}),
    "converter-first": ("converter-lag", 1, ("converter.bandwidth",), {
        "converter.bandwidth": 600.0, "converter.order": 1}),
    "dead-time": ("dead-time", 2, ("converter.dead_time",), {"converter.dead_time": 1e-3}),
    "hold": ("", 2, ("converter.interpolation",), {}),
    "filter": ("speed-filter", 2, ("sensor.bandwidth",), {"sensor.bandwidth": 700.0}),
    "filter-second": ("speed-filter", 1, ("sensor.bandwidth", "sensor.damping"), {
        "sensor.bandwidth": 700.0, "sensor.order": 2}),
}


def _effects() -> list[Made]:
    return [Made(f"effect-{name}", effects, bodies, [FIT + _freed(*free), CHECK, SHOW], {}, values)
            for name, (effects, bodies, free, values) in EFFECTS.items()]


def _structures() -> list[Made]:
    """Each structure by each criterion."""
    structures = {"one": ("", 1, {}, {}), "linear": ("coulomb-motor", 1, {"linear": True}, {}),
                  "two": ("", 2, {}, {}), "three": ("", 3, {"sensors": ("motor_speed", "load_speed")}, {}),
                  "gap": ("backlash", 2, {}, {"shaft.half_gap": 2e-4}),
                  "gear": ("", 2, {"sensors": ("motor_speed", "load_speed")}, {"shaft.ratio": 1.001})}
    found = []
    for name, (effects, bodies, more, values) in structures.items():
        for criterion in ("auto", "innovations", "simulation", "inverse", "frequency"):
            free = " --free shaft.half_gap" if name == "gap" and criterion != "frequency" else ""
            words = {"simulation": " --segment 0.5", "frequency": " --band 1 120"}.get(criterion, "")
            # The free motion of what is behind a shaft must have died away before the required torque is computed.
            damped = criterion == "inverse" and bodies > 1
            found.append(Made(f"structure-{name}-{criterion}", effects, bodies, [
                f"{FIT} --criterion {criterion}{words}{free}", CHECK, SHOW],
                more | ({"duration": 8.0} if damped else {}), values, damped))
    return found


def _records() -> list[Made]:
    """Each kind of experiment, sensor and noise."""
    kinds = ("one-directional", "closed-loop", "moves", "cruise", "chirp", "binary", "steps")
    found = [Made(f"record-{kind}", "", 2, ["inspect record1.parquet -o inspect.yaml --plot p1", FIT, SHOW],
                  {"record": kind}) for kind in kinds]
    for name, sensors in {"angle": ("motor_angle",), "load": ("motor_speed", "load_speed"),
                          "torque": ("motor_speed", "shaft_torque"), "ends": ("motor_angle", "load_angle"),
                          "all": ("motor_speed", "motor_angle", "shaft_torque", "load_speed",
                                   "load_angle")}.items():
        found.append(Made(f"sensors-{name}", "", 2, [FIT, CHECK, SHOW], {"sensors": sensors}))
    found += [Made(f"noise-{level}", "", 1 + i % 2, [FIT, CHECK, SHOW], {"noise": level})
              for i, level in enumerate(("loud", "quiet", "none"))]
    found.append(Made("noise-coloured", "", 2, [FIT, CHECK, SHOW], {"coloured": 0.5}))
    faults = ("quantisation", "torque-offset", "outliers", "wrong-sign", "wrong-scale", "wrong-sign-shaft",
              "wrong-scale-shaft")
    found += [Made(f"fault-{name}", name, 2, ["inspect record1.parquet --json", FIT, SHOW])
              for name in faults]
    return found


def cases() -> list[Case]:
    """Every machine with its chain; seeds count on, so that a new machine goes to the end of the options."""
    options = [Made(name, *entry) for name, entry in OPTIONS.items()]
    found = []
    for seed, made in enumerate([*_effects(), *_structures(), *_records(), *options], 101):
        machine = hidden(made.effects.split(), seed, made.bodies, **made.more)
        files = dict(machine.files)
        if made.values or made.damped:
            files["start.yaml"] = _with(files["start.yaml"], made.values, 40.0 if made.damped else 1.0)
        files |= _maps(made)
        files |= _damaged(files["record1.parquet"]) if "damaged" in made.name else {}
        chain = [_plain(command, machine.options) for command in made.commands]
        found.append(case(f"made-{made.name}", "generated", files, tool(chain)))
    return found


def _plain(command: str, options: str) -> str:
    """A grey-box fit with the words that keep it plain, unless it estimates friction itself."""
    if not command.startswith("greybox ") or any(word in command for word in ("coulomb", "--free all", "stribeck")):
        return command
    return f"greybox{options}{command.removeprefix('greybox')}"


def _with(start: bytes, values: dict[str, float | None], damping: float) -> bytes:
    """A parameter file with more values, and so many times the damping; None takes one away."""
    content = yaml.safe_load(start)
    known = content["parameters"] | values
    if damping != 1.0:
        known |= {name: damping * value for name, value in known.items() if name.endswith(".damping")}
    content["parameters"] = {name: value for name, value in known.items() if value is not None}
    return yaml.safe_dump(content, sort_keys=False).encode()


def _damaged(record: bytes) -> dict[str, bytes]:
    """The recording with a gap in time, with samples left out, with a jittering clock, and cut short."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(record))
    time, row = table["time"].to_numpy(), np.arange(table.num_rows)
    jitter = time + 1e-4 * np.random.default_rng(1).standard_normal(len(time))
    made = {"gap.parquet": table.filter(pa.array((row < 600) | (row > 750))),
            "lost.parquet": table.filter(pa.array(row % 97 != 5)),
            "jitter.parquet": table.set_column(0, table.schema.field(0), pa.array(jitter)),
            "short.parquet": table.slice(0, 30)}
    found = {}
    for name, each in made.items():
        sink = io.BytesIO()
        pq.write_table(each, sink)
        found[name] = sink.getvalue()
    return found | {"cut.parquet": record[:len(record) // 2]}


def _maps(made: Made) -> dict[str, bytes]:
    """The channel map, where a command has one; a motor that is commanded in A where its constant is given."""
    text = " ".join(made.commands)
    if "map.yaml" not in text:
        return {}
    torque = "{channel: motor_torque, unit: A}" if "torque_constant" in text else "motor_torque"
    return {"map.yaml": f"schema: drivetool/channel-map/1\nroles:\n  motor_torque: {torque}\n"
                        "  motor_speed: motor_speed\n".encode()}
