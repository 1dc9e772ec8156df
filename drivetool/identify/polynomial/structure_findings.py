"""What stands against believing a polynomial model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import Finding, NotEnoughData
from drivetool.identify.channels import feedback_of
from drivetool.identify.frequency import POOR, Welch, welch_response
from drivetool.identify.polynomial.data import Data
from drivetool.identify.polynomial.pem_figures import Figures

FRAMES = 16  # of half overlap, into which the longest stretch is cut to see whether there is any coherence


def findings_of(figures: Figures, data: Data, why: str, explained: float | None) -> tuple[Finding, ...]:
    """In the order of their weight; why: the reason for no conversion, or empty; explained: simulated fit [%]."""
    return (*_incoherent(data, explained), *_unstable(figures), *_noise(figures, data), *_order(figures),
            *_conversion(why))


def bodies_advice(drive: Drive, kind: str, order: int, table: Sequence[Mapping]) -> list[Finding]:
    """How many bodies the held-out score asks for; nothing where the order was given.

    table  order and held-out simulation fit [%] of each order tried, 2 n - 1 for n bodies
    """
    if not table:
        return []
    fits = {(row["order"] + 1) // 2: row["held_out_simulation_fit_percent"] for row in table}
    told = ", ".join(f"{n}: {'unstable' if v is None else f'{v:.1f} %'}" for n, v in fits.items())
    needed, have = (order + 1) // 2, len(drive.bodies)
    text = (f"{needed} bod{'y suffices' if needed == 1 else 'ies suffice'}: fitted on the first part of the "
        "records, "
            f"{kind} models of that many bodies simulate the rest with {told}.")
    evidence = {f"held_out_fit_percent_{n}": v for n, v in fits.items() if v is not None} | {
        "bodies": needed, "bodies_of_the_drive": have}
    if needed == have:
        return [Finding("note", "number-of-bodies", text, evidence)]
    more = "more" if needed > have else "fewer"
    return [Finding("warning", "number-of-bodies", f"{text} The drive has {have}.", evidence,
                    f"Use a drive with {more} bodies (--drive), or give --order {2 * have - 1} to keep this one.")]


def _incoherent(data: Data, explained: float | None) -> list[Finding]:
    """Nothing in the output follows the torque: a model of it models noise.

    The frames do not see slow motion, which a model that simulates it has seen.
    """
    tables = [np.column_stack([s.u, s.y]) for s in data.stretches]
    size = 2 * max(map(len, tables)) // (FRAMES + 1)
    if size < 16 or (explained is not None and explained > 100.0 * (1.0 - np.sqrt(1.0 - POOR))):
        return []
    try:
        coherence = welch_response([x for x in tables if len(x) >= size], data.step, Welch(size)).coherence
    except NotEnoughData:
        return []
    if not len(coherence) or np.nanmax(coherence) >= POOR:
        return []
    return [Finding(
        "failure", "incoherent", f"The coherence of torque and {data.role.replace('_', ' ')} is below {POOR} at "
        "every frequency: the model is one of noise.", {"largest_coherence": float(np.nanmax(coherence))},
        "Check the channels and their clocks, excite more, or record longer.")]


def _unstable(f: Figures) -> list[Finding]:
    if not f.unstable:
        return []
    return [Finding(
        "failure", "unstable-estimate", f"The {f.fit.structure.kind} model of order {f.fit.structure.order} "
            "grows by "
        f"itself (poles at {f.unstable} rad/s): it is not simulated.", {"order": f.fit.structure.order},
        f"Use another structure ({'bj' if f.fit.structure.kind == 'oe' else 'oe'}, say), another order, or a "
        "livelier record.")]


def _noise(f: Figures, data: Data) -> list[Finding]:
    """Errors that are not white: harmless for output error in open loop, not otherwise."""
    kind, fit = f.fit.structure.kind, f.fit
    if fit.white:
        return []
    loop = feedback_of([np.column_stack([s.u, s.y]) for s in data.stretches])
    evidence = {"errors_white_p": fit.whiteness_p, "share_of_torque_from_sensor": loop.share}
    if loop.there:
        return [Finding(
            "warning", "noise-model-matters", f"The torque answers the sensor ({100 * loop.share:.2g} % of what "
                "its past "
            f"does not foretell), and the errors of the {kind} model are not white: in closed loop a direct fit is "
            "unbiased only with the right noise model.", evidence,
            "Compare with --structure bj of a higher --noise-order, or innovations; "
            "or log the reference and use spectra.")]
    if kind in ("arx", "armax"):
        return [Finding(
            "warning", "noise-model-wrong", f"The errors of the {kind} model are not white, so that its poles "
                "are biased "
            "towards the noise, even in open loop.", evidence, "Use --structure oe, bj or innovations.")]
    return [Finding(
        "note", "errors-not-white", f"The errors of the {kind} model are not white; their colour is in the "
            "intervals, "
        "as far as an autoregression follows it.", evidence,
        "A nonlinearity or a disturbance is left over: compare spectra." + ("" if kind == "innovations" else
        " Torque noise that excites the resonance needs --structure innovations."))]



def _order(f: Figures) -> list[Finding]:
    """A pole on a zero says that the order is higher than the data ask for."""
    pairs = 0
    for p in f.poles:
        for z in f.zeros:
            apart = p.s - z.s
            gradient = p.gradient - z.gradient
            spread = np.hypot(f.std(gradient.real) or 0.0, f.std(gradient.imag) or 0.0)
            near = abs(apart) < 0.3 * abs(p.s) and abs(p.s) * f.step < 2.5
            pairs += bool(near and p.s.imag >= 0.0 and abs(apart) < 2.0 * spread)
    if not pairs:
        return []
    return [Finding(
        "warning", "order-too-high", f"{pairs} pole{'s lie' if pairs > 1 else ' lies'} on a zero within the "
            "uncertainty: a "
        f"model of order {f.fit.structure.order} is larger than these records can tell.", {"pairs": pairs},
        "Lower --order, or leave it out to choose by held-out score.")]


def _conversion(why: str) -> list[Finding]:
    return [Finding("note", "no-conversion", f"No inertias and stiffnesses follow: {why}.", {},
                    "Choose --order 2 n - 1 for n bodies, or another --drive.")] if why else []
