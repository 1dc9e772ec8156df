"""Gain, phase and delay margin of the loop at the first motor's speed, by `control`."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from drivetool.tune.speed_loop.loop import Settings
from drivetool.tune.speed_loop.sensitivity import Plant, max_sensitivity, with_fine_peaks


@dataclass(frozen=True)
class Margins:
    """The margins of a loop to instability; infinite without a crossing.

    max_sensitivity        Ms; sensitivity_frequency [rad/s] where it is reached
    gain_margin            smallest factor above one on the loop gain
    gain_reduction_margin  smallest factor by which the gain may fall; infinite if the loop stays stable for any
    phase_margin           smallest over all crossovers [deg]; crossover [rad/s] where it occurs
    delay_margin           smallest further dead time that destabilises [s]
    """

    max_sensitivity: float
    sensitivity_frequency: float
    gain_margin: float
    gain_reduction_margin: float
    phase_margin: float
    crossover: float
    delay_margin: float


def margins(plant: Plant, settings: Settings) -> Margins:
    """Margins of a stable loop, its dead time exact.

    plant  on its own grid; frequencies around the sensitivity's peaks are added
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
    return Margins(
        ms, at, float(above.min(initial=np.inf)), float((1.0 / below).min(initial=np.inf)),
        float(phases[least]) if len(phases) else np.inf, float(crossovers[least]) if len(phases) else np.nan,
        float(delays.min(initial=np.inf)))
