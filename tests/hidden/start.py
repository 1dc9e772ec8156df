"""The parameter file a person would start from: the plain machine, values off by some per cent."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml

from tests.hidden.rigs import SHAFTS, Rig

if TYPE_CHECKING:
    from tests.hidden.case import Case

DRIVES = {1: "one-body", 2: "two-mass", 3: "three-mass"}
MAX_START_ERROR = 0.15


def plain_values(rig: Rig) -> dict[str, float]:
    """True values of the plain machine under the names of parameter files."""
    m, values = rig.machine, {}
    many = m.bodies > 1
    for i, body in enumerate(rig.bodies):
        values[f"{body}.inertia"] = m.inertia[i]
        if m.coulomb[i] > 0.0:
            values[f"{body}.coulomb"] = m.coulomb[i]
    values["total.viscous" if many else "motor.viscous"] = sum(m.viscous)
    values["total.idle_torque" if many else "motor.idle_torque"] = sum(m.idle_torque)
    for k, shaft in enumerate(SHAFTS[m.bodies]):
        values[f"{shaft}.stiffness"] = m.stiffness[k]
        values[f"{shaft}.damping"] = m.damping[k]
    return {name: float(value) for name, value in values.items()}


def write_start(case: Case, folder: Path, max_error: float = MAX_START_ERROR, seed: int = 0) -> Path:
    """start.yaml with the plain parameters, each off by a random share of up to `off`.

    returns  its path; start from it with `greybox --params start.yaml` and `greybox_options`
    """
    torque, motion = case.rig.units
    rng = np.random.default_rng([seed, int(case.arguments["machine_seed"]), 32452843])
    values = {name: float(f"{value * (1.0 + max_error * rng.uniform(-1.0, 1.0)):.4g}")
              for name, value in plain_values(case.rig).items()}
    content = {"schema": "drivetool/parameters/1",
               "drive": {"name": DRIVES[case.rig.machine.bodies], "torque_unit": torque,
                         "motion_unit": motion}, "parameters": values}
    path = Path(folder) / "start.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def greybox_options(case: Case) -> list[str]:
    """Words for the command line that keep the plain fit plain.

    On records that reverse, a grey-box fit frees the Coulomb friction of the motor by itself;
    where the plain machine has none it is held at zero, so that diagnose has it to find.
    """
    return [] if any(case.rig.machine.coulomb) else ["--hold", "motor.coulomb"]
