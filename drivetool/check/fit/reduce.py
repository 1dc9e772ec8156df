"""A model compared with its base: its further parameters, and the model without some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivetool.check.fit.model import MAX_FIT_ITERATIONS, Masks, Model, fit
from drivetool.check.fit.structure import on_task, third_mass_of, without_third_mass
from drivetool.drive import Drive
from drivetool.identify.estimate import Parameter, parameters_of
from drivetool.identify.laws import third_mass_names
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.problem import Solution
from drivetool.quantity import quantity_of, with_parts

SIZE_SIGNIFICANCE = 2.5  # standard deviations of one amplitude from zero: 1.2 % by chance (normal distribution)


def added_parameters(model: Model, base: Model) -> tuple[Parameter, ...]:
    """The parameters that a cause adds to the base, with intervals where there are any."""
    normal = filtered_normal_equations(model.problem, model.point, model.noise)
    lines, _, _ = parameters_of(model.problem, Solution(model.point, normal, 0, True), model.task.drive,
                                model.fitted.drive)
    return tuple(p for p in lines if p.name in model.task.free and p.name not in base.task.free)


def refit_without(model: Model, names: Sequence[str], first: Drive, masks: Masks,
                 max_iterations: int = MAX_FIT_ITERATIONS) -> Model:
    """The model without these parameters, fitted again.

    first  the drive that the search started with
    """
    task = model.fitted
    if third_mass_names(first, third_mass_of(task.drive))[0] in names:
        task = without_third_mass(task, first)
    orders = {with_parts(n, quantity="order") for n in names if quantity_of(n) == "bandwidth"}  # without its lag
    values = {n: v for n, v in task.drive.values.items() if n not in {*names, *orders}}
    for n in [n for n in names if quantity_of(n) == "stribeck"]:  # Coulomb friction becomes the sum
        dry = with_parts(n, quantity="coulomb")
        values |= {dry: values[dry] + task.drive.value(n)} if dry in values else {}
    drive = replace(task.drive, values=values)
    less = replace(task, drive=drive).with_free({*task.free} - {*names})
    return fit(on_task(model, less), masks, max_iterations=max_iterations)
