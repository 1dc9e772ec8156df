"""What differs where a gap is crossed: contacts give the likelihood many local optima, and free runs diverge.

A filter that is linearised about its state is wrong while the state may be on either side of a contact. So its
likelihood finds spurious laws and distant local optima. Free runs short enough for few contacts reveal both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.identify.laws.fit_with_laws import near
from drivetool.identify.laws.free_run_test import FreeRunTest
from drivetool.identify.noise import MAX_REPEATED_FITS, refit_with_tight_tolerance, until_converged
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts import log_likelihood_distance, start_agrees

# Free-run error without laws over that with them, from which the laws are confirmed. A spurious law changes it by
# less than a tenth, also in local optima; a cogging torque of 5 % changed it by a factor of fifteen.
MIN_CONFIRMING_ERROR_RATIO = 1.2
# Log likelihood, a choice: a smaller difference is no other optimum but incomplete convergence.
MIN_OTHER_OPTIMUM_GAIN = 1.0
SAME_VALUE_TOLERANCE = 1e-6  # relative, of all values: without noise any two points differ much in log likelihood


def laws_reduce_free_run_error(judge: FreeRunTest, without: Outcome, with_them: Outcome) -> bool:
    """Whether the laws reduce the error of free runs; on a record without motion none is confirmed."""
    if not judge.straight_line_error(without.task) > 0.0:
        return False
    before, after = (judge.error(o.fitted) for o in (without, with_them))
    return before > MIN_CONFIRMING_ERROR_RATIO * after


def optimum_confirmed(outcome: Outcome) -> bool:
    """Whether a second start of a search reached the same optimum; a fit from a confirmed optimum counts."""
    return sum(start_agrees(outcome, s) for s in outcome.starts) > 1 or not any("apart" in s
                                                                                for s in outcome.starts)


def restart_from_free_runs(best: Outcome, task: Task) -> Outcome:
    """The fit, or a likelier one started from the fit to free runs; the starts say whether both agree.

    best  by innovations
    task  at the values that free runs find
    """
    other = near(task, best)
    if best.converged and not other.converged and other.fit.value < best.fit.value - MIN_OTHER_OPTIMUM_GAIN:
        fit = refit_with_tight_tolerance(other.problem,
                                         until_converged(other.problem, other.fit, MAX_REPEATED_FITS))
        other = replace(other, solution=fit.solution, fit=fit, converged=fit.converged)
    same = np.allclose(other.solution.point.values, best.solution.point.values, rtol=SAME_VALUE_TOLERANCE, atol=0.0)
    first, second = ((best, other) if same or other.fit.value > best.fit.value - MIN_OTHER_OPTIMUM_GAIN
                     else (other, best))
    reached = dict(zip(first.task.free, second.solution.point.values.tolist(), strict=True))
    loss = 0.0 if same else max(float(second.fit.value - first.fit.value), 0.0)
    entry = {"way": "free runs" if second is other else "search", "reached": reached,
             "minus_log_likelihood_above_best": loss,
             "apart": 0.0 if same else log_likelihood_distance(first.problem, first.solution, second.solution)}
    own = {"way": "best" if first is best else "free runs", "minus_log_likelihood_above_best": 0.0, "apart": 0.0,
           "reached": dict(zip(first.task.free, first.solution.point.values.tolist(), strict=True))}
    # For another optimum, or a drive with more free parameters than were searched, the search's starts say nothing.
    keeps_starts = first is best and all(set(s.get("reached", ())) == set(best.task.free) for s in best.starts)
    return replace(first, starts=(*((keeps_starts and best.starts) or (own,)), entry))
