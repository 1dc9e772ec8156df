"""Conditioning: steps applied to an experiment before it is used, each reported in its findings.

    despike window=7 threshold=5 roles=motor_speed   replaces outliers from the running median
    lowpass cutoff=50 order=4                        Butterworth, forward and backward, on all channels alike
    detrend order=0 roles=motor_angle                mean (0) or straight line (1) of each segment
    decimate factor=5                                low-passed at 0.8 of the new half rate
    differentiate roles=motor_angle                  the angle becomes a speed, by central differences
    integrate roles=motor_speed                      a speed computed from an encoder's counts becomes their sum
    keep from=2 to=8                                 this part of the recording only, in seconds from its start
    omit from=4.5 to=5                               all but this part; the motion starts anew after it

keep and omit act before all others, and before any check of the recording, which omits the faults in it.
`roles` is optional; without it a step takes all roles that it can.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.errors import BadOption, NotEnoughData, nearest
from drivetool.finding import Finding
from drivetool.logs import INPUTS, MIN_SAMPLES, ROLES, Experiment, ordered_roles, role_of
from drivetool.logs.samples import differentiate, low_pass, remove_spikes


@dataclass(frozen=True)
class ConditioningStep:
    """A conditioning step: its name, its numbers with defaults filled in, and roles (empty: all)."""

    name: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    roles: tuple[str, ...] = ()

    @property
    def finite_numbers(self) -> dict[str, float]:
        """Its finite numbers; an infinite one means no bound."""
        return {key: value for key, value in self.numbers.items() if math.isfinite(value)}

    @property
    def text(self) -> str:
        """As a person writes it."""
        words = [self.name, *(f"{key}={value:g}" for key, value in self.finite_numbers.items())]
        return " ".join([*words, *([f"roles={','.join(self.roles)}"] if self.roles else [])])


# option -> (default, least, whether whole); no default: it has to be given.
_OPTIONS: dict[str, dict[str, tuple[float | None, float, bool]]] = {
    "despike": {"window": (7, 3, True), "threshold": (5.0, 1.0, False)},
    "lowpass": {"cutoff": (None, 1e-9, False), "order": (4, 1, True)},
    "detrend": {"order": (0, 0, True)},
    "decimate": {"factor": (None, 2, True)},
    "differentiate": {},
    "integrate": {},
    "keep": {"from": (0.0, 0.0, False), "to": (math.inf, 0.0, False)},
    "omit": {"from": (None, 0.0, False), "to": (None, 0.0, False)},
}
_ALL_CHANNELS = ("lowpass", "decimate", "keep", "omit")


def parse_step(text: str) -> ConditioningStep:
    """The step behind words such as 'lowpass cutoff=50'; commas or a colon may separate them too.

    raises  BadOption: an unknown step or option, a number that cannot be
    """
    name, *words = text.replace(":", " ", 1).split()
    known = _OPTIONS.get(name)
    if known is None:
        raise BadOption("a known conditioning step", f"'{name}'", nearest(name, _OPTIONS))
    given, roles = {}, ()
    for word in words:
        key, _, value = word.partition("=")
        if key == "roles" and name not in _ALL_CHANNELS:
            roles = tuple(filter(None, value.split(",")))
        elif key in known:
            given[key] = _parse_number(name, key, value, known[key])
        else:
            more = [] if name in _ALL_CHANNELS else ["roles"]
            raise BadOption(f"a known option of {name}", f"'{word}'", nearest(key, [*known, *more]))
    for role in roles:
        if role_of(role) is None:
            raise BadOption(f"a known role for {name}", f"'{role}'", nearest(role, ROLES))
    for key, (default, _, _) in known.items():
        if default is None and key not in given:
            raise BadOption(f"{key} for {name}", "none", f"Write for example '{name} {key}=5'.")
    return ConditioningStep(name, {key: given.get(key, default) for key, (default, _, _) in known.items()}, roles)


def _parse_number(name: str, key: str, text: str, rule: tuple[float | None, float, bool]) -> float:
    """A number of a step within its bounds."""
    _, least, whole = rule
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least) or (whole and value != int(value)):
        raise BadOption(f"{'a whole number' if whole else 'a number'} of at least {least:g} for {key} of {name}",
                        f"'{text}'", "Correct it.")
    return value


def condition(experiment: Experiment, steps: Sequence[ConditioningStep]) -> Experiment:
    """The experiment after the steps, in their order; keep and omit came before it (parts.py).

    returns  a new Experiment; each step is a note in its findings. Parts at other rates pass the same steps
    raises   BadOption: a role that is not there, a cut-off above half the rate; NotEnoughData: too few
             samples left
    """
    for step in steps:
        if step.name not in _STEP_FUNCTIONS:
            continue
        missing = [role for role in step.roles if role not in experiment.signals]
        if missing:
            raise BadOption(f"role {missing[0]} to {step.name}", f"none in {experiment.name}",
                            "Leave it out, or name its channel.", experiment.signals)
        changed, evidence, text = _STEP_FUNCTIONS[step.name](experiment, step)
        note = Finding("note", "conditioned", f"{experiment.name}: {step.text}: {text}.",
                       {"step": step.name, **step.finite_numbers, **evidence})
        experiment = replace(changed, findings=(*experiment.findings, note),
                             signals={role: read_only(v) for role, v in changed.signals.items()})
    others = [condition(other, steps) for other in experiment.others]
    notes = list(experiment.findings)
    for other in others:
        notes += [f for f in other.findings if f not in notes]
    return replace(experiment, findings=tuple(notes), others=tuple(replace(o, findings=()) for o in others))


def read_only(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written to; the recording's own array stays as it was."""
    values = np.ascontiguousarray(values, dtype=float).view()
    values.setflags(write=False)
    return values


StepResult = tuple[Experiment, dict[str, float], str]


def _despike(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """Outliers are replaced by the running median."""
    roles = step.roles or tuple(experiment.signals)
    signals, counts = dict(experiment.signals), {}
    for role in roles:
        values = signals[role].copy()
        for first, last in experiment.segments:
            values[first:last], found = remove_spikes(values[first:last], int(step.numbers["window"]),
                                                 step.numbers["threshold"])
            counts[role] = counts.get(role, 0) + int(found.sum())
        signals[role] = values
    replaced = ", ".join(f"{count} samples of {role}" for role, count in counts.items())
    return (replace(experiment, signals=signals), {f"replaced_{role}": n for role, n in counts.items()},
            f"{replaced} replaced by the running median")


def _low_pass(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """All channels alike, so that the relations between them do not change."""
    cutoff, half = step.numbers["cutoff"], 0.5 / experiment.step
    if cutoff >= half:
        raise BadOption(f"a cut-off below half the rate, {half:g} Hz, for {step.name}", f"{cutoff:g} Hz",
                        "Choose a lower one, or leave the step out.")
    signals = {role: low_pass(values, experiment.segments, cutoff * experiment.step,
                              int(step.numbers["order"]))
               for role, values in experiment.signals.items()}
    return replace(experiment, signals=signals), {}, "all channels low-passed without delay"


def _detrend(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """The mean or the straight line of every segment is taken out."""
    roles = step.roles or tuple(experiment.signals)
    signals = dict(experiment.signals)
    for role in roles:
        values = signals[role].copy()
        for first, last in experiment.segments:
            place = np.arange(first, last)
            known = np.isfinite(values[first:last])
            if known.sum() > step.numbers["order"]:
                line = np.polynomial.Polynomial.fit(place[known], values[first:last][known],
                                                    int(step.numbers["order"]))
                values[first:last] -= line(place)
        signals[role] = values
    what = "mean" if step.numbers["order"] == 0 else f"polynomial of order {step.numbers['order']:g}"
    return replace(experiment, signals=signals), {}, f"{what} of every segment taken out of {', '.join(roles)}"


def _decimate(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """All channels low-passed alike; then sensors are picked, and inputs averaged over the longer step.

    Averaging keeps an input's impulse: it is held over the step that follows, and a picked value
    would act half a step too late.
    """
    factor = int(step.numbers["factor"])
    segments = tuple((a, b) for first, last in experiment.segments
                     for a, b in [(-(-first // factor), last // factor)] if b > a)
    if (left := sum(b - a for a, b in segments)) < MIN_SAMPLES:
        raise NotEnoughData(f"at least {MIN_SAMPLES} samples of {experiment.name} after {step.text}", f"{left}",
                            "Take a smaller factor.")
    signals = {}
    for role, values in experiment.signals.items():
        smooth = low_pass(values, experiment.segments, 0.4 / factor, 4)
        blocks = smooth[:len(smooth) // factor * factor].reshape(-1, factor)
        signals[role] = blocks.mean(axis=1) if role in INPUTS else blocks[:, 0]
    changed = replace(experiment, signals=signals, segments=segments, step=experiment.step * factor)
    return changed, {"step_after": changed.step}, f"the step is {changed.step:g} s now"


def _differentiate(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """Angles become speeds; the angle is dropped, since it adds no information to the speed."""
    roles = step.roles or tuple(role for role in experiment.signals if role.endswith("_angle")
                                and f"{role[:-6]}_speed" not in experiment.signals)
    if not roles:
        raise BadOption(f"an angle without a speed beside it in {experiment.name}", "none",
                        "Leave differentiate out.", experiment.signals)
    signals = {}
    for role, values in experiment.signals.items():
        if role not in roles:
            signals[role] = values
            continue
        if not role.endswith("_angle") or f"{role[:-6]}_speed" in experiment.signals:
            raise BadOption("an angle without a speed beside it to differentiate", role,
                            "Leave it out, or leave the speed out of the channel map.")
        speed = np.full(len(values), np.nan)
        for first, last in experiment.segments:
            speed[first:last] = differentiate(values[first:last], experiment.step)
        signals[f"{role[:-6]}_speed"] = speed
    return replace(experiment, signals=signals), {}, f"{', '.join(roles)} became speeds by central differences"


def _integrate(experiment: Experiment, step: ConditioningStep) -> StepResult:
    """Speeds become the angles whose differences they are; an existing angle stays."""
    roles = step.roles or tuple(role for role in experiment.signals if role.endswith("_speed"))
    wrong = [role for role in roles if not role.endswith("_speed")]
    if wrong or not roles:
        raise BadOption(f"a speed in {experiment.name} to integrate", wrong[0] if wrong else "none",
                        "Name a speed, or leave integrate out.", experiment.signals)
    signals = dict(experiment.signals)
    for role in roles:
        speed, angle = signals.pop(role), np.full(len(experiment.signals[role]), np.nan)
        for first, last in experiment.segments:
            if not np.isfinite(speed[first:last]).all():
                raise BadOption(f"a value of {role} at every sample of {experiment.name} to integrate",
                                f"{int(np.isnan(speed[first:last]).sum())} missing",
                                "Leave integrate out: the motion at missing samples is unknown.")
            angle[first:last] = np.cumsum(speed[first:last]) * experiment.step
        signals.setdefault(f"{role[:-6]}_angle", angle)
    return (replace(experiment, signals={r: signals[r] for r in ordered_roles(signals)}), {},
            f"{', '.join(roles)} summed up to angles from zero")


_STEP_FUNCTIONS: dict[str, Callable[[Experiment, ConditioningStep], StepResult]] = {
    "despike": _despike, "lowpass": _low_pass, "detrend": _detrend, "decimate": _decimate,
    "differentiate": _differentiate, "integrate": _integrate}
