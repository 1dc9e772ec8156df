"""Spectra: the nonparametric frequency response of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.identify.channels import feedback_of
from drivetool.identify.frequency.frf import ESTIMATORS, Response, Welch, welch_response
from drivetool.identify.frequency.periodic import Lines, distortions, lines_of, period_of, periodic_response
from drivetool.identify.frequency.spectra_findings import findings_of, peaks_of, pictures
from drivetool.identify.frequency.spectrum import Spectrum
from drivetool.logs import Experiment, true_runs

Method = Literal["auto", "welch", "periodic"]
METHODS: tuple[Method, ...] = ("auto", "welch", "periodic")
# Options that one method alone uses.
OF_ONE_METHOD = {"welch": ("estimator", "window", "length", "overlap"), "periodic": ("period", "skip")}
REFERENCES = ("reference_torque", "reference_speed", "reference_angle")
# Half-overlapping frames of a record by default. A choice: scatter of 25 % at a sixteenth's resolution
DEFAULT_FRAMES = 16


@dataclass(frozen=True)
class SpectraOptions:
    """How frequency responses are found.

    method     welch, periodic, or auto: periodic where the excitation repeats itself
    estimator  h1, h2, h3, hv, indirect; None: indirect where there is a reference, else h1
    window     of Welch's frames; length [s] of a frame, None: a ninth of the shortest record;
               overlap: share of a frame
    period     [s] of the excitation; None: found
    skip       periods at the start of each run left out; None: one, if three are left
    output     role; None: the motor's speed, else its angle turned into speed
    band       (low, high) Hz to report; None: all
    """

    method: Method = "auto"
    estimator: str | None = None
    window: str = "hann"
    length: float | None = None
    overlap: float = 0.5
    period: float | None = None
    skip: int | None = None
    output: str | None = None
    band: tuple[float, float] | None = None

    def __post_init__(self):
        if self.method not in METHODS:
            raise BadOption("a known method", f"'{self.method}'", "Correct --method.", METHODS)
        if self.estimator is not None and self.estimator not in ESTIMATORS:
            raise BadOption("a known estimator", f"'{self.estimator}'", "Correct --estimator.", ESTIMATORS)
        other = {"welch": "periodic", "periodic": "welch"}.get(self.method)
        for name in OF_ONE_METHOD.get(other, ()):
            if getattr(self, name) != getattr(SpectraOptions, name):
                raise BadOption(f"options that spectra --method {self.method} uses", f"--{name}",
                                f"Leave it out, or take --method {other}.")


@dataclass(frozen=True)
class Run:
    """Torque, output and perhaps a reference of one recording, cut into uninterrupted stretches."""

    name: str
    stretches: tuple[np.ndarray, ...]
    step: float


def spectra(experiments: Sequence[Experiment], options: SpectraOptions) -> Spectrum:
    """Frequency response from motor torque to a sensor, with its variance.

    experiments  motor_torque and a sensor; with a reference_* role the loop may be closed. Each is a run
    returns      Spectrum
    raises       BadOption: a method that the record does not allow; BadRecording: no sensor;
                 NotEnoughData: fewer than two frames or periods, no excited line
    source       frf.py and periodic.py
    """
    output = output_role(experiments, options.output)
    runs = [stretches_of(e, output) for e in experiments]
    if len({round(r.step, 12) for r in runs}) > 1:
        raise BadRecording("recordings of one sample interval",
                           ", ".join(f"{r.step:g} s in {r.name}" for r in runs), "Analyse them separately.")
    size = _period_samples(runs, options)
    found, each, lines, settings = (_periodic_spectra if size else _welch_spectra)(runs, options, size)
    if output.endswith("angle"):
        found, each = _to_speed(found, runs[0].step), [(n, _to_speed(r, runs[0].step)) for n, r in each]
    if options.band:
        found, each = found.band(*options.band), [(n, r.band(*options.band)) for n, r in each]
        if not len(found.frequency):
            raise BadOption("excited lines in the band", f"none from {options.band[0]:g} to "
                            f"{options.band[1]:g} Hz", "Widen --band.")
    loop = feedback_of([s[:, :2] for r in runs for s in r.stretches])
    reference = runs[0].stretches[0].shape[1] > 2
    e = experiments[0]
    unit = f"{e.unit(output.replace('angle', 'speed'))}/{e.unit('motor_torque')}"
    draft = Spectrum(
        "motor_torque", output, unit, found, tuple(each), _std_over_runs(found, each), distortions(lines),
        loop, settings, peaks_of(found), (), tuple(x.source for x in experiments))
    return replace(draft, findings=findings_of(draft, reference), exhibits=pictures(draft))


def output_role(experiments: Sequence[Experiment], wanted: str | None) -> str:
    """The sensor that every recording has: the requested one, else at the motor."""
    common = set.intersection(*(set(e.signals) for e in experiments))
    choices = (wanted,) if wanted else ("motor_speed", "motor_angle")
    for role in choices:
        if role in common and role != "motor_torque":
            return role
    raise BadRecording(" or ".join(choices) + " in every recording", "not there",
                       "Name its channel in the channel map, or choose another --output.", sorted(common))


def stretches_of(e: Experiment, output: str) -> Run:
    """Stretches without a missing value; an angle becomes the mean speed over the last interval."""
    names = ["motor_torque", output, *reference_of(e)]
    e.signed("motor_torque", "the input")
    table = np.column_stack([e.signals[n] for n in names])
    if output.endswith("angle"):
        table[1:, 1] = np.diff(table[:, 1]) / e.step
        table[0, 1] = np.nan
    good = np.isfinite(table).all(axis=1)
    found = [table[first + a: first + b] for first, last in e.segments
             for a, b in true_runs(good[first:last]) if b - a >= 16]
    if not found:
        raise NotEnoughData(f"16 samples in a row with torque and {output} in {e.name}", "fewer",
                            "Choose another sensor, or resample the log.")
    return Run(e.name, tuple(found), e.step)


def reference_of(e: Experiment) -> list[str]:
    """The role of the loop's reference, the best one; empty if there is none."""
    return [r for r in REFERENCES if r in e.signals][:1]


def _period_samples(runs: Sequence[Run], options: SpectraOptions) -> int | None:
    """Samples per period, if the periodic method is to be used."""
    step = runs[0].step
    if options.method == "welch":
        return None
    if options.period is not None:
        size = round(options.period / step)
        if size < 4 or abs(size * step - options.period) > 1e-3 * step * max(1.0, size / 1000.0):
            raise BadOption("a period of a whole number of samples",
                            f"{options.period / step:.6g} samples of {step:g} s", "Correct --period.")
        return size
    if options.method == "auto" and options.estimator is not None:
        return None
    found = [period_of(max(r.stretches, key=len)[:, -1 if r.stretches[0].shape[1] > 2 else 0]) for r in runs]
    if None not in found and len(set(found)) == 1:
        return found[0]
    if options.method == "periodic":
        shown = ", ".join("none" if f is None else f"{f * step:g} s" for f in found)
        raise BadRecording("an excitation of one period in every recording", f"periods: {shown}",
                           "Name it with --period, or use --method welch.")
    return None


def _periodic_spectra(runs: Sequence[Run], options: SpectraOptions, size: int):
    """(response of all, per run, lines, settings) over whole periods."""
    lines: list[tuple[str, Lines]] = []
    for run in runs:
        for stretch in run.stretches:
            whole = len(stretch) // size
            skip = options.skip if options.skip is not None else int(whole >= 3)
            if whole - skip >= 2 or len(run.stretches) == 1:
                lines.append((run.name, lines_of(stretch, run.step, size, skip)))
    if not lines:
        raise NotEnoughData(f"stretches of at least two periods of {size * runs[0].step:g} s",
                            "none in any recording", "Record more periods, or use --method welch.")
    each = [(name, periodic_response([one])) for name, one in lines]
    settings = {"method": "periodic", "period": size * runs[0].step, "step": runs[0].step,
                "periods": [len(one.u) for _, one in lines]}
    return periodic_response([one for _, one in lines]), each, [one for _, one in lines], settings


def _welch_spectra(runs: Sequence[Run], options: SpectraOptions, size: int | None):
    """(response of all, per run, no lines, settings) by Welch's method."""
    step, reference = runs[0].step, runs[0].stretches[0].shape[1] > 2
    shortest = min(max(len(s) for s in r.stretches) for r in runs)
    samples = round(options.length / step) if options.length else max(32, 2 * shortest // (DEFAULT_FRAMES + 1))
    welch = Welch(samples, options.overlap, options.window)
    estimator = options.estimator or ("indirect" if reference else "h1")
    every = [s for r in runs for s in r.stretches]
    mean = welch_response(every, step, welch, estimator)
    each = [(r.name, welch_response(r.stretches, step, welch, estimator)) for r in runs]
    settings = {"method": "welch", "estimator": estimator, "window": options.window, "length": samples * step,
                "overlap": options.overlap, "step": step, "independent_frames": mean.averages}
    return mean, each, [], settings


def _to_speed(r: Response, step: float) -> Response:
    """From the mean speed over the last interval to the speed at the sample."""
    w = 2j * np.pi * r.frequency
    factor = w * step / -np.expm1(-w * step)
    square = np.abs(factor) ** 2
    return replace(r, g=r.g * factor, noise=r.noise * square, total=r.total * square)


def _std_over_runs(mean: Response, each: Sequence[tuple[str, Response]]) -> np.ndarray | None:
    """(n,) std over the runs at the lines that all of them have; NaN elsewhere."""
    if len(each) < 2:
        return None
    table = np.full((len(each), len(mean.frequency)), np.nan, complex)
    for row, (_, r) in zip(table, each, strict=True):
        _, a, b = np.intersect1d(mean.frequency, r.frequency, assume_unique=True, return_indices=True)
        row[a] = r.g[b]
    centre = table.mean(axis=0)
    return np.sqrt(np.sum(np.abs(table - centre) ** 2, axis=0) / (len(each) - 1))
