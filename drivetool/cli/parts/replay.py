"""`validate --gains`: the tuned loop on records of load steps, as checks like any other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.check.validation import CheckSection, ValidateOptions, Validation
from drivetool.drive import Drive
from drivetool.files.results import controller_of, load_gains
from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData, fit_text, record_picture
from drivetool.logs import Experiment
from drivetool.tune.simulation import LoopReplay, replay_load_step
from drivetool.tune.speed_loop import build


def replay_gains(experiments: Sequence[Experiment], models: Sequence[tuple[str, str, Drive]], path: str,
                 configuration: str | None, options: ValidateOptions) -> tuple[Validation, tuple[str, str]]:
    """Every drive with these gains on every record.

    models   (file name, sha256, drive)
    path     of the gains file
    returns  (Validation, (name, sha256) of the gains file)
    """
    name, digest, file = load_gains(path)
    wiring, settings = controller_of(file, name, configuration)
    tuned_on = {entry.sha256 for entry in file.inputs}
    found = [_other_tuning_note(model, name, [entry.file for entry in file.inputs])
             for model, sha256, _ in models if sha256 not in tuned_on]
    runs = [(model, experiment, replay_load_step(loop, settings, experiment))
            for model, _, drive in models for loop in [build(drive, wiring)] for experiment in experiments]
    checks = [_replay_check(*run, role, options) for run in runs for role in run[2].measured]
    missed = [c for c in checks if not c.passed]
    verdict = f"Replayed {name} on {', '.join(dict.fromkeys(c.file for c in checks))}: " + (
        f"{len(missed)} of {len(checks)} signals miss a limit." if missed else
        "every stated limit is met." if options.min_fit is not None else "no limit is stated.")
    data = tuple(e.source for e in experiments)
    return Validation(tuple(checks), verdict, tuple(found), data, {},
                      tuple(_replay_plot(*run) for run in runs)), (name, digest)


def _replay_check(model: str, experiment: Experiment, run: LoopReplay, role: str,
                  options: ValidateOptions) -> CheckSection:
    """One signal; residual tests need an open loop and are left out."""
    y = run.measured[role][np.isfinite(run.measured[role])]
    output_range, total = float(np.ptp(y)), float(np.sum((y - y.mean()) ** 2))
    unit = experiment.torque_unit if role.endswith("torque") else f"{experiment.motion_unit}/s"
    fit, rmse = run.fits[role], run.rmse[role]
    return CheckSection(
        model, experiment.name, role, unit, fit, None, rmse, rmse / output_range if output_range else np.nan,
        1.0 - rmse**2 * len(y) / total if output_range and total else np.nan, len(y), np.nan, np.nan, np.nan,
        np.nan, None, options.min_fit is None or fit >= options.min_fit)


def _replay_plot(model: str, experiment: Experiment, run: LoopReplay) -> PlotData:
    """Measured over simulated motor speed, with the load torque."""
    return record_picture(
        f"{experiment.name}, model {model}: replay of the tuned loop, "
        f"fit {fit_text(run.fits['motor_speed'], '.1f')}",
        f"motor speed [{experiment.motion_unit}/s]", run.time, run.measured["motor_speed"],
        run.simulated["motor_speed"], {f"torque of the load [{experiment.torque_unit}]": run.load})


def _other_tuning_note(model: str, gains: str, files: Sequence[str]) -> Finding:
    return Finding("note", "tuned-for-another-file",
                   f"{gains} was tuned for {', '.join(files)}, not for {model} as it is now.", {},
                   "Tune again if the parameters have changed.")
