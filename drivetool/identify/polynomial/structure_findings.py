"""Findings that question a polynomial model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.channels import feedback_of
from drivetool.identify.frequency import MIN_COHERENCE, Welch, welch_response
from drivetool.identify.polynomial.data import PolynomialData
from drivetool.identify.polynomial.pem_figures import ModelFigures

# Of half overlap in the longest stretch, a choice: fewer bias the coherence upwards, more resolve less slow motion.
COHERENCE_FRAMES = 16


def model_findings(figures: ModelFigures, data: PolynomialData, why: str,
                   explained: float | None) -> tuple[Finding, ...]:
    """In the order of their weight; why: the reason for no conversion, or empty; explained: simulated fit [%]."""
    return (*_incoherence_findings(data, explained), *_unstable_findings(figures), *_noise_findings(figures, data),
            *_order_findings(figures),
            *_no_conversion_findings(why))


def bodies_advice(drive: Drive, kind: str, order: int, table: Sequence[Mapping]) -> list[Finding]:
    """The number of bodies by the held-out score; nothing where the order was given.

    table  order and held-out simulation fit [%] of each order tried, 2 n - 1 for n bodies
    """
    if not table:
        return []
    fits = {(row["order"] + 1) // 2: row["held_out_simulation_fit_percent"] for row in table}
    scores = ", ".join(f"{n}: {'unstable' if v is None else f'{v:.1f} %'}" for n, v in fits.items())
    needed, have = (order + 1) // 2, len(drive.bodies)
    text = (f"{needed} bod{'y suffices' if needed == 1 else 'ies suffice'}: fitted on the first part of the "
            f"records, {kind} models simulate the remaining part with a fit, by number of "
            f"bodies, of {scores}.")
    evidence = {f"held_out_fit_percent_{n}": v for n, v in fits.items() if v is not None} | {
        "bodies": needed, "bodies_of_the_drive": have}
    if needed == have:
        return [Finding("note", "model-order", text, evidence)]
    more = "more" if needed > have else "fewer"
    return [Finding("warning", "model-order", f"{text} The drive has {have}.", evidence,
                    f"Use a drive with {more} bodies (--drive), or give --order {2 * have - 1} to keep this one.")]


def _incoherence_findings(data: PolynomialData, explained: float | None) -> list[Finding]:
    """The output is not coherent with the torque: a model of it models noise.

    The frames do not resolve slow motion; a model that simulates it well does.
    """
    tables = [np.column_stack([s.u, s.y]) for s in data.stretches]
    size = 2 * max(map(len, tables)) // (COHERENCE_FRAMES + 1)
    if size < 16 or (explained is not None and explained > 100.0 * (1.0 - np.sqrt(1.0 - MIN_COHERENCE))):
        return []
    try:
        coherence = welch_response([x for x in tables if len(x) >= size], data.step, Welch(size)).coherence
    except NotEnoughData:
        return []
    if not len(coherence) or np.nanmax(coherence) >= MIN_COHERENCE:
        return []
    return [Finding(
        "failure", "low-coherence",
        f"The coherence of torque and {data.role.replace('_', ' ')} is below {MIN_COHERENCE} at "
        "every frequency: the model describes only noise.", {"largest_coherence": float(np.nanmax(coherence))},
        "Check the channels and their clocks, excite more, or record longer.")]


def _unstable_findings(f: ModelFigures) -> list[Finding]:
    if not f.unstable:
        return []
    return [Finding(
        "failure", "unstable-estimate", f"The {f.fit.structure.kind} model of order {f.fit.structure.order} "
        f"is unstable (poles at {f.unstable} rad/s): it is not simulated.", {"order": f.fit.structure.order},
        f"Use another structure (for example {'bj' if f.fit.structure.kind == 'oe' else 'oe'}), another order, or "
        "a record with more excitation.")]


def _noise_findings(f: ModelFigures, data: PolynomialData) -> list[Finding]:
    """Errors that are not white: harmless for output error in open loop, not otherwise."""
    kind, fit = f.fit.structure.kind, f.fit
    if fit.white:
        return []
    loop = feedback_of([np.column_stack([s.u, s.y]) for s in data.stretches])
    evidence = {"errors_white_p": fit.whiteness_p, "share_of_torque_from_sensor": loop.share}
    if loop.significant:
        return [Finding(
            "warning", "residual-correlated", "The torque is in feedback: the sensor explains "
            f"{100 * loop.share:.2g} % of its innovations. The residual of the {kind} model is correlated; in "
            "closed loop a direct fit is unbiased only with the right noise model.", evidence,
            "Compare with --structure bj of a higher --noise-order, or innovations; "
            "or log the reference and use spectra.")]
    if kind in ("arx", "armax"):
        return [Finding(
            "warning", "residual-correlated", f"The errors of the {kind} model are not white, so that its poles "
            "are biased towards the noise, even in open loop.", evidence, "Use --structure oe, bj or innovations.")]
    return [Finding(
        "note", "residual-correlated", f"The residual of the {kind} model is correlated; the intervals account "
        "for it by an autoregressive model.", evidence,
        "The cause is a nonlinearity or a disturbance: inspect spectra." + ("" if kind == "innovations" else
        " Torque noise that excites the resonance needs --structure innovations."))]



def _order_findings(f: ModelFigures) -> list[Finding]:
    """A pole on a zero: the order is higher than the data support."""
    pairs = 0
    for p in f.poles:
        for z in f.zeros:
            distance = p.s - z.s
            gradient = p.gradient - z.gradient
            std = np.hypot(f.std(gradient.real) or 0.0, f.std(gradient.imag) or 0.0)
            near = abs(distance) < 0.3 * abs(p.s) and abs(p.s) * f.step < 2.5
            pairs += bool(near and p.s.imag >= 0.0 and abs(distance) < 2.0 * std)
    if not pairs:
        return []
    return [Finding(
        "warning", "model-order", f"{pairs} pole{'s lie' if pairs > 1 else ' lies'} on a zero within the "
        f"uncertainty: these records do not identify a model of order {f.fit.structure.order}.", {"pairs": pairs},
        "Lower --order, or leave it out to choose by held-out score.")]


def _no_conversion_findings(why: str) -> list[Finding]:
    return [Finding("note", "no-conversion", f"The model is not converted to inertias and stiffnesses: {why}.", {},
                    "Choose --order 2 n - 1 for n bodies, or another --drive.")] if why else []
