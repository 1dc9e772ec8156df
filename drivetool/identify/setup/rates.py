"""Recordings whose logger changed its rate: which steps fit every rate, and what the others leave out."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.finding import Finding
from drivetool.identify.setup.options import Options
from drivetool.logs import Experiment, parts_at_all_rates

# Their models run in continuous time, and have a step for each stretch. Polynomial models, spectra and filters of
# one cut-off are of one step; checks show one run of a recording.
STEPS_OF_EVERY_RATE = ("steady", "blackbox", "greybox", "backlash")


def at_rates(step: str, experiments: Sequence[Experiment], options: Options | None = None) -> list[Experiment]:
    """The parts of recordings that a step takes: those at every rate, or those at the most excited one."""
    one = options is not None and (options.structure is not None or options.criterion in ("inverse", "frequency"))
    return parts_at_all_rates(experiments) if step in STEPS_OF_EVERY_RATE and not one else list(experiments)


def rates_left_out(step: str, experiments: Sequence[Experiment], options: Options | None = None) -> list[Finding]:
    """A warning for each recording of which a step leaves out parts at another rate."""
    if len(at_rates(step, experiments, options)) > len(experiments):
        return []
    return [Finding(
        "warning", "rate-changes",
        f"{step} uses only the {e.used} samples of {e.name} at {e.rate}, since its rate changes. It leaves "
        f"out {' and '.join(f'{o.used} at {o.rate} ({o.used * o.step:.4g} s)' for o in e.others)}.",
        {"samples": e.used, "left_out": sum(o.used for o in e.others),
         "seconds_left_out": sum(o.used * o.step for o in e.others)},
        "Record at one rate; steady, blackbox, greybox and backlash fit every rate.")
            for e in experiments if e.others]
