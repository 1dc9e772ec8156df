"""One explanation of the torque that a motion asks for: a drive, fitted to some samples and judged by others.

The error of the torque judges as it is, not whitened: an autoregression would foretell much of a smooth error for
which a law is missing. Its correlation only says how many samples are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.heldout import Split, blocks_of
from drivetool.drive import Drive
from drivetool.identify.inverse import Inverse, count_of, lacking, solved, with_laws
from drivetool.identify.motion import NOISE_SHARE, turns

NONE = 0  # number of the block of a sample outside all: none of these is in a mask
LAGS = 8  # of the samples, up to which their correlation is looked at
Masks = tuple[np.ndarray, ...]  # per record (n,) whether a sample counts


@dataclass(frozen=True)
class Records:
    """The records with what judges.

    inverse  all of them, those that only judge at the end; without the samples that no fit may use
    fitted   number of records that are fitted to
    own      names of what records that only judge have of their own: fitted to them, the rest held
    blocks   per record (n,) number of the block that a sample is in
    judges   per fold, per record (n,) whether a sample judges; the others of the fitted records train
    """

    inverse: Inverse
    fitted: int
    blocks: tuple[np.ndarray, ...]
    judges: tuple[Masks, ...]
    own: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Of the blocks."""
        return 1 + max(int(b.max()) for b in self.blocks)

    def training(self, fold: int | None = None) -> Masks:
        """The samples that are fitted to; None: all of the records that do not only judge."""
        every = tuple(np.full(len(b), i < self.fitted) for i, b in enumerate(self.blocks))
        return every if fold is None else tuple(e & ~j for e, j in zip(every, self.judges[fold], strict=True))


@dataclass(frozen=True)
class Judged:
    """What a fit leaves of the torque, by samples that the filter leaves independent.

    mean     squared error of those that it was fitted to, count: how many
    share    of these, as which they count: an error that is correlated tells less (Bartlett 1946)
    squares  (blocks,) sums of squared errors of those that judge, counts: (blocks,) how many
    feigned  mean square of these by which noise of the motion may have lowered it: without instruments what is
             fitted follows that noise, and a further law may let it follow better
    """

    mean: float
    count: int
    share: float
    squares: np.ndarray
    counts: np.ndarray
    feigned: float

    @property
    def training(self) -> float:
        """-log likelihood of the samples of the fit, as if they were independent."""
        return 0.5 * self.count * (1.0 + float(np.log(self.mean)))

    def test(self, doubted: bool = False) -> np.ndarray:
        """(blocks,) the same of those that judge, by a variance of their own: a record may be louder throughout.

        doubted  with what noise may have feigned
        """
        squares = self.squares + doubted * self.feigned * self.counts
        variance = max(float(squares.sum() / max(self.counts.sum(), 1)), 1e-300)
        return 0.5 * squares / variance + 0.5 * self.counts * np.log(variance)


@dataclass(frozen=True)
class Explanation:
    """A drive, fitted to all training samples, and to those of every fold.

    whole  the fit to all; own: what it leaves of them; trained: per fold; judged: per fold
    """

    whole: Inverse
    own: Judged
    trained: tuple[Inverse, ...] = ()
    judged: tuple[Judged, ...] = ()

    def test(self, doubted: bool = False) -> np.ndarray:
        """(blocks,) -log likelihood of what judges, by what was not fitted to it; doubted: see Judged."""
        return np.sum([j.test(doubted) for j in self.judged], axis=0)

    @property
    def squares(self) -> tuple[np.ndarray, np.ndarray]:
        """(blocks,) squared errors and counts of the blocks that judge."""
        return (np.sum([j.squares for j in self.judged], axis=0), np.sum([j.counts for j in self.judged], axis=0))

    @property
    def rmse(self) -> float:
        """Of the torque over what judges."""
        squares, counts = self.squares
        return float(np.sqrt(squares.sum() / max(counts.sum(), 1)))


def records_of(inverse: Inverse, split: Split, fitted: int, own: Sequence[str] = ()) -> Records:
    """The records with the blocks and folds of a split; fitted, own: see Records.

    Samples about reversals are nobody's, whether or not dry friction is in the drive: all are judged alike.
    """
    sizes = [e.size for e in inverse.experiments]
    blocks = [np.full(n, NONE, np.int64) for n in sizes]
    places = [(k, a) for k, e in enumerate(inverse.experiments) for a, b in e.segments if b - a >= 10]
    for number, (i, a, b) in enumerate(blocks_of(split.traces)):
        k, first = places[i]
        blocks[k][first + a:first + b] = number
    judges = []
    for fold in split.folds:
        masks = [np.zeros(n, bool) for n in sizes]
        for (k, first), mask in zip(places, fold.test, strict=True):
            masks[k][first:first + len(mask)] = mask
        judges.append(tuple(masks))
    lead = inverse.lead or tuple(np.zeros(n, bool) for n in sizes)
    lead = tuple(early | turns(m) for early, m in zip(lead, inverse.seen.each, strict=True))
    return Records(replace(inverse, lead=lead), fitted, tuple(blocks), tuple(judges), tuple(own))


def explanation(records: Records, drive: Drive, free: Sequence[str], whole: bool = False) -> Explanation:
    """A drive fitted to the training samples.

    free   names of what is fitted, from the drive's values on
    whole  whether to leave the folds out: what is compared by the training samples alone
    """
    start, training = replace(records.inverse, drive=drive, free=tuple(free)), records.training()
    fit = _fitted(start, training)
    own = _judged(fit, records, training, training)
    if whole:
        return Explanation(fit, own)
    folds = range(len(records.judges))
    trained = [fit if len(folds) == 1 else _fitted(fit, records.training(f)) for f in folds]
    if records.own:
        trained = [replace(t, drive=_fitted(replace(t, free=records.own), records.judges[f]).drive)
                   for f, t in enumerate(trained)]
    judged = tuple(_judged(t, records, records.training(f), records.judges[f]) for f, t in enumerate(trained))
    return Explanation(fit, own, tuple(trained), judged)


def best_on(one: Explanation, records: Records, fold: int) -> float:
    """Least -log likelihood of the samples that judge a fold, by the same drive fitted to them: by least squares.

    Instruments would not lead to the least.
    """
    judges, trained = records.judges[fold], one.trained[fold]
    start = replace(trained, free=(*trained.free, *records.own), foreseen=None)
    own = float(_judged(_fitted(start, judges), records, judges, judges).test().sum())
    return min(own, float(one.judged[fold].test().sum()))


def _fitted(start: Inverse, masks: Masks) -> Inverse:
    """The drive fitted to the samples of a mask."""
    return replace(start, drive=solved(_over(start, masks)).at.drive)


def _over(start: Inverse, masks: Masks) -> Inverse:
    """The same over the samples of a mask; records without any are left out, for their chains are simulated too."""
    keep = [i for i, m in enumerate(masks) if m.any()]
    lead = tuple(start.lead[i] | ~masks[i] for i in keep)
    foreseen = None if start.foreseen is None else tuple(start.foreseen[i] for i in keep)
    return replace(start, experiments=tuple(start.experiments[i] for i in keep), lead=lead, foreseen=foreseen,
                   seen=replace(start.seen, each=tuple(start.seen.each[i] for i in keep)))


def _judged(fit: Inverse, records: Records, training: Masks, judges: Masks) -> Judged:
    """What a fit leaves of the samples of both masks; records in neither are left out."""
    keep = [i for i, (a, b) in enumerate(zip(training, judges, strict=True)) if a.any() or b.any()]
    over = _over(fit, tuple(np.full(len(m), i in keep) for i, m in enumerate(training)))
    squares, counts = np.zeros(records.count), np.zeros(records.count)
    total, count, shares, moved = 0.0, 0, [], 0.0
    for i, q in zip(keep, over.with_motion(), strict=True):
        used, left, blocks = (v[::fit.kept] for v in (q.used, q.residual, records.blocks[i]))
        train, test = (m[i][::fit.kept] & used for m in (training, judges))
        total += float(np.sum(left[train] ** 2))
        count += int(train.sum())
        shares += [(independent(np.where(train, left, 0.0)), int(train.sum()))] if train.any() else []
        squares += np.bincount(blocks[test], left[test] ** 2, records.count)
        counts += np.bincount(blocks[test], minlength=records.count)
        moved += float(np.sum(fit.seen.each[i].acceleration[::fit.kept][test] ** 2))
    inertia = fit.drive.values[f"{fit.drive.bodies[0]}.inertia"]
    # Instruments do not cure it behind shafts: through gaps and friction noise does not come in proportion.
    cured = fit.foreseen is not None and not fit.drive.shafts
    feigned = 0.0 if cured else inertia**2 * NOISE_SHARE * moved / max(counts.sum(), 1)
    share = sum(s * n for s, n in shares) / max(count, 1)
    return Judged(max(total / max(count, 1), 1e-300), count, share, squares, counts, feigned)


def independent(left: np.ndarray) -> float:
    """As which share of its values a correlated series counts where its variance is asked for.

    left    (n,) zero where nothing is known
    source  Bartlett 1946: the variance of a mean square goes with the sum of the squared autocorrelations
    """
    size = 1 << (2 * len(left) - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(left, size)) ** 2, size)[:max(len(left) // LAGS, 2)]
    if not products[0] > 0.0:
        return 1.0
    # Chance gives each squared correlation the sum that is asked for, over their number.
    chance = 2.0 * (len(products) - 1) / max(np.count_nonzero(left), 1)
    return float(min((1.0 + chance) / (1.0 + 2.0 * np.sum((products[1:] / products[0]) ** 2)), 1.0))


def left_by_laws(one: Explanation, records: Records) -> float:
    """Log likelihood that laws bring which the motion foretells and the drive lacks; zero if there are none."""
    start = _over(one.whole, records.training())
    names = lacking(start)
    if not names:
        return 0.0
    # Without instruments: what laws foretell is to be as small as it can be.
    rows = solved(with_laws(replace(start, foreseen=None), names)).at.rows()
    mean = sum(float(np.sum(r.residual**2)) for r in rows) / max(count_of(rows), 1)
    return max(0.5 * one.own.share * one.own.count * float(np.log(one.own.mean / max(mean, 1e-300))), 0.0)
