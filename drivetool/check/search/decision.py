"""From held-out scores to a decision: found or not, which cause, or between which causes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.check.causes import CAUSES, DECISIVE_EXPERIMENTS
from drivetool.check.heldout import Score, total_evidence

TIE_STANDARD_ERRORS = 2.0  # about the 95 % interval of a difference of two causes
# Log likelihood. A choice: far above MIN_LEAD, because the rank test ignores how large the differences are.
CLEAR_LEAD = 20.0
# Log likelihood. A choice: e^4 = 55 to one; blocks that scatter little by chance must not separate two causes.
MIN_LEAD = 4.0
# Of the best gain. A choice: a cause that gains less than half is no tie, whatever the scatter.
TIE_GAIN_SHARE = 0.5
# Log likelihood, and share of the lead over the base, from which a look-alike is separate. A choice: no law is
# exact to less than a tenth.
LOOKALIKE_LEAD = 30.0
LOOKALIKE_LEAD_SHARE = 0.1
# Log likelihood per further parameter; chance gives 0.5 each (Wilks), 2.0 is the 95 % point of one.
MIN_GAIN_PER_PARAMETER = 2.0


@dataclass(frozen=True)
class Decision:
    """What one round decided.

    best      score of the selected cause, None if nothing was found
    between   codes that explain the record equally well, the best one included; one if it is named
    evidence  log10
    """

    best: Score | None
    between: tuple[str, ...]
    evidence: float


def decide(scores: Sequence[Score], budget: float, gained: float = 0.0,
           equivalent: Callable[[Score, Score], bool] = lambda *_: False) -> Decision:
    """Whether a cause is found, and which.

    budget      share of records without any cause on which one may be found
    gained      log likelihood by the causes that were found before
    equivalent  whether the response with a cause equals that with the best one
    """
    scores = after_elimination(scores)
    log_evidence = total_evidence(scores, gained)
    strength = float(log_evidence / np.log(10.0)) if np.isfinite(log_evidence) else -300.0
    if not scores or log_evidence < np.log(1.0 / budget):
        return Decision(None, (), strength)
    best = max(scores, key=lambda s: s.gain)
    if best.gain <= 0.0:
        return Decision(None, (), strength)
    close = [s for s in scores if s is best or is_equivalent(s, best, equivalent)]
    codes = {s.model.code for s in close}
    simple = [s for s in close if not codes.intersection(special_cases(s.model.code))]
    best = max(simple, key=lambda s: s.gain)
    return Decision(best, tuple(s.model.code for s in sorted(simple, key=lambda s: -s.gain)), strength)


def after_elimination(scores: Sequence[Score]) -> list[Score]:
    """The scores without laws whose special case is as likely: their further parameters are not significant.

    On held-out data they may still lead, because they were fitted under another noise.
    """
    return [s for s in scores if not any(
        t.model.code in special_cases(s.model.code)
        and s.lead - t.lead < MIN_GAIN_PER_PARAMETER * (s.further - t.further)
        for t in scores)]


def is_equivalent(one: Score, best: Score, equivalent: Callable[[Score, Score], bool] = lambda *_: False) -> bool:
    """Whether a cause is as good as the best: within the scatter over blocks, and not much weaker.

    Blocks differ in information, which adds scatter; where nearly all agree, the signed-rank test shows it
    (Wilcoxon 1945). Known look-alikes, say a filter and a lag, differ in their noise only and need more. Neither is
    better if it is no likelier on the whole record: held-out blocks then measure how well each half was fitted.
    Nor is a lag or a filter better whose response the other reproduces, however much likelier its noise is.
    A cause that leads on held-out data and is much likelier on the whole record is no look-alike any more.
    """
    difference = best.gains - one.gains
    error = np.sqrt(len(difference)) * np.std(difference, ddof=1)
    pair = frozenset((one.model.code, best.model.code))
    alike = pair in DECISIVE_EXPERIMENTS
    if alike and one.lead - one.further > best.lead - best.further - MIN_GAIN_PER_PARAMETER:
        return True
    if best.model.code in CAUSES and one.model.code in CAUSES[best.model.code].response and equivalent(one, best):
        return True
    if one.gain <= TIE_GAIN_SHARE * best.gain:
        return False
    if difference.sum() >= max(TIE_STANDARD_ERRORS * error, MIN_LEAD):
        return False
    if alike:
        ahead = best.lead - one.lead - MIN_GAIN_PER_PARAMETER * (best.further - one.further)
        return not (difference.sum() > 0.0 and ahead > max(LOOKALIKE_LEAD, LOOKALIKE_LEAD_SHARE * best.lead))
    if not difference.sum() > CLEAR_LEAD:
        return True
    tail = scipy.stats.norm.sf(TIE_STANDARD_ERRORS)
    return not scipy.stats.wilcoxon(difference, alternative="greater").pvalue < tail


def special_cases(code: str) -> tuple[str, ...]:
    """The causes that are special cases of one; none for a code outside the catalogue."""
    return CAUSES[code].special if code in CAUSES else ()
