"""Gain, phase and delay margin of the loop at the first motor's speed, by `control`."""

from __future__ import annotations

import warnings

import numpy as np

from drivetool.tune.speed_loop.loop import Settings
from drivetool.tune.speed_loop.sections import MarginsSection
from drivetool.tune.speed_loop.sensitivity import Plant, max_sensitivity, with_fine_peaks


def margins(plant: Plant, settings: Settings) -> MarginsSection:
    """Margins of a stable loop to instability, its dead time exact; infinite without a crossing.

    plant    on its own grid; frequencies around the sensitivity's peaks are added
    returns  Ms and where it is reached; the smallest factor above one on the loop gain, and the smallest by which
             it may fall, infinite if the loop stays stable for any; the smallest phase margin over all crossovers
             and where it occurs; the smallest further dead time that destabilises
    """
    import control

    fine = with_fine_peaks(plant, settings)
    response = control.frd(fine.loop_gain(settings), fine.w, smooth=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of control's own arithmetic where nothing crosses
        gains, phases, _, _, crossovers, _ = control.stability_margins(response, returnall=True, epsw=fine.w[0])
    ms, at = max_sensitivity(plant, settings)
    gains = np.asarray(gains, float)
    above, below = gains[gains > 1.0], gains[(gains > 0.0) & (gains < 1.0)]
    phases, crossovers = np.asarray(phases, float), np.asarray(crossovers, float)
    # From each crossover the phase has to fall by its margin, modulo a turn, to reach -180 degrees.
    delays = np.deg2rad(np.mod(phases, 360.0)) / crossovers
    least = int(np.argmin(np.abs(phases))) if len(phases) else 0
    return MarginsSection(
        ms, at / (2.0 * np.pi), float(above.min(initial=np.inf)), float((1.0 / below).min(initial=np.inf)),
        float(phases[least]) if len(phases) else np.inf,
        float(crossovers[least]) / (2.0 * np.pi) if len(phases) else np.nan, float(delays.min(initial=np.inf)))
