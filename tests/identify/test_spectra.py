"""Frequency responses against SciPy, closed forms and counted noise."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import signal

from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.identify.channels.feedback import feedback_of
from drivetool.identify.frequency.estimator import SpectraOptions, spectra
from drivetool.identify.frequency.frf import Welch, welch_response
from drivetool.identify.frequency.periodic import distortions, lines_of, period_of, periodic_response
from tests.recover import experiment

STEP = 1e-3
# A resonance at 0.1 of the sampling rate over an anti-resonance, stable.
B, A = np.array([0.0, 0.3, -0.45, 0.28]), np.poly([0.97, 0.9 * np.exp(0.6j), 0.9 * np.exp(-0.6j)]).real


def true_response(frequency, step=STEP):
    return signal.freqz(B, A, 2 * np.pi * np.asarray(frequency) * step)[1]


def noise_record(n, seed, noise=0.0):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    return np.column_stack([u, signal.lfilter(B, A, u) + noise * rng.standard_normal(n)])


def multisine(size, lines, seed):
    """One period with unit amplitudes on the given lines."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    t = np.arange(size)[:, None] * np.asarray(lines) / size
    return np.cos(2 * np.pi * t + phase).sum(axis=1)


# Welch


@pytest.mark.parametrize(("window", "overlap"), [("hann", 0.5), ("hamming", 0.7), ("boxcar", 0.0)])
def test_h1_and_coherence_are_scipys(window, overlap):
    x, n = noise_record(20_000, 1, 0.3), 500
    welch = Welch(n, overlap, window)
    r = welch_response([x], STEP, welch)
    more = {"fs": 1 / STEP, "window": window, "nperseg": n, "noverlap": n - welch.shift}
    f, puy = signal.csd(x[:, 0], x[:, 1], detrend="linear", **more)
    _, puu = signal.csd(x[:, 0], x[:, 0], detrend="linear", **more)
    _, coherence = signal.coherence(x[:, 0], x[:, 1], detrend="linear", **more)
    at = np.searchsorted(f, r.frequency)
    np.testing.assert_allclose(f[at], r.frequency)
    np.testing.assert_allclose(r.g, (puy / puu)[at], rtol=1e-12)
    np.testing.assert_allclose(r.coherence, coherence[at], rtol=1e-10)
    assert len(r.frequency) >= 248


def test_estimators_under_noise_of_known_size():
    """|H1| falls by S/(S + N) with noise at the input, |H2| rises with noise at the output."""
    rng, n = np.random.default_rng(2), 400_000
    u = rng.standard_normal(n)
    y = 2.0 * u
    noisy = np.column_stack([u + 0.5 * rng.standard_normal(n), y + 1.0 * rng.standard_normal(n)])
    found = {k: np.abs(welch_response([noisy], STEP, Welch(256), k).g).mean() for k in ("h1", "h2", "h3", "hv")}
    h1, h2 = 2.0 / 1.25, 2.0 * 1.25
    for name, expected in (("h1", h1), ("h2", h2), ("h3", 0.5 * (h1 + h2)), ("hv", np.sqrt(h1 * h2))):
        assert found[name] == pytest.approx(expected, rel=5e-3)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.floats(0.01, 2.0), st.floats(0.01, 2.0), st.integers(0, 1000))
def test_laws_of_the_estimators(a, b, seed):
    """|H1| <= Hv <= |H3| <= |H2|, one phase, scaling with the channels."""
    x = noise_record(3000, seed, b) + a * np.random.default_rng(seed + 1).standard_normal((3000, 1)) * [1, 0]
    r = {k: welch_response([x], STEP, Welch(200), k) for k in ("h1", "h2", "h3", "hv")}
    sizes = [np.abs(r[k].g) for k in ("h1", "hv", "h3", "h2")]
    for small, large in pairwise(sizes):
        assert np.all(small <= large * (1 + 1e-9))
    np.testing.assert_allclose(np.angle(r["h1"].g / r["h2"].g), 0.0, atol=1e-9)
    np.testing.assert_allclose(welch_response([x * [2.0, 6.0]], STEP, Welch(200)).g, 3.0 * r["h1"].g, rtol=1e-9)


def test_stated_variance_is_that_of_many_records():
    found = [welch_response([noise_record(6000, 10 + k, 1.0)], STEP, Welch(300)) for k in range(150)]
    at = slice(10, 140)
    g = np.array([r.g[at] for r in found])
    stated = np.mean([r.noise[at] for r in found], axis=0)
    seen = np.mean(np.abs(g - g.mean(axis=0)) ** 2, axis=0)
    assert np.median(seen / stated) == pytest.approx(1.0, abs=0.12)


def test_in_closed_loop_the_indirect_estimate_is_right_and_h1_is_not():
    rng, n = np.random.default_rng(3), 200_000
    r, e = rng.standard_normal(n), signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal(n))
    # y = g q^-1 u + e, u = r - k y: closed-loop transfer functions, no simulation needed.
    gain, k = 0.8, 0.6
    y = signal.lfilter([0.0, gain], [1.0, gain * k], r) + signal.lfilter([1.0], [1.0, gain * k], e)
    x = np.column_stack([r - k * y, y, r])
    found = {m: welch_response([x], STEP, Welch(256), m) for m in ("indirect", "h1")}
    expected = gain * np.exp(-2j * np.pi * found["h1"].frequency * STEP)
    off = {m: np.abs(r.g - expected) / np.sqrt(r.noise) for m, r in found.items()}
    # |error|^2 over its mean is exponential: 2 % lie above 2 std, if the stated variance is right.
    assert np.mean(off["indirect"] > 2.0) < 0.06 and off["indirect"].max() < 4.0
    assert np.median(off["h1"][:20]) > 10.0
    assert feedback_of([x[:, :2]]).significant
    assert not feedback_of([noise_record(20_000, 5, 0.5)]).significant


# periods


def test_a_periodic_response_is_exact_at_the_excited_lines_and_nowhere_else():
    lines = np.array([3, 7, 8, 15, 40, 90])
    u = np.tile(multisine(500, lines, 1), 40)
    x = np.column_stack([u, signal.lfilter(B, A, u)])
    r = periodic_response([lines_of(x, STEP, 500, 20)])
    np.testing.assert_allclose(r.frequency, lines / (500 * STEP))
    np.testing.assert_allclose(r.g, true_response(r.frequency), rtol=1e-6)
    s = spectra([experiment(x[:, 0], x[:, 1])], SpectraOptions(skip=20))
    np.testing.assert_allclose(s.mean.frequency, r.frequency)
    assert "excitation-gaps" in [f.code for f in s.findings]


def test_noise_variance_over_periods_is_that_of_many_runs():
    lines = np.arange(5, 100)
    u = np.tile(multisine(400, lines, 2), 8)
    clean, found = signal.lfilter(B, A, u), []
    for k in range(150):
        rng = np.random.default_rng(100 + k)
        # The same noise at input and output, as feedback makes it, must not count twice.
        both = rng.standard_normal(len(u))
        x = np.column_stack([u + 0.3 * both, clean + 0.5 * both + 0.5 * rng.standard_normal(len(u))])
        found.append(periodic_response([lines_of(x, STEP, 400, 2)]))
    g = np.array([r.g for r in found])
    stated = np.mean([r.noise for r in found], axis=0)
    assert np.median(np.mean(np.abs(g - g.mean(axis=0)) ** 2, axis=0) / stated) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("periods", [3, 6, 12])
def test_a_drift_leaves_the_lines_alone_and_costs_no_period(periods):
    """The transient of a slow pole, of five periods, as large as the response itself."""
    size, lines = 400, np.array([2, 5, 20, 60])
    u = np.tile(multisine(size, lines, 3), periods)
    slow = 3.0 * np.exp(-np.arange(len(u)) / (5.0 * size))
    # What repeats begins steady: the filter has run for long.
    y = signal.lfilter(B, A, np.tile(u, 20))[-len(u):]
    found = lines_of(np.column_stack([u, y + slow]), STEP, size, 0)
    assert len(found.u) == periods
    r = periodic_response([found])
    np.testing.assert_allclose(r.g, true_response(r.frequency), rtol=1e-3,
                               atol=1e-3 * np.abs(true_response(r.frequency)).max())
    assert np.all(r.noise < 1e-4 * np.abs(r.g) ** 2)


@pytest.mark.parametrize(("even", "odd"), [(0.02, 0.0), (0.0, 0.01), (0.02, 0.01), (0.0, 0.0)])
def test_even_and_odd_distortion_are_separated(even, odd):
    lines = np.array([k for k in range(1, 120, 2) if k % 8 != 5])  # odd lines, every fourth left out
    period = multisine(1000, lines, 3) / 5.0
    u = np.tile(period, 6)
    y = u + even * u**2 + odd * u**3
    x = np.column_stack([u, y + 1e-4 * np.random.default_rng(1).standard_normal(len(u))])
    run = lines_of(x, STEP, 1000, 1)
    found = {d.kind: d for d in distortions([run])}
    assert [found[kind].below_signal_db is not None for kind in ("even", "odd")] == [even > 0.0, odd > 0.0]
    for kind, parity, size in (("even", 0, even), ("odd", 1, odd)):
        if size:
            spectrum = np.abs(np.fft.rfft(even * period**2 + odd * period**3)) / 1000
            empty = [k for k in range(lines[0] + 1, lines[-1]) if k not in lines and k % 2 == parity]
            level = np.sqrt(np.mean(spectrum[empty] ** 2))
            assert found[kind].level == pytest.approx(level, rel=0.05)


def test_runs_with_other_phases_show_the_distortion_in_the_total_variance():
    lines = np.arange(1, 100)
    runs = []
    for k in range(8):
        u = np.tile(multisine(500, lines, 20 + k) / 7.0, 5)
        y = u + 0.05 * u**3 + 1e-3 * np.random.default_rng(k).standard_normal(len(u))
        runs.append(lines_of(np.column_stack([u, y]), STEP, 500, 1))
    r = periodic_response(runs)
    assert np.median(r.total / r.noise) > 20.0
    # The best linear approximation of u + a u^3 under a Gaussian u is 1 + 3 a var(u).
    u = np.concatenate([run.u.mean(axis=0) for run in runs])
    variance = 2.0 * np.sum(np.abs(u) ** 2) / len(runs)
    assert np.abs(r.g.mean() - (1.0 + 0.15 * variance)) < 0.02
    assert np.all(np.isnan(periodic_response(runs[:1]).total))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(20, 400), st.integers(2, 9), st.integers(0, 99), st.floats(0.0, 0.1))
def test_the_period_is_found(size, count, seed, noise):
    u = np.random.default_rng(seed).standard_normal(size)
    x = np.tile(u, count) + noise * np.random.default_rng(seed + 1).standard_normal(size * count)
    assert period_of(x) == size
    assert period_of(np.random.default_rng(seed).standard_normal(size * count)) is None


# findings on a response


def severity_by_code(*pairs, **options):
    """Code -> severity of the findings on (torque, output) of each run."""
    found = spectra([experiment(u, y) for u, y in pairs], SpectraOptions(**options)).findings
    return {f.code: f.severity for f in found}


ODD_LINES = np.array([k for k in range(1, 120, 2) if k % 8 != 5])  # odd lines, every fourth left out


@pytest.mark.parametrize(("even", "odd"), [(0.05, 0.0), (0.0, 0.05), (5e-4, 5e-4), (0.0, 0.0)])
def test_loud_distortion_is_a_warning_and_weak_distortion_a_note(even, odd):
    u = np.tile(multisine(1000, ODD_LINES, 3) / 5.0, 6)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(len(u))
    findings = spectra([experiment(u, u + even * u**2 + odd * u**3 + noise)], SpectraOptions()).findings
    found = {kind: f.severity for f in findings for kind in ("even", "odd")
             if f.code == "nonlinear-distortion" and f"{kind} nonlinear" in f.text}
    severity = {0.05: "warning", 5e-4: "note", 0.0: None}
    assert (found.get("even"), found.get("odd")) == (severity[even], severity[odd])
    assert "distortion-not-separable" not in {f.code for f in findings}


def test_a_full_multisine_hides_its_distortion():
    u = np.tile(multisine(500, np.arange(1, 100), 1), 6)
    assert severity_by_code((u, u))["distortion-not-separable"] == "note"


@pytest.mark.parametrize("cube", [0.0, 0.05])
def test_distortion_shows_in_the_variance_over_runs(cube):
    runs = []
    for k in range(6):
        u = np.tile(multisine(500, np.arange(1, 100), 20 + k) / 7.0, 5)
        runs.append((u, u + cube * u**3 + 1e-3 * np.random.default_rng(k).standard_normal(len(u))))
    assert ("scatter-beyond-noise" in severity_by_code(*runs)) == (cube > 0.0)


@pytest.mark.parametrize(("noise", "low"), [(0.01, False), (1.0, True)])
def test_lines_of_low_coherence_are_counted(noise, low):
    """A first-order lag leaves its upper frequencies to the noise."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(20_000)
    y = signal.lfilter([0.1], [1.0, -0.9], u) + noise * 0.1 * rng.standard_normal(len(u))
    assert severity_by_code((u, y)).get("low-coherence") == ("warning" if low else None)


# refusals


def noisy_run(n=4000, seed=1, noise=0.1):
    x = noise_record(n, seed, noise)
    return experiment(x[:, 0], x[:, 1])


def test_several_runs_give_average_and_scatter():
    s = spectra([noisy_run(seed=k, noise=0.5) for k in range(6)], SpectraOptions(length=0.4))
    assert len(s.runs) == 6 and s.spread.shape == s.mean.g.shape
    one = np.sqrt(np.mean([r.noise for _, r in s.runs], axis=0))
    assert np.median(s.spread / one) == pytest.approx(1.0, abs=0.2)
    off = np.abs(s.mean.g - true_response(s.mean.frequency)) ** 2 / s.mean.noise
    assert np.mean(off) == pytest.approx(1.0, abs=0.3)


def test_incoherent_channels_are_a_failure():
    rng = np.random.default_rng(1)
    s = spectra([experiment(rng.standard_normal(20_000), rng.standard_normal(20_000))], SpectraOptions())
    assert [f.code for f in s.findings if f.severity == "failure"] == ["low-coherence"]


@pytest.mark.parametrize(("options", "error", "words"), [
    (SpectraOptions(length=3.9), NotEnoughData, "frames"),
    (SpectraOptions(length=9.0), NotEnoughData, "frames"),
    (SpectraOptions(method="periodic"), BadRecording, "period"),
    (SpectraOptions(period=3.0), NotEnoughData, "two periods"),
    (SpectraOptions(period=0.10055), BadOption, "whole number"),
    (SpectraOptions(estimator="indirect"), BadOption, "reference"),
    (SpectraOptions(window="kaiser"), BadOption, "window"),
    (SpectraOptions(overlap=1.0), BadOption, "overlap"),
    (SpectraOptions(output="load_speed"), BadRecording, "load_speed"),
    (SpectraOptions(band=(600.0, 700.0)), BadOption, "band"),
])
def test_impossible_options_are_refused(options, error, words):
    with pytest.raises(error, match=words):
        spectra([noisy_run()], options)


@pytest.mark.parametrize("changes", [{"method": "magic"}, {"estimator": "h9"}])
def test_unknown_words_are_refused(changes):
    with pytest.raises(BadOption):
        SpectraOptions(**changes)


def test_an_angle_gives_the_response_of_the_speed():
    """theta = integral of a speed that is sampled finely: the same response up to the exact factor."""
    lines, size = np.arange(2, 40), 1000
    u = np.tile(multisine(size, lines, 5), 6)
    f = lines / (size * STEP)
    g = 1.0 / (0.5 + 2j * np.pi * f)
    period = np.fft.rfft(u[:size])[lines] * g / (2j * np.pi * f)
    spectrum = np.zeros(size // 2 + 1, complex)
    spectrum[lines] = period
    theta = np.tile(np.fft.irfft(spectrum, size), 6) + 3.0 * np.arange(6 * size) * STEP
    e = experiment(u, theta)
    e = type(e)(e.name, e.sha256, e.step, e.start, {"motor_torque": u, "motor_angle": theta}, e.segments)
    r = spectra([e], SpectraOptions()).mean
    np.testing.assert_allclose(r.frequency, f)
    np.testing.assert_allclose(r.g, g, rtol=1e-6)
