"""Recordings whose logger changed its rate: which steps fit what is at every rate, and what others leave out."""

from __future__ import annotations

from collections.abc import Sequence

from drivetool.errors import Finding
from drivetool.identify.setup.options import Options
from drivetool.logs import Experiment, every_part

# Their models run in continuous time, and have a step for each stretch. Polynomial models, spectra and filters of
# one cut-off are of one step; checks show one run of a recording.
OF_EVERY_RATE = ("steady", "blackbox", "greybox", "backlash")


def at_rates(step: str, experiments: Sequence[Experiment], options: Options | None = None) -> list[Experiment]:
    """What a step takes of recordings: what is at every rate, or of each what is at the most excited one."""
    one = options is not None and (options.structure is not None or options.criterion in ("inverse", "frequency"))
    return every_part(experiments) if step in OF_EVERY_RATE and not one else list(experiments)


def rates_left_out(step: str, experiments: Sequence[Experiment], options: Options | None = None) -> list[Finding]:
    """What of recordings a step leaves out since it is at another rate: a warning for each."""
    if len(at_rates(step, experiments, options)) > len(experiments):
        return []
    return [Finding(
        "warning", "rate-not-used",
        f"{step} uses of {e.name} what is at {e.rate} alone, {e.used} samples; left out are "
        f"{' and '.join(f'{o.used} at {o.rate} ({o.used * o.step:.4g} s)' for o in e.others)}.",
        {"samples": e.used, "left_out": sum(o.used for o in e.others),
         "seconds_left_out": sum(o.used * o.step for o in e.others)},
        "Record at one rate; steady, blackbox, greybox and backlash fit every rate.")
        for e in experiments if e.others]
