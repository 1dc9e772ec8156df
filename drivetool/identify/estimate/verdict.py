"""The one stage that every estimate passes: what its checks say is applied here, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import reduce

from drivetool.finding import Finding
from drivetool.identify.estimate.estimate import Covariance, Estimate, Parameter, PlotData
from drivetool.identify.estimate.lines import with_intervals_only
from drivetool.identify.estimate.sections import Status


@dataclass(frozen=True)
class Verdict:
    """What one check says of an estimate.

    findings    of the check; replaces: codes of the findings before it in whose place they stand
    lines       parameters that it states otherwise: without an interval, or with another one
    covariance  of all parameters that have an interval; None: as it is
    ratios      further figures, such as a sum that is identified where its parts are not
    exhibits    further pictures
    """

    findings: Sequence[Finding] = ()
    lines: Sequence[Parameter] = ()
    _: KW_ONLY
    covariance: Covariance | None = None
    ratios: Sequence[Parameter] = ()
    exhibits: Sequence[PlotData] = ()
    replaces: Sequence[str] = ()


NOT_CONVERGED_TEXT = "the fit did not converge"  # why nothing has an interval

Check = Callable[[Estimate], Verdict]


def judged(estimate: Estimate, checks: Iterable[Check]) -> Estimate:
    """The estimate after its checks, in their order: each sees what those before it left."""
    return reduce(_with_verdict, checks, estimate)


def _with_verdict(estimate: Estimate, check: Check) -> Estimate:
    """The estimate with what a check says: a parameter without an interval has no covariance, either.

    Where the check states a parameter otherwise, its finding replaces that of the fit on its identifiability.
    """
    verdict = check(estimate)
    stated = {p.name: p for p in verdict.lines}
    lines = tuple(stated.get(p.name, p) for p in estimate.parameters)
    others = (f for f in estimate.findings if f.code not in verdict.replaces
              and not (f.code == "not-identifiable" and f.parameter in stated))
    return replace(
        estimate, parameters=lines,
        covariance=with_intervals_only(verdict.covariance or estimate.covariance, lines),
        findings=(*others, *verdict.findings), ratios=(*estimate.ratios, *verdict.ratios),
        exhibits=(*estimate.exhibits, *verdict.exhibits))


def masked(estimate: Estimate, reason: str, status: Status | None = "not-identifiable",
           names: Collection[str] | None = None) -> tuple[Parameter, ...]:
    """The fitted parameters of an estimate, each without its interval for one reason.

    status  of these lines; None: as it is
    names   of which parameters; those among them that were not identifiable before keep their reason; None: of all
    """
    fitted = ("fitted", "at-bound")
    return tuple(p.without_interval(reason, status) if p.status in fitted else p for p in estimate.parameters
                 if (p.status in fitted if names is None else p.name in names))
