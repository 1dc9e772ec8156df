"""A diagnosis made by hand, for tests of everything around the statistics."""

from __future__ import annotations

import numpy as np

from drivetool.check.outcome import CandidateResult, Diagnosis, Gain, Round, SizeSection
from drivetool.check.verdict.plot_data import diagnosis_plots
from drivetool.check.verdict.view import View
from drivetool.drive import two_mass
from drivetool.identify.estimate import Covariance, Estimate, Parameter

STEP = 1e-3
BASE = two_mass().with_values({
    "motor.inertia": 0.587, "load.inertia": 5.179, "shaft.stiffness": 3200.0, "shaft.damping": 5.0,
    "total.viscous": 0.002})
DRIVE = BASE.with_values({"shaft.stiffness": 3310.0, "shaft.damping": 3.1, "shaft.half_gap": 0.00322})
LINES = (
    Parameter(name="motor.inertia", value=0.587, unit="kg m^2", start=0.587, std=0.001, ci95=(0.585, 0.589)),
    Parameter(name="shaft.stiffness", value=3310.0, unit="Nm/rad", start=3200.0, std=12.0, ci95=(3286.0, 3334.0)),
    Parameter(name="shaft.half_gap", value=0.00322, unit="rad", start=0.0, std=0.00002, ci95=(0.00318, 0.00326)))
FITTED = (
    CandidateResult("backlash", "named", law="Ts = ks dead(z, a)", gain=1234.0, gain_std=41.0, evidence=530.2,
                    smallest={"shaft.half_gap": SizeSection(1e-4, "rad")}, parameters={p.name: p for p in LINES}),
    CandidateResult("hardening-stiffness", "worse", law="Ts = ks twist (1 + h (|twist|/r)^n)", gain=610.0,
                    gain_std=55.0, evidence=260.0, smallest={"shaft.hardening": SizeSection(0.02, "")},
                    parameters={"shaft.hardening": Parameter(
                        name="shaft.hardening", value=0.3, unit="", start=0.0, std=0.01)}),
    CandidateResult("dead-time", "no-gain", law="T(t) = u(t - td)", gain=-3.0, gain_std=2.0, evidence=-1.5,
                    smallest={"converter.dead_time": SizeSection(4e-5, "s")}),
    CandidateResult("coulomb-motor", "in-the-model", law="T = Tc sgn(w)", reason="the base has it already"),
    CandidateResult("imbalance", "not-shown", law="T = a sin(angle) + b cos(angle)",
                    reason="the load does not turn often enough <here> & now"),
    CandidateResult("third-mass", "failed", reason="the fit did not settle"))


def gain(before, after, fits=(90.0, 95.0), std=0.0, bar=None, floor=0.1, unexplained=0.0, blocks=0, segment=1.5):
    """A gain of a speed with these errors."""
    return Gain(unit="rad/s", segment=segment, held_out_rmse_before=before, held_out_rmse_after=after, rmse_std=std,
                held_out_fit_before=fits[0], held_out_fit_after=fits[1], noise_floor=floor,
                unexplained_percent=unexplained, rmse_bar=std if bar is None else bar, blocks=blocks)


GAIN = gain(0.221, 0.0211, fits=(93.4, 99.4), std=0.004, floor=0.02, unexplained=1.2, blocks=8, segment=2.0)


def views(size: int = 6000, second: bool = True) -> list[View]:
    """Two records of a drive that goes to and fro; the base lacks dry friction of 2 Nm, known in closed form."""
    rng, made = np.random.default_rng(5), []
    for k in range(2 if second else 1):
        t = np.arange(size) * STEP
        speed = 8.0 * np.sin(2.0 * np.pi * (0.5 + 0.2 * k) * t)
        torque = 5.766 * np.gradient(speed, STEP)
        truth = speed + rng.normal(0.0, 0.02, size)
        breaks = tuple(range(0, size, 2000))
        lacking = np.concatenate([np.cumsum(-2.0 / 5.766 * np.sign(speed[a:a + 2000])) * STEP for a in breaks])
        made.append(View(f"record{k + 1}.parquet", t, truth, speed - lacking, speed, torque, speed,
                         np.cumsum(speed) * STEP, torque * 0.9, breaks, "motor_speed", ("rad/s", "Nm", "rad")))
    return made


def diagnosis(**changes) -> Diagnosis:
    """Backlash found in one round, and nothing more in the next."""
    rounds = (Round(1, "backlash", candidates=FITTED, gain=GAIN),
              Round(2, candidates=tuple(c.replace(state="no-gain", gain=0.5, gain_std=1.5, evidence=-0.4)
                                        for c in FITTED[1:3])))
    estimate = Estimate(
        "diagnose", DRIVE, LINES, "settled", {"simulation_fit_percent": 99.4, "rmse": 0.0211, "n": 12000},
        Covariance(("motor.inertia", "shaft.stiffness", "shaft.half_gap"), np.diag([1e-6, 144.0, 4e-10])),
        {"sensor_std.motor_speed": 0.02, "torque_std": 0.3}, data=(("record1.parquet", "ab" * 32),))
    made = Diagnosis(
        "named", "The simulation errs because of backlash in the shaft.", ("backlash",),
        evidence={"backlash": 530.2}, gain=GAIN, rounds=rounds, estimate=estimate)
    return made.replace(**changes)


def with_pictures(made: Diagnosis) -> Diagnosis:
    """The same with pictures of one record."""
    return made.replace(exhibits=diagnosis_plots(views(second=False), 5.766, made.rounds, 0.02))
