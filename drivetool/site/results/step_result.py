"""The content of a step's file for the summary: a row per parameter, the figures of its fit, its findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivetool.files.yaml import from_yaml

DERIVED_STATUS = "derived"  # status of a figure that follows from the parameters, and the beginning of its name
UNIDENTIFIED_STATUS = "not-identifiable"  # of a parameter, and here of a figure whose reason names such a one
# Of several checks in a validation the worst is taken; for these figures that is the largest.
LARGEST_IS_WORST = ("rmse", "nrmse", "rmse_percent", "max_correlation", "lags_outside_percent")


@dataclass(frozen=True)
class StepResult:
    """The content of a file for the summary and the bars.

    parameters  (name, value, unit, std, lower and upper end of the 95 % interval, status), as in the file
    fit         figures of the fit by name; of a validation the worst of its checks
    verdict     of diagnose; of validate passed or missed
    passed      whether every bar of the command was met
    findings    (severity, code, sentence)
    """

    parameters: tuple[tuple[Any, ...], ...] = ()
    fit: Mapping[str, float] | None = None
    verdict: str | None = None
    passed: bool = True
    findings: tuple[tuple[str, str, str], ...] = ()

    @property
    def unidentified(self) -> set[str]:
        """Names of what no recording identifies."""
        return {row[0] for row in self.parameters if row[-1] == UNIDENTIFIED_STATUS}


def step_result_of(text: str) -> StepResult:
    """The content of a result file.

    text     of a parameter, validation or comparison file
    returns  Told
    """
    content = from_yaml(text, "the file")
    verdict = (content.get("diagnosis") or {}).get("verdict")
    if "passed" in content:
        verdict = "passed" if content["passed"] else "missed"
    parameters = [_parameter_row(name, entry, entry.get("status"))
                  for name, entry in (content.get("parameters") or {}).items()]
    unidentified = StepResult(tuple(parameters)).unidentified
    parameters += [_parameter_row(f"{DERIVED_STATUS}.{name}", entry, DERIVED_STATUS if unidentified.isdisjoint(
        entry.get("reason", "").replace(",", "").split()) else UNIDENTIFIED_STATUS)
                   for name, entry in (content.get(DERIVED_STATUS) or {}).items()]
    return StepResult(tuple(parameters), _fit_figures(content), verdict, bool(content.get("passed", True)),
                tuple((f["severity"], f["code"], f["text"]) for f in content.get("findings") or ()))


def _parameter_row(name: str, entry: Mapping[str, Any], status: str | None) -> tuple[Any, ...]:
    low, high = entry.get("ci95") or (None, None)
    return name, entry.get("value"), entry.get("unit"), entry.get("std"), low, high, status


def _fit_figures(content: Mapping[str, Any]) -> dict[str, float]:
    """Numbers only: a missing figure is omitted."""
    fit: dict[str, float] = {}
    for each in content.get("checks") or [content.get("fit") or {}]:
        for name, value in each.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            worst = max if name in LARGEST_IS_WORST else min
            fit[name] = worst(fit.get(name, value), value)
    return fit
