"""Values that a fit holds and the record contradicts: the fit goes astray to make up for them."""

from __future__ import annotations

from dataclasses import replace

from drivetool.errors import DriveToolError, Finding
from drivetool.identify.fit import fit_apart, looks_coloured
from drivetool.identify.setup import Options, Outcome, Task

SHOWS = 30.0  # log likelihood that a value of its own must be worth: another optimum is worth some, too
LEAST = 0.01  # relative change that is worth a word


def contradicted_holds(task: Task, outcome: Outcome, options: Options, asked: Options) -> list[Finding]:
    """Of the half gaps, the dead time and what was asked to be held, each that the record would have otherwise.

    task            what was to be fitted, with its start values
    outcome         what came of it, by innovations
    options, asked  as of `fit_apart`
    returns         a warning per value, with what the record asks for while the other held values are as they were;
                    none where that leaves errors that repeat too: then something else is missing
    """
    drive = task.drive
    held = {"converter.dead_time", *(f"{s}.half_gap" for s in drive.shafts), *options.hold}
    names = [n for n in drive.quantities if n in held and n not in task.free and drive.value(n)]
    found = []
    for name in names if outcome.fit is not None else ():
        given, unit = drive.value(name), drive.unit(name)
        try:
            trial = fit_apart(replace(task, free=tuple(n for n in drive.quantities if n in {*task.free, name})),
                              _freeing(options, name), _freeing(asked, name), [{}])
        except DriveToolError:
            continue
        value, gain = trial.drive.value(name), outcome.fit.value - trial.fit.value
        if gain > SHOWS and abs(value - given) > LEAST * abs(given) and not looks_coloured(trial.fit.passes):
            found.append(Finding(
                "warning", "held-value-contradicted",
                f"{name} is held at {given:.4g} {unit}, where the record asks for {value:.4g}: log likelihood "
                f"{gain:.0f} higher. What is fitted makes up for it and goes astray.",
                {"log_likelihood_gain": gain, "record_asks_for": value},
                f"Fit it too, with --free {name}, or correct it with --set {name}=VALUE.", name))
    return found


def _freeing(options: Options, name: str) -> Options:
    return replace(options, free=(*options.free, name), hold=tuple(n for n in options.hold if n != name))
