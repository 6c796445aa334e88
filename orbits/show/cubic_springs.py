"""Forces as sums of cubics, each on one side of a place: the springs that MuJoCo and the module for Drake have."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..laws import Law, symbols_of
from ..running import exclusive


class CubicOptions(NamedTuple):
    """How close cubics come to a law."""

    same_force: float = 1e-7  # errors below this, over the largest force, need no further cubic
    rounding: float = 1e-14  # smaller differences are rounding, over the largest force
    most: int = 256  # cubics of one law
    samples: int = 33  # of a law on each cubic, at which its error is measured
    beyond: float = 0.05  # share of the range of a motion that is added at both ends


CUBICS = CubicOptions()
# Chebyshev-Lobatto points of a unit interval, through which a cubic goes: it ends where the next one begins.
NODES = np.array([0.0, 0.25, 0.75, 1.0])
THROUGH_NODES = np.linalg.inv(np.vander(NODES, increasing=True))
SHARES = np.linspace(0.0, 1.0, CUBICS.samples)


class Cubic(NamedTuple):
    """A force that is a cubic on one side of a place, or on both, and 0 on the other.

    place : where the force is 0
    coefficients : (3,) of the powers 1 to 3 of the distance from the place
    side : 1 for above the place, -1 for below it, 0 for both
    """

    place: float
    coefficients: tuple[float, float, float]
    side: int = 0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The force (k,) at places (k,)."""
        a, b, c = self.coefficients
        d = x - self.place
        return np.where(self.side * d < 0, 0.0, d * (a + d * (b + d * c)))


class CubicSum(NamedTuple):
    """Cubics whose sum is a law between two places.

    error : the largest difference from the law there, over the largest force; 0 for a cubic law
    """

    cubics: list[Cubic]
    low: float
    high: float
    error: float

    @property
    def words(self) -> str:
        """What differs from the law; empty for a cubic one."""
        if not self.error:
            return ""
        count = f"{len(self.cubics)} cubics" if len(self.cubics) > 1 else "a cubic"
        return f"{count} from {self.low:.6g} to {self.high:.6g}, with an error of {self.error:.1e} of the largest force"


def cubic_sum(law: Law, low: float, high: float) -> CubicSum | None:
    """The sum for a law on the range of a motion; None for a law that jumps, or that has no value there."""
    ends = _widened(law, low, high)
    if ends is None or (law.pieces and law.pieces.jumps):
        return None
    low, high = ends
    x = np.linspace(low, high, CUBICS.samples)
    largest = abs(law(x)).max() or 1.0
    whole = None if law.pieces else _taylor(law)
    if whole is not None and abs(np.polyval(whole[::-1], x) - law(x)).max() <= CUBICS.rounding * largest:
        return CubicSum(_whole(whole, 0.0, law.rest()), low, high, 0.0)
    edges, rows = _pieces(law, low, high)
    cubics = _assembled(edges, rows, min(max(law.rest(), low), high), CUBICS.rounding * largest)
    x = _between(edges, SHARES).ravel()
    error = abs(sum((each(x) for each in cubics), np.zeros(x.shape)) - law(x)).max() / largest
    return CubicSum(cubics, low, high, float(error) if error > CUBICS.rounding * len(edges) else 0.0)


def _widened(law: Law, low: float, high: float) -> tuple[float, float] | None:
    """The range with a margin, as far as the law has values there."""
    margin = CUBICS.beyond * (high - low or abs(low) or 1.0)
    bounds = law.range()
    for wide in ((low - margin, high + margin), (low, high)):
        ends = max(wide[0], bounds[0]), min(wide[1], bounds[1])
        if ends[0] < ends[1] and np.isfinite(law(np.linspace(*ends, CUBICS.samples))).all():
            return ends
    return None


@exclusive
def _taylor(law: Law) -> np.ndarray | None:
    """The coefficients (4,) of the powers 0 to 3 of a smooth law at 0; None where it has none."""
    x, p = symbols_of(law.variable, law.key.names)
    terms = [ca.SX(law.expression(x, p, []))]
    for order in (1, 2, 3):
        terms.append(ca.jacobian(terms[-1], x) / order)
    found = ca.Function("taylor", [x, *p.values()], [ca.densify(ca.vertcat(*terms))])(0.0, *law.parameters.values())
    return row if np.isfinite(row := found.full().ravel()).all() else None


def _between(edges: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Places (n, k) at shares (k,) of the ways between n + 1 edges."""
    return np.minimum(edges[:-1, None] + np.diff(edges)[:, None] * shares, edges[1:, None])


def _through(law: Law, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubics (n, 4) of the distances from their lower edges, and their largest differences (n,) from the law."""
    rows = law(_between(edges, NODES)) @ THROUGH_NODES.T
    differences = rows @ np.vander(SHARES, 4, increasing=True).T - law(_between(edges, SHARES))
    return rows / np.diff(edges)[:, None] ** np.arange(4), abs(differences).max(1)


def _pieces(law: Law, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Edges (n + 1,) and cubics (n, 4) between them: the one with the largest error is halved until all are close."""
    breaks = np.empty(0)
    if law.pieces:
        breaks = np.array(law.pieces.ends(np.array(law.pieces.table(law.parameters)[0], dtype=float), law.parameters))
    edges = np.unique([low, *breaks[(low < breaks) & (breaks < high)], high])
    rows, errors = _through(law, edges)
    enough = CUBICS.same_force * abs(law(_between(edges, SHARES))).max()
    while errors.max() > enough and len(rows) < CUBICS.most:
        i = int(errors.argmax())
        halves = np.array([edges[i], (edges[i] + edges[i + 1]) / 2, edges[i + 1]])
        own, own_errors = _through(law, halves)
        edges = np.insert(edges, i + 1, halves[1])
        rows = np.vstack([rows[:i], own, rows[i + 1 :]])
        errors = np.concatenate([errors[:i], own_errors, errors[i + 1 :]])
    return edges, rows


def _shifted(row: np.ndarray, by: float) -> np.ndarray:
    """The polynomial (4,) of x + by, of one of x."""
    a, b, c, d = row
    return np.array([a + by * (b + by * (c + by * d)), b + by * (2 * c + 3 * by * d), c + 3 * by * d, d])


def _assembled(edges: np.ndarray, rows: np.ndarray, start: float, rounding: float) -> list[Cubic]:
    """The cubic at a place, and, at each edge above and below it, what the next one differs by."""
    widths = np.diff(edges)
    rows = np.where(abs(rows) * widths[:, None] ** np.arange(4) <= rounding, 0.0, rows)
    first = int(np.clip(np.searchsorted(edges, start, "right") - 1, 0, len(rows) - 1))
    found = _whole(rows[first], edges[first], start)
    for i in range(first + 1, len(rows)):
        found += _step(rows[i] - _shifted(rows[i - 1], widths[i - 1]), edges[i], 1, widths[i], rounding)
    for i in range(first, 0, -1):
        found += _step(_shifted(rows[i - 1], widths[i - 1]) - rows[i], edges[i], -1, widths[i - 1], rounding)
    return found


def _step(change: np.ndarray, place: float, side: int, width: float, rounding: float) -> list[Cubic]:
    """The change (4,), continuous, at one edge; none where it is rounding."""
    change = np.where(abs(change) * width ** np.arange(4) <= rounding, 0.0, change)[1:]
    return [Cubic(float(place), _three(change), side)] if change.any() else []


def _three(values: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return a, b, c


def _whole(row: np.ndarray, origin: float, start: float) -> list[Cubic]:
    """A polynomial (4,) about its root that is nearest to a place; one without roots is the sum of two, a spring of
    constant stiffness among them."""
    roots = np.roots(row[::-1])
    real = np.real(roots[abs(np.imag(roots)) <= CUBICS.rounding * (1 + abs(roots))]) + origin
    if len(real):
        place = float(real[abs(real - start).argmin()])
        return [Cubic(place, _three(_shifted(row, place - origin)[1:]))]
    value, slope, *others = _shifted(row, start - origin)
    pull = slope or abs(value)
    straight = [Cubic(start - value / pull, (float(pull), 0.0, 0.0))] if value else []
    rest = _three([slope - pull, *others])
    return [*straight, Cubic(start, rest)] if any(rest) else straight
