"""From scores to a verdict: found or not, which one, or between which."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, wilcoxon

from drivetool.check.causes import CAUSES, DECIDES
from drivetool.check.heldout import Score, total_evidence

CLOSE = 2.0  # standard errors within which two causes explain the record equally well
PLAIN = 20.0  # log likelihood that counts as a difference where nearly all blocks agree on it
LEAST = 4.0  # log likelihood that is a tie whatever the scatter says
SHARE = 0.5  # of the best gain that a tie must have
AHEAD = 30.0  # log likelihood on the whole record by which a cause is no longer like another one
MUCH = 0.1  # of its lead over the base, the same: no law is exact to less
SURPLUS = 2.0  # log likelihood that each further parameter of a law must bring over its special case


@dataclass(frozen=True)
class Decision:
    """What one round decided.

    best      the score that counts, None if nothing was found
    between   codes that explain the record equally well, the best one included; one if it is named
    evidence  log10
    """

    best: Score | None
    between: tuple[str, ...]
    evidence: float


def decide(scores: Sequence[Score], budget: float, gained: float = 0.0,
           imitates: Callable[[Score, Score], bool] = lambda *_: False) -> Decision:
    """Whether a cause is found, and which.

    budget    share of records without any cause on which one may be found
    gained    log likelihood by the causes that were found before
    imitates  whether a cause could have made the motion that the best one makes
    """
    scores = with_use(scores)
    log_evidence = total_evidence(scores, gained)
    strength = float(log_evidence / np.log(10.0)) if np.isfinite(log_evidence) else -300.0
    if not scores or log_evidence < np.log(1.0 / budget):
        return Decision(None, (), strength)
    best = max(scores, key=lambda s: s.gain)
    if best.gain <= 0.0:
        return Decision(None, (), strength)
    close = [s for s in scores if s is best or ties(s, best, imitates)]
    codes = {s.model.code for s in close}
    simple = [s for s in close if not codes.intersection(special_cases(s.model.code))]
    best = max(simple, key=lambda s: s.gain)
    return Decision(best, tuple(s.model.code for s in sorted(simple, key=lambda s: -s.gain)), strength)


def with_use(scores: Sequence[Score]) -> list[Score]:
    """The scores without laws whose special case is as likely: what they have beyond it says nothing.

    On data held out they may still come out ahead, fitted under another noise.
    """
    return [s for s in scores if not any(
        t.model.code in special_cases(s.model.code) and s.lead - t.lead < SURPLUS * (s.further - t.further)
        for t in scores)]


def ties(one: Score, best: Score, imitates: Callable[[Score, Score], bool] = lambda *_: False) -> bool:
    """Whether a cause is as good as the best: within the scatter over blocks, and not much weaker.

    Blocks tell more or less, and that scatters too: where they are of one mind, ranks show it (Wilcoxon 1945). Not
    for causes that are known to look alike: a filter and a lag, say, differ in what they make of the noise only.
    Of these none is better whose whole record is no likelier: what blocks say then is how well half of them was
    fitted. Nor is a lag or a filter whose motion the other makes as well, however much likelier the noise is. But
    what is ahead on data held out and much likelier on the whole record no longer looks alike.
    """
    difference = best.gains - one.gains
    error = np.sqrt(len(difference)) * np.std(difference, ddof=1)
    pair = frozenset((one.model.code, best.model.code))
    alike = pair in DECIDES
    if alike and one.lead - one.further > best.lead - best.further - SURPLUS:
        return True
    if best.model.code in CAUSES and one.model.code in CAUSES[best.model.code].response and imitates(one, best):
        return True
    if one.gain <= SHARE * best.gain:
        return False
    if difference.sum() >= max(CLOSE * error, LEAST):
        return False
    if alike:
        ahead = best.lead - one.lead - SURPLUS * (best.further - one.further)
        return not (difference.sum() > 0.0 and ahead > max(AHEAD, MUCH * best.lead))
    return not (difference.sum() > PLAIN and wilcoxon(difference, alternative="greater").pvalue < norm.sf(CLOSE))


def special_cases(code: str) -> tuple[str, ...]:
    """The causes that are special cases of one; none of what is no cause."""
    return CAUSES[code].special if code in CAUSES else ()
