"""Tests whether the logged speed agrees with the logged angle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.finding import Finding
from drivetool.logs import true_runs

SCALE_TOLERANCE = 0.02  # a choice: rounded gear ratios and rated values differ by less, wrong units by far more
MIN_SPEED_CORRELATION = 0.9  # a choice: below it (81 % of the variance) scale and delay have no meaning
MIN_SPEED_DELAY = 0.5  # averaging over a sampling interval alone makes half a sample of delay
MAX_COMPARED_SAMPLES = 100_000  # a choice: more do not change the result and take longer
MAX_SPEED_LAG = 200  # samples, a choice: longer delays come from a wrong clock (clocks/clock_offset.py)
# Log likelihood ratio of one added parameter from which a lag is significant: 5^2 / 2, five standard deviations.
MIN_LAG_LIKELIHOOD_GAIN = 12.5


@dataclass(frozen=True)
class SpeedAgreement:
    """How well the logged speed follows from the differentiated angle in one way.

    correlation  signed; ratio: std of what follows from the angle over std of the logged speed
    lag          delay or filter time constant [samples]; 0 if none
    length       of the averages [samples]; count: number of independent averages
    """

    correlation: float
    ratio: float
    lag: float
    length: int
    count: float

    @property
    def unexplained(self) -> float:
        """Share of the variance that does not follow."""
        return max(1 - self.correlation**2, 1e-12)


def differentiate(angle: np.ndarray, step: float) -> np.ndarray:
    """Speed by central differences, (angle[k+1] - angle[k-1]) / (2 step).

    No delay; the ends, and neighbours of missing values, are NaN. It is the mean speed over two
    steps, so it weakens a frequency f by sinc(2 f step): 1 % at f step = 0.039.
    """
    speed = np.full(len(angle), np.nan)
    speed[1:-1] = (angle[2:] - angle[:-2]) / (2 * step)
    return speed


def compare_speed_and_angle(angle: np.ndarray, speed: np.ndarray, step: float,
                            segments: Iterable[tuple[int, int]], body: str) -> list[Finding]:
    """Findings where the logged speed is not the derivative of the logged angle.

    The angle is differentiated centrally and the speed averaged over the same two steps (Simpson),
    so that sampling alone makes no difference. Both then pass the same moving average, of the
    length at which they agree best: that takes out encoder steps and sensor noise. Tried in turn:
    equal; delayed; behind a first-order low-pass. Noise on either side moves a regression slope by
    the correlation at most, so the scale counts as wrong only if it is off in both directions of
    regression.

    angle, speed  (n,) with NaN where missing; step [s]; segments without a gap; body for messages
    returns       findings speed-angle-mismatch, speed-delay, speed-filtered;
                  none if the motion does not exceed the encoder's quantisation noise
    """
    run = _longest_common_run(np.isfinite(angle) & np.isfinite(speed), segments)
    theta, omega = angle[run], speed[run]
    if len(theta) < 50 or np.ptp(theta) == 0 or np.ptp(omega) == 0:
        return []
    derived = (theta[2:] - theta[:-2]) / (2 * step)
    logged = (omega[:-2] + 4 * omega[1:-1] + omega[2:]) / 6
    found = _best_averaging(derived, logged, _encoder_resolution(theta) / step)
    return _agreement_findings(*found, body, step) if found else []


def _longest_common_run(known: np.ndarray, segments: Iterable[tuple[int, int]]) -> slice:
    """The longest stretch where both are known, within one segment."""
    best = slice(0, 0)
    for first, last in segments:
        for a, b in true_runs(known[first:last]):
            if b - a > best.stop - best.start:
                best = slice(first + int(a), first + int(b))
    return slice(best.start, min(best.stop, best.start + MAX_COMPARED_SAMPLES))


def _encoder_resolution(theta: np.ndarray) -> float:
    """The encoder's step: the smallest change above rounding."""
    change = np.abs(np.diff(theta))
    change = change[change > 1e-9 * np.ptp(theta)]
    return float(change.min()) if len(change) else 0.0


def _best_averaging(derived: np.ndarray, logged: np.ndarray,
                    rate: float) -> tuple[SpeedAgreement, SpeedAgreement, SpeedAgreement] | None:
    """(equal, delayed, filtered) at the averaging length where one of them explains most.

    rate: one encoder step per sample [rad/s]; lengths at which the motion does not exceed the
    encoder's quantisation noise are not considered; None if that leaves none.
    """
    best, length = None, 1
    while length <= len(derived) // 20:
        a, b = _moving_average(derived, length), _moving_average(logged, length)
        # Difference of two roundings, each uniform over one step, across the averaged stretch.
        rounding = rate / np.sqrt(6) / (length + 1)
        if min(np.std(a), np.std(b)) > 0 and np.std(a) > 5 * rounding:
            found = (_agreement(a, b, 0.0, length), _agreement_delayed(a, b, length),
                     _agreement_filtered(a, b, length))
            if best is None or min(f.unexplained for f in found) < min(f.unexplained for f in best):
                best = found
        length *= 2
    return best


def _moving_average(values: np.ndarray, length: int) -> np.ndarray:
    """Moving average, without its ends."""
    total = np.concatenate([[0.0], np.cumsum(values - values.mean())])
    return (total[length:] - total[:-length]) / length


def _agreement(a: np.ndarray, b: np.ndarray, lag: float, length: int) -> SpeedAgreement:
    """Agreement of b with a as they are."""
    std_a, std_b = float(np.std(a)), float(np.std(b))
    if min(std_a, std_b) == 0.0:
        return SpeedAgreement(0.0, 1.0, lag, length, len(a) / length)
    covariance = float(np.mean((a - a.mean()) * (b - b.mean())))
    return SpeedAgreement(covariance / (std_a * std_b), std_a / std_b, lag, length, len(a) / length)


def _agreement_delayed(a: np.ndarray, b: np.ndarray, length: int) -> SpeedAgreement:
    """Agreement of b with a delayed by the best lag (positive: b is late)."""
    reach = min(MAX_SPEED_LAG, len(a) // 4)
    part = b[reach:len(b) - reach] - b[reach:len(b) - reach].mean()
    n = len(part)
    # Normalised within the very samples that are compared, or a slow motion would favour a wrong lag.
    total, square = (np.concatenate([[0.0], np.cumsum(x)]) for x in (a, a * a))
    energy = square[n:] - square[:-n] - (total[n:] - total[:-n])**2 / n
    # At standstill, rounding would look like agreement.
    size = np.sqrt(np.maximum(energy, 1e-6 * energy.max()) * (part @ part))
    if not np.all(size > 0):
        return _agreement(a, b, 0.0, length)
    # From -reach (b early) to reach (b late).
    spectrum = np.fft.rfft(a) * np.fft.rfft(part, len(a)).conj()
    curve = (np.fft.irfft(spectrum, len(a))[:2 * reach + 1] / size)[::-1]
    height = np.abs(curve)
    # A periodic motion agrees again one period later: climb from the nearest of near equals.
    at, beside, peak = nearest_peak(height, height.max() - 0.1 * max(0.0, 1 - height.max()) - 1e-3,
                                    np.abs(np.arange(2 * reach + 1) - reach))
    return SpeedAgreement(float(np.sign(curve[at]) * min(peak, 1.0)), float(np.std(a) / np.std(b)),
                          float(at - reach) + beside, length, len(a) / length)


def nearest_peak(height: np.ndarray, least: float, distance: np.ndarray) -> tuple[int, float, float]:
    """The peak of a correlation (n,) uphill from the place with the least distance (n,) of those above `least`.

    returns  (index; from there to the top of the parabola through it and its neighbours; height of that top)
    """
    high = np.flatnonzero(height > least)
    at, last = int(high[np.argmin(distance[high])]), len(height) - 1
    while 0 < at < last and height[at] < max(height[at - 1], height[at + 1]):
        at += 1 if height[at + 1] > height[at - 1] else -1
    if 0 < at < last:
        left, mid, right = height[at - 1:at + 2]
        curvature = left - 2 * mid + right
        if curvature < 0:
            return at, float(0.5 * (left - right) / curvature), float(mid - 0.125 * (left - right)**2 / curvature)
    return at, 0.0, float(height[at])


def _agreement_filtered(a: np.ndarray, b: np.ndarray, length: int) -> SpeedAgreement:
    """Agreement of b with a behind the best first-order low-pass (bilinear)."""
    def behind(log_tau):
        tau = np.exp(log_tau)
        transient = min(len(a) // 4, int(5 * tau))  # the filter's unknown start
        return scipy.signal.lfilter([1, 1], [1 + 2 * tau, 1 - 2 * tau], a)[transient:], b[transient:], tau

    def unexplained(log_tau):
        x, y, tau = behind(log_tau)
        return _agreement(x, y, tau, length).unexplained

    best = scipy.optimize.minimize_scalar(unexplained, bounds=(np.log(0.1), np.log(len(a) / 20)), method="bounded",
                           options={"xatol": 1e-3})
    x, y, tau = behind(best.x)
    return _agreement(x, y, float(tau), length)


def _agreement_findings(equal: SpeedAgreement, delayed: SpeedAgreement, filtered: SpeedAgreement, body: str,
                        step: float) -> list[Finding]:
    """The findings that follow from the agreement."""
    def gain(other):
        return 0.5 * equal.count * np.log(equal.unexplained / other.unexplained)

    # A filter is reported only if it explains significantly more than a plain delay.
    best = filtered if gain(filtered) > gain(delayed) + MIN_LAG_LIKELIHOOD_GAIN else delayed
    if gain(best) < MIN_LAG_LIKELIHOOD_GAIN or abs(best.lag) < MIN_SPEED_DELAY:
        best = equal
    angle, speed = f"{body}_angle", f"{body}_speed"
    evidence = {"correlation": best.correlation, "scale": best.ratio, "lag": best.lag * step,
                "averaged_over": best.length * step}
    if abs(best.correlation) < MIN_SPEED_CORRELATION:
        return [Finding(
            "warning", "speed-angle-mismatch",
            f"{speed} and the derivative of {angle} do not agree: correlation {best.correlation:.2f}.",
            evidence, "Check that both channels belong to the same shaft, and that the angle does not "
            "wrap around.")]
    findings = []
    if best is filtered:
        corner = 1 / (2 * np.pi * best.lag * step)
        findings.append(Finding(
            "warning", "speed-filtered", f"{speed} is the derivative of {angle} after a low-pass filter of "
            f"about {corner:.3g} Hz ({1000 * best.lag * step:.3g} ms).", {**evidence, "corner": float(corner)},
            f"Use {angle} as the output and leave {speed} out of the channel map."))
    if best is delayed:
        where = "behind" if best.lag > 0 else "ahead of"
        findings.append(Finding(
            "warning", "speed-delay", f"{speed} is {1000 * abs(best.lag) * step:.3g} ms {where} the "
            f"derivative of {angle}.", evidence,
            f"Use {angle} as the output, or correct the clock of one of them."))
    if best.correlation < 0:
        findings.append(Finding(
            "warning", "speed-angle-mismatch",
            f"{speed} and the derivative of {angle} have opposite signs.", evidence,
            "Set `sign: -1` for one of them in the channel map."))
    size, error = abs(best.correlation), 3 * np.sqrt(best.unexplained / best.count)
    least, most = best.ratio * size * (1 - error), best.ratio / size * (1 + error)
    if least > 1 + SCALE_TOLERANCE or most < 1 - SCALE_TOLERANCE:
        findings.append(Finding(
            "warning", "speed-angle-mismatch", f"The derivative of {angle} is {best.ratio:.3g} times {speed}.",
            evidence, "Check units, scales and ratios in the channel map."))
    return findings
