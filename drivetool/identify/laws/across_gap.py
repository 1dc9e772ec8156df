"""What differs where a gap is crossed: contacts make the likelihood rough, and free runs chaotic in a second.

A filter that is straight about its state is wrong while it may be on either side of a contact. So its likelihood
finds laws that are none, and may come to rest far away. Free runs that are short enough for few contacts see both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.identify.laws.fit_with_laws import near
from drivetool.identify.laws.judge import Judge
from drivetool.identify.noise import settle, until_settled
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts import agrees, apart

# Over the error of free runs with laws, from which that without them confirms the laws. What is no law changes it
# by less than a tenth, also in wrong optima; a cogging torque of 5 % changed it by a factor of fifteen.
CONFIRMED = 1.2
MORE = 4  # fits in a row, until one settles
LIKELIER = 1.0  # log likelihood: less is no other optimum
SAME = 1e-6  # relative, of all values: without noise any two points lie far apart in log likelihood


def confirmed(judge: Judge, without: Outcome, with_them: Outcome) -> bool:
    """Whether free runs are the better for the laws; of a record that shows no motion none is confirmed."""
    if not judge.straight(without.task) > 0.0:
        return False
    before, after = (judge.error(o.task.at_point(o.solution.point)) for o in (without, with_them))
    return before > CONFIRMED * after


def was_confirmed(outcome: Outcome) -> bool:
    """Whether a second start of a search came to the same place; a fit from a place that was confirmed counts."""
    return sum(agrees(outcome, s) for s in outcome.starts) > 1 or not any("apart" in s for s in outcome.starts)


def from_free_runs(best: Outcome, task: Task) -> Outcome:
    """The fit, or a likelier one from where free runs are fitted best; their starts tell whether both agree.

    best  by innovations
    task  at the values that free runs find
    """
    other = near(task, best)
    if best.converged and not other.converged and other.fit.value < best.fit.value - LIKELIER:
        fit = settle(other.problem, until_settled(other.problem, other.fit, MORE))
        other = replace(other, solution=fit.solution, fit=fit, converged=fit.converged)
    same = np.allclose(other.solution.point.values, best.solution.point.values, rtol=SAME, atol=0.0)
    first, second = (best, other) if same or other.fit.value > best.fit.value - LIKELIER else (other, best)
    reached = dict(zip(first.task.free, second.solution.point.values.tolist(), strict=True))
    behind = 0.0 if same else max(float(second.fit.value - first.fit.value), 0.0)
    entry = {"way": "free runs" if second is other else "search", "reached": reached,
             "minus_log_likelihood_above_best": behind,
             "apart": 0.0 if same else apart(first.problem, first.solution, second.solution)}
    own = {"way": "best" if first is best else "free runs", "minus_log_likelihood_above_best": 0.0, "apart": 0.0,
           "reached": dict(zip(first.task.free, first.solution.point.values.tolist(), strict=True))}
    # Of another optimum, or of a drive with more free than was searched, the starts of the search say nothing.
    alike = first is best and all(set(s.get("reached", ())) == set(best.task.free) for s in best.starts)
    return replace(first, starts=(*((alike and best.starts) or (own,)), entry))
