"""Relations between a machine and its statement, and the tolerances of these relations."""

from dataclasses import dataclass

import numpy as np

from ..laws import Algebraic


@dataclass(frozen=True)
class CheckOptions:
    """The numbers of `check`.

    exact : what is exact holds to this share of its terms: rounding is far below, a mistake far above
    tolerance, same_motion : motions are integrated again with this relative tolerance, and agree to `same_motion`,
        since a motion amplifies errors, and laws may have corners
    moments : of such a motion, an odd number, so that one is its middle
    spreads : states lie this far about rest, in sizes of an orbit; the nearest are for laws with a small range
    states : with each spread
    beside : hops begin at this multiple of an orbit's launch speed, or state, so that they lose energy
    difference : step of a difference, as a share: of the fourth order its error and its rounding are about 1e-12
    launch : the launch speed of a hop of a machine without an orbit
    hops, impacts : how many of them are followed, and the most impacts in each: a machine that rattles has
        some 80 before it stays in contact, and one that rolls down a slope has no last one
    """

    exact: float = 1e-8
    tolerance: float = 1e-11
    same_motion: float = 1e-6
    moments: int = 41
    spreads: tuple[float, ...] = (1.0, 0.3, 0.1, 0.01)
    states: int = 6
    beside: float = 1.05
    difference: float = 1e-3
    launch: float = 2.0
    hops: int = 2
    impacts: int = 100


OPTIONS = CheckOptions()


@dataclass(frozen=True)
class Relation:
    """A relation between a machine and its statement: in words, and by which share it does not hold."""

    words: str
    deviation: float
    bound: float = OPTIONS.exact

    @property
    def holds(self) -> bool:
        """Whether the deviation is rounding."""
        return self.deviation <= self.bound


def share(residual: Algebraic, *magnitudes: Algebraic) -> float:
    """The largest residual as a share of the largest of the magnitudes; infinite where one is not a number."""
    largest = float(np.max(np.abs(residual), initial=0.0))
    size = max((float(np.max(np.abs(each), initial=0.0)) for each in magnitudes), default=1.0)
    if largest == 0:
        return 0.0
    return largest / size if np.isfinite(largest) and np.isfinite(size) and size > 0 else np.inf


def share_of_each(residual: np.ndarray, sizes: np.ndarray) -> float:
    """The largest residual (N, n) as a share of the largest size in its column: columns have different units."""
    return max(share(*each) for each in zip(residual.T, sizes.T, strict=True))
