"""Options of the estimators."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

from drivetool.errors import BadOption
from drivetool.identify.estimate import Covariance
from drivetool.identify.setup.start import KnownStart
from drivetool.quantity import quantity_of

Criterion = Literal["auto", "innovations", "simulation", "frequency", "inverse"]
Method = Literal["speeds", "acceleration", "coast-down"]
Weighting = Literal["variance", "coherence"]
# Of every recording, left out of a fit to compare fits by it. A choice, usual in cross-validation: more leaves too
# little to fit, less too little to compare.
HELD_OUT_SHARE = 0.3
STEP_SPECIFIC = {"of_one_step": True}  # of a field: result files list it only where it differs from its default
# Parameters that a linear response does not have.
NONLINEAR = ("idle_torque", "coulomb", "drift_coulomb", "bristle_stiffness", "bristle_damping", "half_gap")
OF_EVERY_STEP = ("hold", "free", "known", "unidentified")
# Step, and the option that selects another fit of it -> the other options that it uses, or refuses by itself.
USED_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "steady": ("method", "start", "flux_decay", "stages"),
    "steady --method acceleration": ("method", "segment", "start", "flux_decay", "stages"),
    "blackbox": ("criterion", "starts"),
    "blackbox --criterion simulation": ("criterion", "starts", "segment"),
    "blackbox --criterion frequency": ("criterion", "structure", "order", "weighting", "band"),
    **{f"blackbox --structure {kind}": ("criterion", "structure", "order", *more) for kind, more in {
        "oe": (), "arx": (), "innovations": (), "bj": ("noise_order",), "armax": ("noise_order",)}.items()},
    "greybox": ("criterion", "starts", "seed", "segment", "start"),
    "greybox --criterion inverse": ("criterion", "start"),
    "greybox --criterion frequency": ("criterion", "start", "weighting", "band"),
    "backlash": ("criterion", "starts", "seed", "start"),
    "backlash --criterion simulation": ("criterion", "starts", "seed", "start", "segment"),
    "backlash --criterion inverse": ("criterion", "start"),
}


@dataclass(frozen=True)
class Options:
    """Options of every estimator; each uses what concerns it.

    hold       parameter names that keep their value
    free       parameter names that are fitted although they would be held
    criterion  greybox and backlash: auto chooses among candidate fits of the record; innovations, simulation,
               frequency and inverse are one each
    starts     starting points tried when the problem may have several optima; None: the
               estimator decides
    segment    length [s] of the segments with free start states of a simulation-error
               fit; None: the estimator decides; 0: one free run over each record
    seed       of everything random
    structure  blackbox: a polynomial structure (oe, bj, arx, armax, innovations); None: the
               third-order model in continuous time. order: of its dynamics, None to choose by
               held-out score; noise_order: of its noise, None for two
    weighting  of a fit in the frequency domain: by the measured variance (maximum likelihood), or by
               coherence over frequency
    band       (low, high) Hz of a fit in the frequency domain; None: where the record is excited
    method     steady: speeds, from intervals of constant speed; acceleration, from those of constant torque;
               coast-down, from running down without torque. flux_decay: time after switching off that a coast-down
               leaves out [s]. stages: of a coast-down, windows (high, low) of the speed [motion unit/s] that are
               fitted one after the other
    start      greybox and backlash: known states in which every recording begins
    known      covariance of the values in the parameter files, so that the intervals of fitted
               parameters include the uncertainty of held ones
    unidentified  names of the values there that no recording identifies: each is a start, and no known value
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    criterion: Criterion = "auto"
    starts: int | None = None
    segment: float | None = None
    seed: int = 1
    structure: str | None = field(default=None, metadata=STEP_SPECIFIC)
    order: int | None = field(default=None, metadata=STEP_SPECIFIC)
    noise_order: int | None = field(default=None, metadata=STEP_SPECIFIC)
    weighting: Weighting = field(default="variance", metadata=STEP_SPECIFIC)
    band: tuple[float, float] | None = field(default=None, metadata=STEP_SPECIFIC)
    method: Method = field(default="speeds", metadata=STEP_SPECIFIC)
    flux_decay: float | None = field(default=None, metadata=STEP_SPECIFIC)
    stages: tuple[tuple[float, float], ...] = field(default=(), metadata=STEP_SPECIFIC)
    start: KnownStart = field(default_factory=KnownStart)
    known: Covariance | None = None
    unidentified: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise BadOption where a parameter is held and free."""
        if both := set(self.hold) & set(self.free):
            raise BadOption("a parameter held or free", f"{', '.join(sorted(both))} as both",
                            "Drop one of the two.")


def refuse_unused(step: str, options: Options) -> None:
    """Raise BadOption where the step does not use an option that is not at its default, or a free name."""
    ways = [f"{step} --{name} {getattr(options, name)}" for name in ("criterion", "structure", "method")]
    way = next((each for each in ways if each in USED_OPTIONS), step)
    used, default = USED_OPTIONS[way], Options()
    for name in (f.name for f in fields(Options) if f.name not in (*OF_EVERY_STEP, *used)):
        if getattr(options, name) != getattr(default, name):
            others = [each for each, names in USED_OPTIONS.items() if each.split()[0] == step and name in names]
            words = [f"--{n.replace('_', '-')}" for n in (name, "hold", "free", *used)]
            raise BadOption(f"options that {way} uses", words[0],
                            f"Leave it out{f', or take {others[0]}' if others else ''}.", words[1:])
    if options.criterion == "frequency":
        refuse_other_free(way, [n for n in options.free if quantity_of(n) in NONLINEAR], (),
                          "Take a criterion in time: this one fits a linear response.")


def refuse_other_free(step: str, free: Sequence[str], possible: Collection[str], do: str = "Free it in greybox.",
                      ) -> None:
    """Raise BadOption where a name is free that the step does not fit; possible: names that it fits."""
    for name in free:
        if name not in possible:
            raise BadOption(f"a parameter that {step} fits after --free", name, do, possible)
