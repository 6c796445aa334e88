"""Measured rows to a smooth curve: noise, exact rows, and drift."""

from math import comb, factorial
from typing import NamedTuple

import numpy as np

from .measured_rows import ROWS, MeasuredRows


class SmoothingOptions(NamedTuple):
    """When rows are exact, noisy or smooth, and how smooth curves are found through them."""

    # Rows between which a spline runs, at most: each ends an integration step, and more would cost minutes and add no
    # digit.
    rows: int = 500
    means: int = 256  # of neighbouring rows from which smooth curves are found, by eigendecompositions, at most
    freedom: float = 0.8  # a curve with more degrees of freedom than this share of the rows follows them
    doubt: float = 0.05  # rows are noisy where curves that follow them have a smaller share of the probability
    rounding: float = 1e-9  # noise below this share of the range of force is rounding
    exact_share: float = 0.75  # rows are exact where this share of them lie on polynomials through their neighbours
    exact_orders: tuple[int, ...] = (2, 4, 6)  # of polynomials through neighbours, one of which fits exact rows
    terms: int = 4  # of the polynomial part of smooth curves, and so the largest order of the processes beside it
    unresolved: int = 3  # amplitudes of processes, the last ones, that are at the limit of rounding
    small_noise: float = 1e-4  # as a share of the range of force
    smallest_weight: float = 1e-4  # of an amplitude that adds something
    least_variance: float = 1e-9  # of a change that adds something, as a share of the largest
    fewest_noisy: int = 12  # rows, below which noise and shape cannot be distinguished
    nodes_per_freedom: int = 2  # of a smoothed curve
    nodes: tuple[int, int] = (16, 128)  # bounds of their number in a smoothed curve
    places_per_node: int = 8  # from which the slopes of a smoothed curve follow
    # Bounds of the number of places at which the spread of curves is computed, twice that of their nodes.
    places: tuple[int, int] = (48, 200)


SMOOTHING = SmoothingOptions()
EXACT_NOTE = "noise not known, rows smooth to rounding"
# The variances of the processes beside the polynomial part of smooth curves over that of the noise.
AMPLITUDES = np.geomspace(1e-2, 1e14, 81)


class SmoothCurve(NamedTuple):
    """A smooth curve through rows: forces (n,) at ascending extensions (n,), and the effect of noise on them.

    slopes, curvatures : (n,), of the curve; None where it is the spline through the forces
    places, changes : (p,) and (k, p), independent changes of the forces at places by one standard deviation each; none
        where the noise is not known
    deviations : (n,) of the forces for noise of unit standard deviation in each row, where the noise may be none; else
        None
    note : what was done to the rows, in words
    """

    extensions: np.ndarray
    forces: np.ndarray
    slopes: np.ndarray | None
    curvatures: np.ndarray | None
    places: np.ndarray
    changes: np.ndarray
    deviations: np.ndarray | None
    note: str


def curve_of(rows: MeasuredRows, noise: float | None) -> SmoothCurve:
    """The curve through rows: the rows themselves, or the mean of smooth curves near them.

    noise : standard deviation of a row's force; None to estimate it, 0 for exact rows
    """
    if rows.spare < ROWS.fewest:  # a few repeated rows show no noise, but may be an outlier
        rows = rows._replace(squares=0.0, spare=0)
    if noise == 0:
        return _through(rows)
    count, exact = len(rows.extensions) + rows.spare, SMOOTHING.rounding * np.ptp(rows.forces)
    if noise is None and count < SMOOTHING.fewest_noisy:
        # What the law may do between few rows is uncertain, whatever their noise is.
        few = None if _are_exact(rows, exact) else SmoothCurves(rows, None)
        return _through(rows, f"noise not known, {count} rows are too few", per_unit=True, curves=few)
    repeated = rows.squares > rows.spare * exact**2
    if noise is None and not repeated and _are_exact(rows, exact):
        return _through(rows, EXACT_NOTE, per_unit=True)
    curves = SmoothCurves(rows, noise)
    if noise is None and (curves.sigma < exact or curves.unresolved > 0.5):
        return _through(rows, EXACT_NOTE, per_unit=True)
    if noise is None and not repeated and curves.interpolating > SMOOTHING.doubt:
        note = f"noise not distinguishable from the law, {curves.sigma:.2g} or less"
        if (
            count > SMOOTHING.means
        ):  # the means of neighbouring rows have less of the noise than rows of which some are left out
            return curves.mean(f"{rows.weights.sum():.0f} rows smoothed, {note}")
        return _through(rows, note, per_unit=True, curves=curves)
    known = "estimated" if noise is None else "stated"
    return curves.mean(f"{rows.weights.sum():.0f} rows smoothed, noise {curves.sigma:.3g} {known}")


def with_drifts(curve: SmoothCurve, r: np.ndarray, drifts: np.ndarray) -> SmoothCurve:
    """A curve whose changes have drifts (k, n) at extensions (n,) too."""
    more = [np.interp(curve.places, r, drift) for drift in drifts]
    return curve._replace(changes=np.vstack([curve.changes, *more]))


def _through(
    rows: MeasuredRows, note: str = "", per_unit: bool = False, curves: "SmoothCurves | None" = None
) -> SmoothCurve:
    """The curve through the rows themselves, of too many through some of them."""
    count = len(rows.extensions)
    chosen = np.linspace(0, count - 1, min(count, SMOOTHING.rows)).round().astype(int)
    r, force = rows.extensions[chosen], rows.forces[chosen]
    few = f"{SMOOTHING.rows} of {count} rows" if count > SMOOTHING.rows else ""
    note = ", ".join(filter(None, (few, note)))
    places, changes = (r, np.zeros((0, len(r)))) if curves is None else curves.changes(r, force)
    return SmoothCurve(
        r, force, None, None, places, changes, 1 / np.sqrt(rows.weights[chosen]) if per_unit else None, note
    )


def _are_exact(rows: MeasuredRows, exact: float) -> bool:
    """Whether most rows lie on polynomials through their neighbours up to rounding, of low order where a law has
    kinks: the pseudo-residuals of Gasser, Sroka and Jennen-Steinmetz (1986), whose deviation is that of a row."""
    r, count = rows.extensions / np.ptp(rows.extensions), len(rows.extensions)
    for order in (each for each in SMOOTHING.exact_orders if each < count):
        first = np.unique(np.linspace(0, count - order - 1, SMOOTHING.rows).astype(int))
        windows = first[:, None] + np.arange(order + 1)
        weights = 1 / (r[windows][:, :, None] - r[windows][:, None, :] + np.eye(order + 1)).prod(2)
        sums = (weights * rows.forces[windows]).sum(1)
        if np.quantile(np.abs(sums) / np.linalg.norm(weights, axis=1), SMOOTHING.exact_share) < exact:
            return True
    return False


class SmoothCurves:
    """The distribution of the smooth curves near rows: a law is a polynomial of low degree and an integrated Wiener
    process, of several orders and amplitudes (Wahba 1978, 1985).

    The mean for one order m and amplitude is the smoothing spline of degree 2 m - 1. Orders and amplitudes have the
    weights of their restricted likelihood, which are those of the rows' deviations from all polynomials; amplitudes are
    uniform in their logarithm. So the spread of the curves includes the noise, the law's change between and next to the
    rows, and the choice of the penalty.

    sigma : root of the mean square of a row's noise, or what was stated
    interpolating : weight of the curves that follow the rows and leave them no noise
    unresolved : weight of the largest amplitudes that numbers have room for
    freedom : mean degrees of freedom
    """

    def __init__(self, rows: MeasuredRows, noise: float | None):
        r, w = rows.extensions, rows.weights
        starts = np.unique(np.linspace(0, len(r), min(len(r), SMOOTHING.means), endpoint=False).astype(int))
        weights = np.add.reduceat(w, starts)
        x, y = np.add.reduceat(w * r, starts) / weights, np.add.reduceat(w * rows.forces, starts) / weights
        self.low, self.length, self.count = r[0], np.ptp(r), len(x)
        self.ends, self.places, self.root, self.y = (r[0], r[-1]), self._share(x), np.sqrt(weights), y
        self.terms = min(SMOOTHING.terms, len(x) // 2)
        whitened = self.root[:, None] * self._polynomials(self.places)
        basis, triangle = np.linalg.qr(whitened, mode="complete")
        self.by_rows = np.linalg.solve(triangle[: self.terms], basis[:, : self.terms].T) * self.root  # of coefficients
        others = basis[:, self.terms :]
        freedom, logs, self.parts = len(x) - self.terms + rows.spare, [], []
        for order in range(2, self.terms + 1):
            among = _wiener(order, self.places, self.places)
            sizes, modes = np.linalg.eigh(others.T @ (among * np.outer(self.root, self.root)) @ others)
            modes, sizes = others @ modes, np.maximum(sizes, 0.0)
            z = modes.T @ (self.root * y)
            amplitudes = AMPLITUDES / sizes[-1]
            spreads = 1 + amplitudes[:, None] * sizes
            squares = (z**2 / spreads).sum(1) + rows.squares
            least = np.maximum(squares, np.finfo(float).tiny)  # rows on a polynomial leave nothing
            size = freedom * np.log(least) if noise is None else squares / noise**2
            logs.append(-0.5 * (np.log(spreads).sum(1) + size))
            variances = squares / max(freedom - 2, 1) if noise is None else np.full(len(squares), noise**2)
            if noise is None:  # the noise itself is uniform where it is small, its logarithm where it is large
                small, spread = SMOOTHING.small_noise * np.ptp(y), np.maximum(variances, np.finfo(float).tiny)
                logs[-1] -= np.log1p(small / np.sqrt(spread))
            self.parts.append((order, among, modes, z, amplitudes, spreads, variances))
        self.weights = np.exp(np.array(logs) - np.max(logs))
        self.weights /= self.weights.sum()
        freedoms = np.array([(1 - 1 / spreads).sum(1) + self.terms for *_, spreads, _ in self.parts])
        self.freedom = float((self.weights * freedoms).sum())
        self.interpolating = float(self.weights[freedoms > SMOOTHING.freedom * len(x)].sum())
        self.unresolved = float(self.weights[:, -SMOOTHING.unresolved :].sum())
        self.sigma = float(np.sqrt(sum(w @ part[-1] for w, part in zip(self.weights, self.parts, strict=True))))

    def mean(self, note: str) -> SmoothCurve:
        """The mean of the curves, at evenly spaced nodes where they are smooth, else at the rows."""
        from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import

        (low, high), slopes, curvatures = self.ends, None, None
        if self.freedom < SMOOTHING.freedom * self.count:
            count = int(np.clip(SMOOTHING.nodes_per_freedom * self.freedom, *SMOOTHING.nodes))
            fine = np.linspace(low, high, SMOOTHING.places_per_node * (count - 1) + 1)
            curve, nodes = CubicSpline(fine, self._means(fine)[0]), fine[:: SMOOTHING.places_per_node]
            forces, slopes, curvatures = (curve(nodes, order) for order in range(3))
        else:
            nodes = np.r_[low, self.low + self.length * self.places[1:-1], high]
            forces = self._means(nodes)[0]
        return SmoothCurve(nodes, forces, slopes, curvatures, *self.changes(nodes, forces), None, note)

    def changes(self, r: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (p,), and independent changes (k, p) there, each by one standard deviation, of the curves from that
        through forces (n,) at extensions (n,)."""
        from scipy.interpolate import CubicSpline  # only a table needs it, and it takes half a second to import

        places = np.linspace(*self.ends, int(np.clip(2 * len(r), *SMOOTHING.places)))
        mean, covariance = self._means(places, True)
        away = mean - CubicSpline(r, force)(places)
        sizes, modes = np.linalg.eigh(covariance + np.outer(away, away))
        large = sizes > SMOOTHING.least_variance * sizes[-1]
        return places, (modes[:, large] * np.sqrt(sizes[large])).T

    def _means(self, r: np.ndarray, spread: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """The mean (n,) of the curves at extensions (n,), and their covariance (n, n) where the `spread` is wanted."""
        s = self._share(r)
        fit = self._polynomials(s) @ self.by_rows  # (n, rows), the polynomial of least squares
        base, total, covariance = fit @ self.y, np.zeros(len(r)), np.zeros((len(r), len(r)))
        noise_of_fit = (fit / self.root) @ (fit / self.root).T
        for weights, (order, among, modes, z, amplitudes, spreads, variances) in zip(
            self.weights, self.parts, strict=True
        ):
            used = weights > SMOOTHING.smallest_weight
            if not used.any():
                continue
            across = _wiener(order, s, self.places)
            loads = ((across - fit @ among) * self.root) @ modes
            own, sizes, spreads = weights[used], amplitudes[used], spreads[used]
            means = base + (sizes[:, None] * z / spreads) @ loads.T
            total += own @ means
            if spread:
                variance = own * variances[used]
                free = _wiener(order, s, s) - fit @ across.T - across @ fit.T + fit @ among @ fit.T
                covariance += (variance @ sizes) * free + variance.sum() * noise_of_fit + (means.T * own) @ means
                covariance -= (loads * (variance * sizes**2 @ (1 / spreads))) @ loads.T
        share = self.weights[self.weights > SMOOTHING.smallest_weight].sum()
        return total / share, covariance / share - np.outer(total, total) / share**2

    def _share(self, r: np.ndarray) -> np.ndarray:
        return (r - self.low) / self.length

    def _polynomials(self, s: np.ndarray) -> np.ndarray:
        return np.polynomial.legendre.legvander(2 * s - 1, self.terms - 1)


def _wiener(order: int, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The covariance (n, m) of a Wiener process integrated `order` - 1 times, at times (n,) and (m,) from 0 on."""
    first, apart, total = np.minimum(s[:, None], t), np.abs(s[:, None] - t), np.zeros((len(s), len(t)))
    # The sum over j of comb(order - 1, j) apart**(order - 1 - j) first**(order + j)/(order + j), by Horner's rule.
    power = np.ones_like(first)
    for j in range(order):
        total = total * apart + comb(order - 1, j) / (order + j) * power
        power = power * first
    return total * first**order / factorial(order - 1) ** 2
