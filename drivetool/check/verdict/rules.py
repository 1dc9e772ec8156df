"""The verdict as a table: the first rule whose condition the facts meet decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from drivetool.check.fit import MAX_RESIDUAL_GAIN, MAX_RESIDUAL_SHARE, residuals_large
from drivetool.check.outcome import (
    IMPLAUSIBLE_NOISE_SHARE,
    LARGE_ERROR_TO_NOISE,
    LARGE_REMAINING_SHARE,
    OUTSIDE_CATALOGUE,
    Facts,
    noise_hides_law,
)

# The same as below where a sensor is coarsely quantised: simulated quantisation is not an exact copy of it.
MIN_UNEXPLAINED_GAIN_QUANTISED = 100.0
# Log likelihood that residual tests gain beyond chance before a cause is missing. A choice: far above chance, as
# noise models are approximate; docs/evidence/diagnosis.md counts the false alarms.
MIN_UNEXPLAINED_GAIN = 25.0
# Of the free-run error. A choice: beyond the scatter, true causes do not raise it by a quarter.
MAX_FREE_RUN_ERROR_INCREASE = 0.25
# Of that error, or of what could be explained. A choice: a cause that removes less explains little.
MIN_IMPROVED_SHARE = 0.3
MIN_IMPROVEMENT_STDS = 2.0  # standard errors of a gain on held-out data: about 95 % of a normal distribution
# Of the torque's standard deviation. A choice: torque noise that large occurs in drives.
USUAL_TORQUE_NOISE_SHARE = 0.05
MAX_ERROR_TO_NOISE_ERROR = 1.5  # of the error that noise causes. A choice: a margin for the scatter of such errors
# Of the variance of load steps: at random instants a function of speed hardly ever explains 0.8.
MIN_SHARE_BY_SPEED = 0.9
RECORDS_DIFFER_RULE = "held-out-differs"  # the rule whose sentence is about the records
WEAK_SUPPORT_TEXT = "its gain on held-out data is below two standard errors"
LOAD_BY_SPEED_TEXT = "a load that changes with the speed may be nonlinear friction instead"
SEVERAL_LOADS_TEXT = (
    "a load that changes several times can approximate another effect, and the residual is not white")


@dataclass(frozen=True)
class Judgement:
    """A verdict.

    causes   what is certain; between: what it may be
    doubt    why it may be something in no catalogue; empty: no such reason, or the torque noise is the reason
    rule     name of the rule that decided
    """

    verdict: str
    causes: tuple[str, ...] = ()
    between: tuple[str, ...] = ()
    doubt: str = ""
    rule: str = ""


@dataclass(frozen=True)
class Rule:
    """One line of the table.

    when    the condition in words; holds: the same as a function of the facts; says: the judgement then
    reason  why it is one; source: literature, or the figure of the evidence part that it rests on
    """

    name: str
    when: str
    holds: Callable[[Facts], bool]
    says: Callable[[Facts], Judgement]
    reason: str
    source: str


def residual_significant(f: Facts) -> bool:
    """Whether the residual tests without any cause gain more than chance, and more than quantisation explains."""
    return f.left > (MIN_UNEXPLAINED_GAIN_QUANTISED if "quantisation" in f.faults else MIN_UNEXPLAINED_GAIN)


def residual_still_significant(f: Facts) -> bool:
    """Whether the residual with the causes contradicts them: they stand in for a law that is not listed."""
    return (residuals_large(f.left, f.gained) or f.left_time > MIN_UNEXPLAINED_GAIN
            or (f.repeats and "quantisation" not in f.faults))


def worsens_free_runs(f: Facts) -> bool:
    """Whether the free-run error on held-out data is clearly larger with the causes found."""
    return f.after - f.before > max(MAX_FREE_RUN_ERROR_INCREASE * f.before, f.scatter)


def improves_clearly(f: Facts) -> bool:
    """Whether the free-run error falls much, or much less of what could be explained is left."""
    return (f.before - f.after > max(MIN_IMPROVED_SHARE * f.before, MIN_IMPROVEMENT_STDS * f.scatter)
            or f.left_percent < 100.0 * (1.0 - MIN_IMPROVED_SHARE))


def nothing_explains(f: Facts) -> bool:
    """Whether neither an accepted law nor a fault of the records explains the records."""
    return worsens_free_runs(f) if f.causes else bool(f.unasked) or residual_significant(f) or not f.faults


def noise_may_hide_law(f: Facts) -> bool:
    """Whether a law in no catalogue may hide behind the torque noise.

    Not where three things hold: no residual test gains, drives have so much noise, and it alone causes a free-run
    error as large. A hidden law would then have to be as fast as noise and cause no larger error.
    """
    if not noise_hides_law(f.before, f.after, f.floor, f.torque_noise):
        return False
    return (f.torque_noise > USUAL_TORQUE_NOISE_SHARE or f.left > 0.0
            or f.after > MAX_ERROR_TO_NOISE_ERROR * (f.by_noise or 0.0))


def certain_causes(f: Facts, uncertain: Sequence[str] = ()) -> tuple[str, ...]:
    """Faults, and the causes that have no rivals and are not listed as uncertain."""
    return (*f.faults, *(c for c in f.causes if c not in f.between and c not in uncertain))


def unexplained_judgement(f: Facts) -> Judgement:
    """Only faults of the records are certain, except those that an incomplete drive model shows."""
    return Judgement("unexplained", tuple(c for c in f.faults if c not in f.by_model))


def partial_judgement(f: Facts) -> Judgement:
    """The causes found, or something in no catalogue of which they are a part."""
    return Judgement("undetermined", f.faults, tuple(dict.fromkeys((*f.causes, *f.between, OUTSIDE_CATALOGUE))),
                     f"{f.left_percent:.0f} % of the explainable residual remains")


def undetermined_judgement(*uncertain: str, doubt: str = "") -> Callable[[Facts], Judgement]:
    """Some causes may be something in no catalogue."""
    return lambda f: Judgement("undetermined", certain_causes(f, uncertain), (*uncertain, OUTSIDE_CATALOGUE), doubt)


EVIDENCE = "Records whose cause was left out of the catalogue: part `removed` of `tests/study/study_diagnose.py`."
WHITENESS = "Whiteness of one-step prediction errors: Ljung 1999, section 16.6."
HELD_OUT = "Validation on held-out data: Ljung 1999, chapter 16."
E_VALUE = "Wasserman, Ramdas, Balakrishnan 2020: the likelihood ratio on held-out data is an e-value."
LARGE_RESIDUAL_TEXT = (
    f"`left` above {100.0 * MAX_RESIDUAL_SHARE:g} % of `gained` and above {MAX_RESIDUAL_GAIN:g}, `left_time` above "
             f"{MIN_UNEXPLAINED_GAIN:g}, or `repeats` without quantisation")

RULES: tuple[Rule, ...] = (
    Rule(RECORDS_DIFFER_RULE, "`other_values`, and no law or fault of the record explains them",
         lambda f: f.other_values and nothing_explains(f), unexplained_judgement,
         "The parameters differ on held-out records, and no effect was found that explains this.", HELD_OUT),
    Rule("not-asked-for", "`unasked` names a cause", lambda f: bool(f.unasked), unexplained_judgement,
         "The cause that explains the records was not among the candidates.", "By definition."),
    Rule("spoils-free-runs",
         f"`after` exceeds `before` by {100.0 * MAX_FREE_RUN_ERROR_INCREASE:g} % and by `scatter`",
         lambda f: bool(f.causes) and worsens_free_runs(f), unexplained_judgement,
         "Causes that worsen the free-run error on held-out data do not describe the machine.", HELD_OUT),
    Rule("part-of-it",
         f"{LARGE_RESIDUAL_TEXT}; and `after` is {100.0 * MIN_IMPROVED_SHARE:g} % below `before` and by "
         f"{MIN_IMPROVEMENT_STDS:g} `scatter`, or `left_percent` is below {100.0 * (1.0 - MIN_IMPROVED_SHARE):g}",
         lambda f: bool(f.causes) and residual_still_significant(f) and improves_clearly(f), partial_judgement,
         "The residual tests are significant, but the causes explain much of the residual.", WHITENESS),
    Rule("leaves-much", LARGE_RESIDUAL_TEXT,
         lambda f: bool(f.causes) and residual_still_significant(f), unexplained_judgement,
         "The residual tests are significant, and the causes explain little of the residual.", WHITENESS),
    Rule("rivals-behind-noise", "`between` names causes, and `torque_noise` hides a law as under noise-hides-a-law",
         lambda f: bool(f.between) and noise_may_hide_law(f),
         lambda f: Judgement("undetermined", certain_causes(f),
                             tuple(dict.fromkeys((*f.between, OUTSIDE_CATALOGUE)))),
         "Several causes fit equally well, and none of them explains the large torque noise.", EVIDENCE),
    Rule("rivals", "`between` names causes", lambda f: bool(f.between),
         lambda f: Judgement("undetermined", certain_causes(f), f.between),
         "Held-out data do not distinguish the causes.",
         "Vuong 1989: models are compared by the scatter of their difference."),
    Rule("nothing-fits",
         f"no cause, and `left` above {MIN_UNEXPLAINED_GAIN:g}, "
         f"with quantisation above {MIN_UNEXPLAINED_GAIN_QUANTISED:g}",
         lambda f: not f.causes and residual_significant(f), unexplained_judgement,
         "The prediction errors are not white, and no cause of the catalogue explains them.", WHITENESS),
    Rule("record-at-fault", "no cause, and `faults` names some", lambda f: not f.causes and bool(f.faults),
         lambda f: Judgement("named", f.faults), "The faults of the records explain the residual.",
         "By definition."),
    Rule("nothing-found", "no cause", lambda f: not f.causes, lambda f: Judgement("nothing-found"),
         "The records hold nothing beyond noise.", E_VALUE),
    Rule("noise-hides-a-law",
         f"`torque_noise` above {IMPLAUSIBLE_NOISE_SHARE:g}, `after` above {LARGE_ERROR_TO_NOISE:g} `floor` and "
         f"{LARGE_REMAINING_SHARE:g} `before`; unless `torque_noise` is below {USUAL_TORQUE_NOISE_SHARE:g}, "
         f"`left` is 0 and `after` below {MAX_ERROR_TO_NOISE_ERROR:g} `by_noise`",
         noise_may_hide_law, lambda f: undetermined_judgement(f.strongest)(f),
         "The torque would need more noise than drives have: another law may be at work.", EVIDENCE),
    Rule("hardly-told", "`hardly` names causes", lambda f: bool(f.hardly),
         lambda f: undetermined_judgement(*f.hardly, doubt=WEAK_SUPPORT_TEXT)(f),
         "The gain of a cause on held-out blocks is not significant.",
         "Two standard errors of a sum over blocks."),
    Rule("load-leaves-something", "`load_changes` above 1 and `left` above 0",
         lambda f: f.load_changes > 1 and f.left > 0.0,
         undetermined_judgement("load-step", doubt=SEVERAL_LOADS_TEXT),
         "A load torque that changes often enough can approximate any effect.", EVIDENCE),
    Rule("load-goes-with-speed", f"`load_changes` above 1 and `by_speed` above {MIN_SHARE_BY_SPEED:g}",
         lambda f: f.load_changes > 1 and (f.by_speed or 0.0) > MIN_SHARE_BY_SPEED,
         undetermined_judgement("load-step", doubt=LOAD_BY_SPEED_TEXT),
         "A load torque that is a function of speed is friction.",
         "Loads at random instants share a third of their variance with a function of speed, hardly ever 0.8."),
    Rule("explained", "otherwise", lambda f: True, lambda f: Judgement("named", certain_causes(f)),
         "No rival fits as well, the residual is noise, and free runs agree.", E_VALUE),
)


def apply_rules(facts: Facts, rules: Sequence[Rule] = RULES) -> Judgement:
    """The verdict by the first rule that the facts meet; rules: the table, or one without some of its lines."""
    rule = next(r for r in rules if r.holds(facts))
    return replace(rule.says(facts), rule=rule.name)
