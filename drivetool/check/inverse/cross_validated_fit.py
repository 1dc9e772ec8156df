"""A drive fitted to the required torque of some samples and tested on others (cross-validation).

The error of the torque is not whitened: an autoregression would predict much of the smooth error of a missing law.
Its correlation only gives the number of independent samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.heldout import Split, blocks_of
from drivetool.drive import Drive
from drivetool.identify.inverse import InverseRegression, missing_laws_of, sample_count, solve_inverse, with_laws
from drivetool.identify.motion import NOISE_SHARE, near_reversal
from drivetool.quantity import name_of

OUTSIDE_BLOCKS = 0  # block number of a sample outside all blocks: none of these is in a mask
# A choice: correlations up to an eighth of the samples, because longer lags have too few products.
SAMPLES_PER_LAG = 8
Masks = tuple[np.ndarray, ...]  # per record (n,) whether a sample counts


@dataclass(frozen=True)
class Records:
    """The records with their training and test samples.

    inverse     all of them, held-out records last; without the samples that no fit may use
    fitted      number of records that are fitted to
    own         parameters that held-out records have of their own: fitted to them, the rest fixed
    blocks      per record (n,) number of the block that a sample is in
    test_masks  per fold, per record (n,) whether a sample is a test sample; the others of the fitted records train
    """

    inverse: InverseRegression
    fitted: int
    blocks: tuple[np.ndarray, ...]
    test_masks: tuple[Masks, ...]
    own: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Of the blocks."""
        return 1 + max(int(b.max()) for b in self.blocks)

    def training(self, fold: int | None = None) -> Masks:
        """The training samples; None: all samples of the records that are not held out."""
        every = tuple(np.full(len(b), i < self.fitted) for i, b in enumerate(self.blocks))
        return every if fold is None else tuple(e & ~j for e, j in zip(every, self.test_masks[fold], strict=True))


@dataclass(frozen=True)
class TorqueErrors:
    """The torque errors of a fit, at samples that are independent behind the filter.

    mean        squared error of the training samples; count: their number
    share       of independent samples: correlated errors carry less information (Bartlett 1946)
    squares     (blocks,) sums of squared errors of the test samples; counts: (blocks,) their numbers
    noise_gain  mean square by which noise of the motion may have lowered it: without instruments the fit follows
                that noise, and a further law may let it follow better
    """

    mean: float
    count: int
    share: float
    squares: np.ndarray
    counts: np.ndarray
    noise_gain: float

    @property
    def training(self) -> float:
        """-log likelihood of the samples of the fit, as if they were independent."""
        return 0.5 * self.count * (1.0 + float(np.log(self.mean)))

    def test(self, with_noise_gain: bool = False) -> np.ndarray:
        """(blocks,) the same of the test samples, with their own variance: a record may have more noise throughout.

        with_noise_gain  whether to add what noise may have gained
        """
        squares = self.squares + with_noise_gain * self.noise_gain * self.counts
        variance = max(float(squares.sum() / max(self.counts.sum(), 1)), 1e-300)
        return 0.5 * squares / variance + 0.5 * self.counts * np.log(variance)


@dataclass(frozen=True)
class CrossValidatedFit:
    """A drive, fitted to all training samples, and to those of every fold.

    whole  the fit to all; own: its errors there; trained: per fold; test_errors: per fold
    """

    whole: InverseRegression
    own: TorqueErrors
    trained: tuple[InverseRegression, ...] = ()
    test_errors: tuple[TorqueErrors, ...] = ()

    def test(self, with_noise_gain: bool = False) -> np.ndarray:
        """(blocks,) -log likelihood of the test samples by the fits to the others; argument as of TorqueErrors."""
        return np.sum([j.test(with_noise_gain) for j in self.test_errors], axis=0)

    @property
    def squares(self) -> tuple[np.ndarray, np.ndarray]:
        """(blocks,) squared errors and counts of the test blocks."""
        return (np.sum([j.squares for j in self.test_errors], axis=0),
                np.sum([j.counts for j in self.test_errors], axis=0))

    @property
    def rmse(self) -> float:
        """Of the torque over the test samples."""
        squares, counts = self.squares
        return float(np.sqrt(squares.sum() / max(counts.sum(), 1)))


def records_of(inverse: InverseRegression, split: Split, fitted: int, own: Sequence[str] = ()) -> Records:
    """The records with the blocks and folds of a split; fitted, own: see Records.

    Samples around reversals are excluded, whether or not dry friction is in the drive: all drives use the same.
    """
    sizes = [e.size for e in inverse.experiments]
    blocks = [np.full(n, OUTSIDE_BLOCKS, np.int64) for n in sizes]
    segments = [(k, a) for k, e in enumerate(inverse.experiments) for a, b in e.segments if b - a >= 10]
    for number, (i, a, b) in enumerate(blocks_of(split.traces)):
        k, first = segments[i]
        blocks[k][first + a:first + b] = number
    test_masks = []
    for fold in split.folds:
        masks = [np.zeros(n, bool) for n in sizes]
        for (k, first), mask in zip(segments, fold.test, strict=True):
            masks[k][first:first + len(mask)] = mask
        test_masks.append(tuple(masks))
    lead = inverse.lead or tuple(np.zeros(n, bool) for n in sizes)
    lead = tuple(early | near_reversal(m) for early, m in zip(lead, inverse.seen.each, strict=True))
    return Records(replace(inverse, lead=lead), fitted, tuple(blocks), tuple(test_masks), tuple(own))


def cross_validated_fit(records: Records, drive: Drive, free: Sequence[str],
                        whole: bool = False) -> CrossValidatedFit:
    """A drive fitted to the training samples.

    free   names of the fitted parameters; the drive's values are their start
    whole  whether to skip the folds: for a comparison by the training samples only
    """
    start, training = replace(records.inverse, drive=drive, free=tuple(free)), records.training()
    fit = _fit_to_samples(start, training)
    own = _torque_errors(fit, records, training, training)
    if whole:
        return CrossValidatedFit(fit, own)
    folds = range(len(records.test_masks))
    trained = [fit if len(folds) == 1 else _fit_to_samples(fit, records.training(f)) for f in folds]
    if records.own:
        trained = [replace(t, drive=_fit_to_samples(replace(t, free=records.own), records.test_masks[f]).drive)
                   for f, t in enumerate(trained)]
    test_errors = tuple(_torque_errors(t, records, records.training(f), records.test_masks[f])
                        for f, t in enumerate(trained))
    return CrossValidatedFit(fit, own, tuple(trained), test_errors)


def best_test_loss(fit: CrossValidatedFit, records: Records, fold: int) -> float:
    """Least -log likelihood of the test samples of a fold, by the same drive fitted to them by least squares.

    Instruments would not give the minimum.
    """
    test_masks, trained = records.test_masks[fold], fit.trained[fold]
    start = replace(trained, free=(*trained.free, *records.own), predicted=None)
    own = float(_torque_errors(_fit_to_samples(start, test_masks), records, test_masks, test_masks).test().sum())
    return min(own, float(fit.test_errors[fold].test().sum()))


def _fit_to_samples(start: InverseRegression, masks: Masks) -> InverseRegression:
    """The drive fitted to the samples of a mask."""
    return replace(start, drive=solve_inverse(_over_samples(start, masks)).at.drive)


def _over_samples(start: InverseRegression, masks: Masks) -> InverseRegression:
    """The same over the samples of a mask; records without any are left out, for their chains are simulated too."""
    keep = [i for i, m in enumerate(masks) if m.any()]
    lead = tuple(start.lead[i] | ~masks[i] for i in keep)
    foreseen = None if start.predicted is None else tuple(start.predicted[i] for i in keep)
    return replace(start, experiments=tuple(start.experiments[i] for i in keep), lead=lead, predicted=foreseen,
                   seen=replace(start.seen, each=tuple(start.seen.each[i] for i in keep)))


def _torque_errors(fit: InverseRegression, records: Records, training: Masks, test_masks: Masks) -> TorqueErrors:
    """The torque errors of a fit at the samples of both masks; records in neither are left out."""
    keep = [i for i, (a, b) in enumerate(zip(training, test_masks, strict=True)) if a.any() or b.any()]
    used_records = _over_samples(fit, tuple(np.full(len(m), i in keep) for i, m in enumerate(training)))
    squares, counts = np.zeros(records.count), np.zeros(records.count)
    total, count, shares, acceleration_squares = 0.0, 0, [], 0.0
    for i, q in zip(keep, used_records.with_motion(), strict=True):
        used, left, blocks = (v[::fit.kept] for v in (q.used, q.residual, records.blocks[i]))
        train, test = (m[i][::fit.kept] & used for m in (training, test_masks))
        total += float(np.sum(left[train] ** 2))
        count += int(train.sum())
        shares += [(independent_share(np.where(train, left, 0.0)), int(train.sum()))] if train.any() else []
        squares += np.bincount(blocks[test], left[test] ** 2, records.count)
        counts += np.bincount(blocks[test], minlength=records.count)
        acceleration_squares += float(np.sum(fit.seen.each[i].acceleration[::fit.kept][test] ** 2))
    inertia = fit.drive.values[name_of(fit.drive.bodies[0], "inertia")]
    # Instruments do not remove the bias behind shafts: gaps and friction pass noise nonlinearly.
    unbiased = fit.predicted is not None and not fit.drive.shafts
    noise_gain = 0.0 if unbiased else inertia**2 * NOISE_SHARE * acceleration_squares / max(counts.sum(), 1)
    share = sum(s * n for s, n in shares) / max(count, 1)
    return TorqueErrors(max(total / max(count, 1), 1e-300), count, share, squares, counts, noise_gain)


def independent_share(residual: np.ndarray) -> float:
    """Share of independent values of a correlated series for its mean square.

    residual  (n,) zero where nothing is known
    source    Bartlett 1946: the variance of a mean square is proportional to the sum of squared autocorrelations
    """
    size = 1 << (2 * len(residual) - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(residual, size)) ** 2, size)[
        :max(len(residual) // SAMPLES_PER_LAG, 2)]
    if not products[0] > 0.0:
        return 1.0
    # By chance each squared correlation is 1 / n: their expected sum is subtracted.
    chance = 2.0 * (len(products) - 1) / max(np.count_nonzero(residual), 1)
    return float(min((1.0 + chance) / (1.0 + 2.0 * np.sum((products[1:] / products[0]) ** 2)), 1.0))


def gain_of_missing_laws(fit: CrossValidatedFit, records: Records) -> float:
    """Gain in log likelihood by laws of the motion that the drive lacks; zero if there are none."""
    start = _over_samples(fit.whole, records.training())
    names = missing_laws_of(start)
    if not names:
        return 0.0
    # Without instruments: least squares give the smallest residual.
    rows = solve_inverse(with_laws(replace(start, predicted=None), names)).at.rows()
    mean = sum(float(np.sum(r.residual**2)) for r in rows) / max(sample_count(rows), 1)
    return max(0.5 * fit.own.share * fit.own.count * float(np.log(fit.own.mean / max(mean, 1e-300))), 0.0)
