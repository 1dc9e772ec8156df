"""Resonances, their damping and the total inertia, as they follow from the parameters."""

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.drive.chain import three_mass, vehicle
from drivetool.identify.estimate.derived_figures import derived_figures_of
from drivetool.identify.estimate.estimate import Covariance, Parameter

# Table 6.2 of Tallfors 2005: light rig as black box and as grey box, heavy rig across its gap.
TABLE = {
    "light black": (4.94, 0.655, 3780.0, 0.083, 0.154, 0.0176, 12.9, 0.00106),
    "light grey": (4.78, 0.646, 3770.0, 0.083, 0.107, 0.0307, 13.0, 0.00117),
    "heavy open": (0.566, 5.01, 3500.0, 0.470, 0.0258, 0.120, 13.2, 0.00583)}
NAMES = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "motor.viscous", "load.viscous")


def drive_of(row):
    return two_mass().with_values(dict(zip(NAMES, row[:6], strict=True)))


def lines_of(drive, **stds):
    return [Parameter(name=n, value=v, unit=drive.unit(n), std=stds.get(n),
                      status="fitted" if n in stds else "held")
            for n, v in drive.values.items()]


@pytest.mark.parametrize("name", TABLE)
def test_the_table_of_the_thesis_with_all_friction_in_the_damping_ratio(name):
    drive = drive_of(TABLE[name])
    found = {p.name: p for p in derived_figures_of(drive, lines_of(drive), None)}
    assert found["resonance"].value == pytest.approx(TABLE[name][6], abs=0.06) and found["resonance"].unit == "Hz"
    assert found["resonance_damping_ratio"].value == pytest.approx(TABLE[name][7], abs=6e-6)
    assert found["total_inertia_at_motor"].value == pytest.approx(sum(TABLE[name][:2]))
    assert all(p.std is None and p.reason for p in found.values())


def test_intervals_follow_from_the_joint_covariance():
    """Closed forms of two masses; what is certain of the sum is certain however uncertain the parts are."""
    jm, jl, ks, *_ = TABLE["light grey"]
    drive, names = drive_of(TABLE["light grey"]), NAMES[:3]
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) * 1e-3 * np.array([[jm], [jl], [ks]])
    covariance = Covariance(names, root @ root.T)
    found = {p.name: p
             for p in derived_figures_of(drive, lines_of(drive, **dict.fromkeys(names, 1.0)), covariance, NAMES)}
    w = np.sqrt(ks * (1 / jm + 1 / jl))
    slopes = {"resonance": np.array([-ks / jm**2, -ks / jl**2, 1 / jm + 1 / jl]) / (4.0 * np.pi * w),
              "anti_resonance": np.array([0.0, -ks / jl**2, 1 / jl]) / (4.0 * np.pi * np.sqrt(ks / jl)),
              "total_inertia_at_motor": np.array([1.0, 1.0, 0.0])}
    for name, slope in slopes.items():
        std = np.sqrt(slope @ covariance.matrix @ slope)
        assert found[name].std == pytest.approx(std, rel=1e-4), name
        assert found[name].ci95[1] - found[name].value == pytest.approx(1.96 * std, rel=1e-3)
    certain = Covariance(names[:2], 1e-4 * np.array([[1.0, -1.0], [-1.0, 1.0 + 1e-9]]))
    found = {p.name: p
             for p in derived_figures_of(drive, lines_of(drive, **dict.fromkeys(names[:2], 0.01)), certain, NAMES)}
    assert found["total_inertia_at_motor"].std < 1e-5 < found["resonance"].std


def test_what_is_not_identified_leaves_no_interval_where_it_counts():
    drive = drive_of(TABLE["light grey"])
    lines = [Parameter(name=p.name, value=p.value, unit=p.unit, status="not-identifiable")
             if p.name == "load.inertia" else p
             for p in lines_of(drive, **{"motor.inertia": 0.01, "shaft.stiffness": 1.0})]
    covariance = Covariance(("motor.inertia", "shaft.stiffness"), np.diag([1e-4, 1.0]))
    for p in derived_figures_of(drive, lines, covariance, NAMES):
        assert p.std is None and "load.inertia" in p.reason
    # The load's viscous friction damps, and turns no frequency.
    lines = [Parameter(name=p.name, value=p.value, unit=p.unit, status="not-identifiable")
             if p.name == "load.viscous" else p
             for p in lines_of(drive, **{"motor.inertia": 0.01, "shaft.stiffness": 1.0})]
    found = {p.name: p for p in derived_figures_of(drive, lines, covariance, NAMES)}
    assert found["resonance"].std is not None and found["resonance_damping_ratio"].std is None


def test_a_value_held_without_request_and_without_interval_leaves_none():
    """The shaft's damping is held at a guess: so is its damping ratio, and no resonance."""
    drive = drive_of(TABLE["light grey"])
    names = NAMES[:3]
    covariance = Covariance(names, np.diag([1e-6, 1e-8, 1.0]))
    found = {p.name: p
             for p in derived_figures_of(drive, lines_of(drive, **dict.fromkeys(names, 0.01)), covariance)}
    assert found["resonance"].std is not None and found["total_inertia_at_motor"].std is not None
    assert found["resonance_damping_ratio"].std is None
    assert "shaft.damping" in found["resonance_damping_ratio"].reason


def test_friction_alone_has_no_resonance_with_an_interval():
    drive = drive_of(TABLE["light grey"])
    covariance = Covariance(("motor.viscous",), np.array([[1e-6]]))
    found = derived_figures_of(drive, lines_of(drive, **{"motor.viscous": 1e-3}), covariance)
    assert {"anti_resonance", "resonance"} <= {p.name for p in found} and all(p.std is None for p in found)


def test_a_longer_chain_has_each_mode_and_a_stiff_one_none():
    arm = three_mass().with_values({
        "motor.inertia": 1.3, "gear.inertia": 0.5, "arm.inertia": 0.45, "shaft.stiffness": 6500.0,
        "shaft.damping": 2.6, "shaft2.stiffness": 19000.0, "shaft2.damping": 7.4})
    names = [p.name for p in derived_figures_of(arm, lines_of(arm), None)]
    assert names == [f"{kind}{number}{what}" for number in ("", "2") for kind in ("anti_resonance", "resonance")
                     for what in ("", "_damping_ratio")] + ["total_inertia_at_motor"]
    assert derived_figures_of(one_body().with_values({"motor.inertia": 1.0}), [], None) == ()
    assert derived_figures_of(two_mass().with_values({"motor.inertia": 1.0}), [], None) == ()


def test_a_gear_that_was_read_off_is_no_unknown():
    drive = drive_of(TABLE["light grey"]).with_values({"shaft.ratio": 8.79})
    covariance = Covariance(NAMES[:3], np.diag([1e-4, 1e-6, 1.0]))
    found = derived_figures_of(drive, lines_of(drive, **dict.fromkeys(NAMES[:3], 1.0)), covariance, NAMES)
    frequencies = {p.name: p.std for p in found if "damping" not in p.name}
    assert set(frequencies) == {"anti_resonance", "resonance", "total_inertia_at_motor"}
    assert None not in frequencies.values()


def test_friction_is_a_force_where_a_mass_is_carried():
    """1089 Nm at wheels of 0.45 m are 2420 N; 40 Nm s/rad there and 0.02 at the motor in N s/m."""
    drive = vehicle().with_values({"shaft.ratio": 8.79, "wheels.radius": 0.45, "wheels.carried_mass": 12350.0,
                                   "total.viscous": 0.02 + 40.0 / 8.79**2, "total.idle_torque": 1089.0 / 8.79})
    covariance = Covariance(("wheels.carried_mass", "total.idle_torque"), np.diag([1.0, 0.01]))
    lines = lines_of(drive, **{"wheels.carried_mass": 1.0, "total.idle_torque": 0.1})
    found = {p.name: p for p in derived_figures_of(drive, lines, covariance)}
    assert set(found) == {"constant_force_at_wheels", "viscous_force_at_wheels"}  # no stiffness, no resonance
    force = found["constant_force_at_wheels"]
    assert force.value == pytest.approx(2420.0) and force.std == pytest.approx(0.1 * 8.79 / 0.45)
    viscous = found["viscous_force_at_wheels"]
    assert viscous.value == pytest.approx((0.02 * 8.79**2 + 40.0) / 0.45**2) and viscous.unit == "N s/m"
