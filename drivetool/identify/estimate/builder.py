"""The one place in which every estimator makes its estimate, and what several of them state in the same form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate.estimate import Covariance, Estimate, Parameter, PlotData
from drivetool.identify.estimate.lines import with_intervals_only
from drivetool.identify.estimate.percent import fit_percent
from drivetool.identify.estimate.verdict import Check, judged
from drivetool.logs import Experiment, recording_sources

Figures = Mapping[str, float | int | None]


def estimate_from_fit(step: str, experiments: Sequence[Experiment], drive: Drive, lines: Sequence[Parameter],
                      covariance: Covariance | None, *, outcome: str, fit: Figures,
                      findings: Iterable[Finding] = (), exhibits: Iterable[PlotData] = (),
                      checks: Iterable[Check] = (), **more: Any) -> Estimate:
    """The estimate of a step, after its checks.

    experiments  that were fitted; drive: with its fitted values
    covariance   of fitted parameters; those of them that have no interval are left out
    more         further fields of `Estimate`
    """
    return judged(Estimate(
        step, drive, tuple(lines), outcome, fit, with_intervals_only(covariance, lines), findings=tuple(findings),
        data=recording_sources(experiments), exhibits=tuple(exhibits), **more), checks)


def free_run_figures(measured: np.ndarray, simulated: np.ndarray, one_step: float | None,
                     more: Figures | None = None) -> dict[str, float | int | None]:
    """The figures of free runs (n,) over what was measured (n,); one_step: fit of the one-step prediction [%].

    more  further figures of free runs
    """
    return {"simulation_fit_percent": fit_percent(measured, simulated), **(more or {}),
            "one_step_fit_percent": one_step, "rmse": float(np.sqrt(np.nanmean((measured - simulated) ** 2))),
            "n": int(np.isfinite(measured).sum())}


def record_picture(title: str, label: str, time: np.ndarray, measured: np.ndarray, simulated: np.ndarray,
                   more: Mapping[str, np.ndarray] | None = None) -> PlotData:
    """A signal (n,) as measured and as simulated, its error, and further signals, over time (n,).

    label  of the axis, with unit; more: label -> (n,)
    """
    curves = {"measured": measured, "simulated": simulated, "residual": measured - simulated, **(more or {})}
    return PlotData("record", title, "time [s]", label, {name: (time, values) for name, values in curves.items()})
