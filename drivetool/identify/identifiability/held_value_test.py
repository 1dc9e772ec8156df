"""Held values that the record contradicts: the fitted parameters are biased to compensate for them."""

from __future__ import annotations

from dataclasses import replace

from drivetool.errors import DriveToolError
from drivetool.finding import Finding
from drivetool.identify.fit import fit_with_friction_split, looks_coloured
from drivetool.identify.setup import Options, Outcome, Task
from drivetool.quantity import names_of

# Log likelihood that freeing a held value must gain. A choice: below it, another local optimum explains the gain.
MIN_HELD_VALUE_GAIN = 30.0
# Relative change of a held value that is reported. A choice: 1 % is far below what a fit is used for
MIN_RELATIVE_CHANGE = 0.01


def contradicted_held_values(task: Task, outcome: Outcome, options: Options, requested: Options) -> list[Finding]:
    """Of the half gaps, the dead time and the values held on request, those that the record contradicts.

    task                what is fitted, with its start values
    outcome             of its innovations fit
    options, requested  as of `fit_with_friction_split`
    returns             a warning per value, with its estimate while the other held values stay as they are; none
                        where the errors are correlated even then: something else is missing
    """
    drive = task.drive
    held = {"converter.dead_time", *names_of(drive.shafts, "half_gap"), *options.hold}
    names = [n for n in drive.quantities if n in held and n not in task.free and drive.value(n)]
    found = []
    for name in names if outcome.fit is not None else ():
        given, unit = drive.value(name), drive.unit(name)
        try:
            trial = fit_with_friction_split(task.with_free({*task.free, name}), _options_with_free(options, name),
                                            _options_with_free(requested, name), [{}])
        except DriveToolError:
            continue
        value, gain = trial.drive.value(name), outcome.fit.value - trial.fit.value
        if (gain > MIN_HELD_VALUE_GAIN and abs(value - given) > MIN_RELATIVE_CHANGE * abs(given)
            and not looks_coloured(trial.fit.passes)):
            found.append(Finding(
                "warning", "held-value-rejected",
                f"{name} is held at {given:.4g} {unit}, but its estimate is {value:.4g}, where the log "
                f"likelihood is higher by {gain:.0f}. The fitted parameters are biased to compensate for it.",
                {"log_likelihood_gain": gain, "record_asks_for": value},
                f"Free it with --free {name}, or correct it with --set {name}=VALUE.", name))
    return found


def _options_with_free(options: Options, name: str) -> Options:
    return replace(options, free=(*options.free, name), hold=tuple(n for n in options.hold if n != name))
