"""The verdict as a table: the first rule whose condition the facts meet decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivetool.check.fit import LEFT, LITTLE, much_left
from drivetool.check.outcome import IMPLAUSIBLE, LOUD, REST, UNLISTED, Facts, taken_for_noise

STEPS = 100.0  # the same where a sensor is logged in coarse steps, of which a record made up is not a true copy
UNEXPLAINED = 25.0  # log likelihood to be had, beyond what chance gives, before something is said to be wrong
WORSE = 0.25  # of the error of free runs, beyond its scatter, by which causes that are true do not raise it
PART = 0.3  # of that error, or of what could be explained, that is part of the answer
SURELY = 2.0  # standard errors of a gain on data held out
SOME = 0.05  # of the torque's spread: a noise of the torque as drives have it
FORETOLD = 1.5  # of the error that noise makes, up to which it is no sign of anything else
SAME = 0.9  # of the variance of a load that changes several times, from which a function of the speed is one, too
DIFFERS = "held-out-differs"  # the rule whose sentence is about the records
SCATTER = "data held out tell it by less than two standard errors"
OF_SPEED = "a load that changes with the speed may as well be friction of another law"
SEVERAL = "a load that changes several times can stand in for a law, and what it leaves is not noise alone"


@dataclass(frozen=True)
class Judgement:
    """A verdict.

    causes   what is certain; between: what it may be
    doubt    why that may be something in no catalogue; empty: no such doubt, or the noise of the torque is it
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

    when    the condition in words; holds: the same of the facts; says: what the verdict is then
    reason  why it is one; source: literature, or the figure of the evidence part that it rests on
    """

    name: str
    when: str
    holds: Callable[[Facts], bool]
    says: Callable[[Facts], Judgement]
    reason: str
    source: str


def leaves_something(f: Facts) -> bool:
    """Whether one-step errors ask for more without any cause, and more than the steps of a logger leave."""
    return f.left > (STEPS if "quantisation" in f.faults else UNEXPLAINED)


def leaves_much(f: Facts) -> bool:
    """Whether what the causes leave speaks against them: they stand in for a law that is not listed."""
    return (much_left(f.left, f.gained) or f.left_time > UNEXPLAINED
            or (f.repeats and "quantisation" not in f.faults))


def spoils(f: Facts) -> bool:
    """Whether free runs over data held out are clearly worse with what was found."""
    return f.after - f.before > max(WORSE * f.before, f.scatter)


def helps(f: Facts) -> bool:
    """Whether free runs become much better, or single steps have much less left that could be explained."""
    return (f.before - f.after > max(PART * f.before, SURELY * f.scatter)
            or f.left_percent < 100.0 * (1.0 - PART))


def names_nothing(f: Facts) -> bool:
    """Whether neither a law that stands nor a fault of the records is the answer."""
    return spoils(f) if f.causes else bool(f.unasked) or leaves_something(f) or not f.faults


def hides(f: Facts) -> bool:
    """Whether a law in no catalogue may hide behind the noise of the torque.

    Not where single steps leave nothing, a drive may have so much noise, and that alone makes as large an error of
    free runs: a law that stands behind it would have to be as quick as noise, and go astray no further.
    """
    if not taken_for_noise(f.before, f.after, f.floor, f.torque_noise):
        return False
    return f.torque_noise > SOME or f.left > 0.0 or f.after > FORETOLD * (f.by_noise or 0.0)


def certain(f: Facts, doubted: Sequence[str] = ()) -> tuple[str, ...]:
    """Faults, and the causes without rivals that are not doubted."""
    return (*f.faults, *(c for c in f.causes if c not in f.between and c not in doubted))


def unexplained(f: Facts) -> Judgement:
    """Only what is wrong with the records is certain, as far as no drive that lacks something has told it."""
    return Judgement("unexplained", tuple(c for c in f.faults if c not in f.by_model))


def part_of_it(f: Facts) -> Judgement:
    """What was found, or something in no catalogue that it is part of."""
    return Judgement("undetermined", f.faults, tuple(dict.fromkeys((*f.causes, *f.between, UNLISTED))),
                     f"{f.left_percent:.0f} % of what could be explained is left")


def without(*doubted: str, doubt: str = "") -> Callable[[Facts], Judgement]:
    """Some causes may be something in no catalogue."""
    return lambda f: Judgement("undetermined", certain(f, doubted), (*doubted, UNLISTED), doubt)


EVIDENCE = "Records whose cause was left out of the catalogue, docs/evidence/diagnosis.md."
WHITENESS = "Whiteness of one-step errors: Ljung 1999, section 16.6."
HELD_OUT = "Validation on data held out: Ljung 1999, chapter 16."
E_VALUE = "Wasserman, Ramdas, Balakrishnan 2020: the ratio on data held out is an e-value."
MUCH_LEFT = (f"`left` above {100.0 * LEFT:g} % of `gained` and above {LITTLE:g}, `left_time` above "
             f"{UNEXPLAINED:g}, or `repeats` without quantisation")

RULES: tuple[Rule, ...] = (
    Rule(DIFFERS, "`other_values`, and no law or fault of the record explains them",
         lambda f: f.other_values and names_nothing(f), unexplained,
         "Records held out ask for other values, and no law was found that would ask for them too.", HELD_OUT),
    Rule("not-asked-for", "`unasked` names a cause", lambda f: bool(f.unasked), unexplained,
         "What explains the records was not among the candidates.", "By definition."),
    Rule("spoils-free-runs", f"`after` exceeds `before` by {100.0 * WORSE:g} % and by `scatter`",
         lambda f: bool(f.causes) and spoils(f), unexplained,
         "What makes free runs over data held out worse is nobody's model of the machine.", HELD_OUT),
    Rule("part-of-it", f"{MUCH_LEFT}; and `after` is {100.0 * PART:g} % below `before` and by {SURELY:g} "
         f"`scatter`, or `left_percent` is below {100.0 * (1.0 - PART):g}",
         lambda f: bool(f.causes) and leaves_much(f) and helps(f), part_of_it,
         "One-step errors ask for more, but much of what there was is explained.", WHITENESS),
    Rule("leaves-much", MUCH_LEFT, lambda f: bool(f.causes) and leaves_much(f), unexplained,
         "One-step errors ask for more, and little of what there was is explained.", WHITENESS),
    Rule("rivals-behind-noise", "`between` names causes, and `torque_noise` hides a law as under noise-hides-a-law",
         lambda f: bool(f.between) and hides(f),
         lambda f: Judgement("undetermined", certain(f), tuple(dict.fromkeys((*f.between, UNLISTED)))),
         "Several causes do equally well, and none of them explains how large the torque's noise is.", EVIDENCE),
    Rule("rivals", "`between` names causes", lambda f: bool(f.between),
         lambda f: Judgement("undetermined", certain(f), f.between), "Data held out do not tell the causes apart.",
         "Vuong 1989: models are compared by the scatter of their lead."),
    Rule("nothing-fits", f"no cause, and `left` above {UNEXPLAINED:g}, with quantisation above {STEPS:g}",
         lambda f: not f.causes and leaves_something(f), unexplained,
         "One-step errors ask for something, and no cause of the catalogue is it.", WHITENESS),
    Rule("record-at-fault", "no cause, and `faults` names some", lambda f: not f.causes and bool(f.faults),
         lambda f: Judgement("named", f.faults), "What is wrong with the records explains them.", "By definition."),
    Rule("nothing-found", "no cause", lambda f: not f.causes, lambda f: Judgement("nothing-found"),
         "The records hold nothing beyond noise.", E_VALUE),
    Rule("noise-hides-a-law", f"`torque_noise` above {IMPLAUSIBLE:g}, `after` above {LOUD:g} `floor` and "
         f"{REST:g} `before`; unless `torque_noise` is below {SOME:g}, `left` is 0 and `after` below {FORETOLD:g} "
         "`by_noise`",
         hides, lambda f: without(f.strongest)(f),
         "The torque would need more noise than drives have: another law may be at work.", EVIDENCE),
    Rule("hardly-told", "`hardly` names causes", lambda f: bool(f.hardly),
         lambda f: without(*f.hardly, doubt=SCATTER)(f), "Blocks of data held out hardly agree that it is there.",
         "Two standard errors of a sum over blocks."),
    Rule("load-leaves-something", "`load_changes` above 1 and `left` above 0",
         lambda f: f.load_changes > 1 and f.left > 0.0, without("load-step", doubt=SEVERAL),
         "A load that changes often enough can stand in for any law.", EVIDENCE),
    Rule("load-goes-with-speed", f"`load_changes` above 1 and `by_speed` above {SAME:g}",
         lambda f: f.load_changes > 1 and (f.by_speed or 0.0) > SAME, without("load-step", doubt=OF_SPEED),
         "A load that comes and goes with the speed is friction.",
         "Loads at random instants share a third of their variance with a function of speed, hardly ever 0.8."),
    Rule("explained", "otherwise", lambda f: True, lambda f: Judgement("named", certain(f)),
         "No rival does as well, what is left is noise, and free runs agree.", E_VALUE),
)


def judged(facts: Facts, rules: Sequence[Rule] = RULES) -> Judgement:
    """The verdict by the first rule that the facts meet; rules: the table, or one without some of its lines."""
    rule = next(r for r in rules if r.holds(facts))
    said = rule.says(facts)
    return Judgement(said.verdict, said.causes, said.between, said.doubt, rule.name)
