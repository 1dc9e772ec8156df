"""What must hold of the effects together, and of each law; checked when the catalogue is built."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from drivetool.drive.effects.effect import Effect

# A point where no law is constant or kinks. The parameters differ, so that none can be taken for another.
ARGUMENTS, TIME, SIDE = (0.7, 0.45), 1.3, 1.0
MOST_PARAMETERS = 32  # that a law may read in the check; others would be an IndexError here
PARAMETERS = 0.8 + 0.37 * np.arange(float(MOST_PARAMETERS))
# Central differences over this step are right to its square: 1e-8 of the law.
STEP, TOLERANCE = 1e-4, 1e-6


def check_effects(effects: Sequence[Effect]) -> None:
    """Raise ValueError, in one sentence, for the first effect of the catalogue that is wrong.

    Two effects of one kind of owner with one quantity; a law whose derivatives are not those of its torque; states
    without start values.
    """
    owned = Counter((e.of, suffix) for e in effects for suffix in e.quantities)
    for e in effects:
        twice = [suffix for suffix in e.quantities if owned[e.of, suffix] > 1]
        if twice:
            others = [o.code for o in effects if o is not e and o.of == e.of and twice[0] in o.quantities]
            raise ValueError(f"the quantity {twice[0]} of a {e.of} is declared by {e.code} and by {others[0]}")
        if e.has_states and e.start is None:
            raise ValueError(f"{e.code} adds states and has no `start` that gives their start values")
        if e.torque is not None and not _has_derivatives(e.torque):
            raise ValueError(f"the law of {e.code} does not write the derivatives of its torque into out[1:]")


def _has_derivatives(torque: Callable) -> bool:
    """Whether a law's derivatives over arguments and parameters are those of central differences."""
    point = np.concatenate([ARGUMENTS, PARAMETERS])
    stated = _law_at(torque, point)[1:]
    differences = np.array([(_law_at(torque, point + move)[0] - _law_at(torque, point - move)[0]) / (2.0 * STEP)
                            for move in STEP * np.eye(len(point))])
    return bool(np.allclose(stated, differences, rtol=TOLERANCE, atol=TOLERANCE))


def _law_at(torque: Callable, point: np.ndarray) -> np.ndarray:
    out = np.zeros(1 + len(point))
    torque(*point[:2], TIME, SIDE, point[2:, None], out)
    return out
