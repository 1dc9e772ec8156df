"""Plants and published tables of Tallfors 2005, for the tests of the tuner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive, two_mass

CONVERTER = {"converter.bandwidth": 433.0, "converter.damping": 0.69, "converter.dead_time": 0.002}
# Table 3.1: load inertia, load viscous, stiffness, damping; motor 20 and 0.006 in all of them.
TWO_MASS = {"light": (5.0, 0.0015, 56e3, 56.0), "medium": (20.0, 0.006, 140e3, 140.0),
            "heavy": (80.0, 0.024, 224e3, 224.0)}
# Table 4.1: load inertia, load viscous, second stiffness and damping.
TANDEMS = {"G1": (1e3, 0.3, 8e6, 8e3), "G2": (4e3, 1.2, 8e6, 8e3), "G3": (4e3, 1.2, 1.6e7, 1.6e4)}
TORQUE, SPEED = 100e3, 630.0 * np.pi / 30.0  # per-unit base of chapter 4
MOTORS = ("motor", "motor2")


def two_mass_plant(name: str, with_converter: bool = True) -> Drive:
    """A plant of Table 3.1."""
    inertia, viscous, stiffness, damping = TWO_MASS[name]
    return two_mass().with_values({
        "motor.inertia": 20.0, "motor.viscous": 0.006, "load.inertia": inertia, "load.viscous": viscous,
        "shaft.stiffness": stiffness, "shaft.damping": damping, **(CONVERTER if with_converter else {})})


def tandem(name: str) -> Drive:
    """A plant of Table 4.1."""
    inertia, viscous, stiffness, damping = TANDEMS[name]
    return Drive("tandem", ("motor", "motor2", "load"), ("shaft", "shaft2")).with_values({
        "motor.inertia": 1e3, "motor2.inertia": 1e3, "load.inertia": inertia, "motor.viscous": 0.3,
        "motor2.viscous": 0.3, "load.viscous": viscous, "shaft.stiffness": 8e6, "shaft.damping": 8e3,
        "shaft2.stiffness": stiffness, "shaft2.damping": damping, **CONVERTER})


@dataclass(frozen=True)
class Row:
    """A row of Table 3.2: settings, impact drop [rad/Nm], overshoot [%], settling [s], criterion."""

    plant: str
    criterion: str
    gain: float
    integral_time: float
    impact_drop: float
    overshoot: float
    settling: float
    value: float


TABLE_3_2 = (
    Row("light", "IE", 1936, 0.01464, 3.811e-5, 41.63, 0.142, 2.54e-5),
    Row("light", "ISE", 1634, 0.02442, 3.875e-5, 20.70, 0.126, 5.63e-8),
    Row("light", "IAE", 1809, 0.02139, 3.847e-5, 28.39, 0.064, 5.15e-5),
    Row("medium", "IE", 1948, 0.01586, 2.303e-5, 50.14, 0.276, 1.53e-5),
    Row("medium", "ISE", 2641, 0.04097, 2.360e-5, 6.444, 0.096, 1.12e-8),
    Row("medium", "IAE", 2669, 0.04478, 2.391e-5, 2.718, 0.068, 2.46e-5),
    Row("heavy", "IE", 2270, 0.02458, 2.299e-5, 50.33, 0.526, 1.53e-5),
    Row("heavy", "ISE", 2466, 0.03554, 2.548e-5, 34.96, 0.354, 7.37e-9),
    Row("heavy", "IAE", 2606, 0.05590, 3.028e-5, 16.93, 0.282, 3.64e-5),
)


@dataclass(frozen=True)
class Column:
    """A column of Tables 4.2 to 4.4: per-unit gains, IAE and impact drop [% s], the rest [%], [s]."""

    plant: str
    configuration: str
    gain: float
    integral_time: float
    second: float
    iae: float
    impact_drop: float
    overshoot: float
    settling: tuple[float, ...]
    torque_overshoot: tuple[float, float]


TABLES_4 = (
    Column("G1", "siso", 27, 0.0444, 1.0, 0.153, 0.128, 16.2, (0.239,), (52.6, 52.6)),
    Column("G1", "miso", 62.9, 0.0692, 40 / 62.9, 0.0894, 0.0842, 3.74, (0.138,), (109, 50.6)),
    Column("G1", "mimo", 78.5, 0.0598, 1.0, 0.0684, 0.067, 1.98, (0.077,), (85.6, 34.9)),
    Column("G2", "siso", 25.2, 0.0608, 1.0, 0.276, 0.194, 30, (0.623,), (47.8, 47.8)),
    Column("G2", "miso", 90.9, 0.128, 69.7 / 90.9, 0.109, 0.0991, 8.67, (0.308,), (71.1, 42.6)),
    Column("G2", "mimo", 76.5, 0.106, 1.0, 0.1, 0.0982, 1.98, (0.16,), (53.6, 34.9)),
    Column("G3", "siso", 28.7, 0.0503, 1.0, 0.205, 0.14, 31.4, (0.534,), (48.5, 48.5)),
    # Settles at 0.136 s or 0.176 s: a ripple just touches the 5 % band.
    Column("G3", "miso", 96.7, 0.118, 55.4 / 96.7, 0.0842, 0.0801, 5.29, (0.176, 0.136), (76.4, 28.2)),
    Column("G3", "mimo", 82.4, 0.0926, 1.0, 0.0767, 0.0757, 1.52, (0.154,), (48.8, 29.2)),
)
