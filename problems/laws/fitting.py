"""The parameters of a formula fitted to measured force against extension."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from orbits.errors import InputError
from orbits.laws import Law, law_statement as laws, number
from orbits.result import Axes, Result, Row, shown
from orbits.running import exclusive
from orbits.symbolic import MappedFunction, parse

if TYPE_CHECKING:
    from ..recordings import BenchRecord, MeasuredRows


class FitOptions(NamedTuple):
    """The search for the parameters of a formula, and when it does not fit."""

    # Parameters are not determined apart where their changes of the rows are parallel but for this share.
    same_direction: float = 1e-10
    starts: int = 200  # of a formula that is not linear in its parameters
    size: float = 3.0  # of random starts, as powers of 10
    own_size: float = 0.5  # of starts about values that the user has stated, as powers of 10
    best: int = 6  # starts that are continued
    tolerance: float = 1e-15  # relative to which they are continued
    outside: float = 1e3  # residuals where a formula is not finite, as a multiple of those of the start
    overflow: float = 1e100  # residuals from which no search begins, since the sum of squares would overflow
    # A parameter is not determined where this multiple of it fits the rows as well, within this number of the standard
    # deviations of a row.
    farther: float = 1e3
    as_well: float = 2.0
    # Standard errors of the logarithm of their ratio by which the residuals of a formula that does not fit exceed the
    # noise.
    lack_significance: float = 4.0
    lack_factor: float = 1.2  # by which the residuals of a formula that does not fit exceed the noise at least


FITS = FitOptions()


@dataclass(frozen=True, eq=False, repr=False)
class SpringFit(Result, what="spring fit", in_line=("formula", "parameters", "noise"), printed_digits=8):
    """A formula fitted to the rows of a measured spring.

    formula : the force as a formula of the extension r
    parameters : the values of its other names
    covariance : (k, k), of the parameters in their order
    extensions, forces : (n,), the rows, means of those at the same extension
    weights : (n,), of how many rows each is the mean
    residuals : (n,), forces less those of the formula
    noise : the standard deviation of a row's force from which the covariance follows: the stated one, else that of the
        residuals
    lack : why the formula does not fit, in words; "" where nothing says so
    source_name : of the table
    in_si : whether the numbers are in m and N
    """

    formula: str
    parameters: Mapping[str, float]
    covariance: np.ndarray
    extensions: np.ndarray
    forces: np.ndarray
    weights: np.ndarray
    residuals: np.ndarray
    noise: float
    lack: str
    source_name: str
    in_si: bool

    machine = property(lambda self: {})

    @cached_property
    def law(self) -> Law:
        """The formula with these parameters, as a spring like any other."""
        return replace(laws.from_formula(self.formula, "r", self.parameters), in_si=self.in_si or None)

    @property
    def deviations(self) -> dict[str, float]:
        """The standard deviations of the parameters."""
        return dict(zip(self.parameters, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def distributions(self) -> dict[tuple[str, ...], Any]:
        """The joint normal distribution of the parameters, as `uncertainty` takes it, together with others in
        ``{**fit.distributions(), "mass_ratio": norm(0.5, 0.01)}``."""
        from scipy.stats import multivariate_normal  # slow to import

        mean = np.array([*self.parameters.values()])
        return {tuple(self.parameters): multivariate_normal(mean, self.covariance, allow_singular=True)}

    @property
    def units(self) -> Mapping[str, str]:
        """The units of the columns and of the noise; empty unless in SI. Those of the parameters follow from it."""
        own = {"extension": "m", **dict.fromkeys(("force", "fitted", "residual", "noise"), "N")}
        return own if self.in_si else {}

    def title(self) -> str:
        return f"{self.formula} fitted to {self.weights.sum():.0f} rows of {self.source_name}"

    def table(self) -> dict[str, np.ndarray]:
        """The rows as columns: extension, force, what the formula says, and the difference."""
        fitted = self.forces - self.residuals
        return {"extension": self.extensions, "force": self.forces, "fitted": fitted, "residual": self.residuals}

    def heads(self) -> list[str]:
        return []

    def _rows(self) -> list[Row]:
        after = "{}   +- {:.2g} (one standard deviation)"
        found = [Row(n, {n: v, f"deviation of {n}": self.deviations[n]}, (after,)) for n, v in self.parameters.items()]
        noise = Row.of("noise", self.noise, self.unit_of("noise"), " (one standard deviation of a row)")
        largest = Row.of("largest residual", float(np.abs(self.residuals).max()), self.unit_of("residual"))
        return [*found, noise, largest]

    def _notes(self) -> list[str]:
        return [self.lack] if self.lack else []

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the rows and the formula; returns the axes."""
        style, canvas = shown("style"), shown("canvas")
        axes = canvas.axes_or_new(axes)
        r = np.linspace(self.extensions[0], self.extensions[-1], 400)
        axes.plot(self.extensions, self.forces, ".", label="measured")
        axes.plot(r, self.law(r), label=style.label_of(self.formula))
        canvas.entitled(axes, ", ".join(style.value_of(n, v, self.unit_of(n)) for n, v in self.parameters.items()))
        labels = {
            side: style.label_of(n, self.unit_of(n)) for side, n in (("xlabel", "extension"), ("ylabel", "force"))
        }
        return canvas.finished(axes, **labels)


def fit(
    table: Any,
    formula: str | Law,
    start: Mapping[str, float] | None = None,
    *,
    in_si: bool = False,
    columns: Sequence[str | int] | None = None,
    units: Sequence[str] | None = None,
    cycle: int | str | None = None,
    branch: str | None = None,
    noise: float | ArrayLike | None = None,
) -> SpringFit:
    """The parameters of a spring's formula by weighted least squares to measured rows.

    table, in_si, columns, units, cycle, branch : as in `springs.table`
    formula : the force as a formula of the extension r, every other name in it a parameter; or a law from a formula,
        such as `springs.air()`, whose parameters are the start
    start : values of some parameters near which to search; not needed where the formula is linear in its parameters.
        A parameter with a start, whose formula has no value where it is 0, keeps its sign
    noise : standard deviation of a row's force, in the law's unit, or (n,) that of each row; None to take it from the
        residuals. A row weighs by the inverse of its variance

    Returns a `SpringFit`, whose `law` is a spring like any other, and whose parameters, which are correlated, are those
    of `uncertainty(machine, fit)`. It says where the residuals are far larger than the noise of the rows. Raises
    `InputError` where the rows do not determine all parameters, as where a value a thousand times as large fits them as
    well, and where no start leads to a minimum.

    >>> r = [-2.0, -1.0, 0.0, 1.0, 2.0]
    >>> found = fit((r, [-4.4, -1.3, 0.0, 1.3, 4.4]), "k*r + b*r**3")
    >>> {name: round(value, 6) for name, value in found.parameters.items()}
    {'b': 0.3, 'k': 1.0}
    """
    from ..recordings import read_record

    text, own = _formula_of(formula)
    if not isinstance(start, Mapping | None):
        raise InputError(f"start = {start!r}; it must map names of parameters to values near them")
    names = sorted(parse(text).names - {"r"})
    own = own | dict(start or {})
    if unknown := [name for name in own if name not in names]:
        raise InputError(f"start: '{text}' has no parameter '{unknown[0]}'; it has {', '.join(names) or 'none'}")
    own = {name: number(name, value) for name, value in own.items()}
    if not names:
        raise InputError(f"'{text}' has no parameters to fit; name them, as in 'k*r + b*r**3'")
    record = read_record(table, in_si, columns, units)
    label = record.name
    rows, drifts, deviation, note = _weighted_rows(record, branch, cycle, noise)
    freedom = len(rows.extensions) + rows.spare - len(names)
    if freedom < (1 if deviation is None else 0):
        count = len(rows.extensions) + rows.spare
        raise InputError(f"{label}: {count} rows for {len(names)} parameters; more rows, or noise=, are needed")
    model = _Model(text, names, rows)
    values = model.linear() if model.are_linear.all() else model.nonlinear(own)
    residual, slopes = model.at(values)
    squares = float(residual @ residual) + rows.squares
    spread = np.sqrt(squares / freedom) if freedom else 0.0
    size = spread if deviation is None else deviation
    model.refuse_open(values, float(size))
    inverse = model.inverse(slopes)
    moved = -(drifts * np.sqrt(rows.weights)) @ slopes @ inverse  # the parameters by each drift
    named = ", ".join(filter(None, (record.columns, note)))
    return SpringFit(
        formula=text,
        parameters=dict(zip(names, values.tolist(), strict=True)),
        covariance=size**2 * inverse + moved.T @ moved,
        extensions=rows.extensions,
        forces=rows.forces,
        weights=rows.weights,
        residuals=residual / np.sqrt(rows.weights),
        noise=float(size),
        lack=_lack_of_fit(rows, spread, freedom, deviation),
        source_name=label + (f" ({named})" if named else ""),
        in_si=in_si,
    )


def _formula_of(formula: str | Law) -> tuple[str, dict[str, float]]:
    """The text of a formula, and the values of the parameters of a law."""
    if not isinstance(formula, Law):
        if not isinstance(formula, str):
            raise InputError(f"formula = {formula!r}; it must be text, such as 'k*r + b*r**3', or a law from a formula")
        return formula, {}
    written = formula.written
    if written is None or written.potential or written.rows or len(written.formulas) != 1:
        raise InputError(f"'{formula.text}' is not a formula of the force; state one, such as 'k*r + b*r**3'")
    return written.formulas[0], dict(formula.parameters)


def _weighted_rows(
    record: "BenchRecord", branch: str | None, cycle: int | str | None, noise: Any
) -> tuple["MeasuredRows", np.ndarray, float | None, str]:
    """The rows on a branch, what they drift, the standard deviation of one of weight 1 if it is stated, and which rows
    they are in words."""
    from ..recordings import MeasuredRows, choose

    try:
        stated = None if noise is None else np.asarray(noise, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"noise = {noise!r}; it must be a number, or one number for each row") from None
    if stated is None or stated.ndim == 0:
        if stated is not None and not number("noise", noise, high=1e100) > 0:
            raise InputError(f"noise = {noise:g}; it is the standard deviation of a row's force, above 0")
        chosen = choose(record, branch, cycle)
        return chosen.rows, chosen.drifts, None if stated is None else float(stated), chosen.note
    if branch is not None or cycle is not None:
        raise InputError("noise of each row is for tables without a branch or a cycle; state one number")
    r, force = record.extensions, record.forces
    if stated.shape != r.shape or not (np.isfinite(stated).all() and (stated > 0).all()):
        raise InputError(f"noise: {stated.size} numbers for {len(r)} rows; one above 0 is needed for each row")
    order = np.argsort(r, kind="stable")
    size = float(np.sqrt(1 / np.mean(stated**-2)))
    rows = MeasuredRows(r[order], force[order], (size / stated[order]) ** 2, 0.0, 0)
    return rows, np.zeros((0, len(r))), size, ""


class _Model:
    """Weighted residuals of a formula at measured rows, with their derivatives."""

    def __init__(self, text: str, names: Sequence[str], rows: "MeasuredRows"):
        self.names, self.rows, self.root = names, rows, np.sqrt(rows.weights)
        self.are_linear, self.function = _with_slopes(text, tuple(names))

    def at(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals (n,) and their derivatives (n, k), not finite where the formula is not."""
        r = self.rows.extensions[:, None]
        with np.errstate(all="ignore"):
            force, slopes = self.function(r, np.broadcast_to(values, (len(r), len(values))))
        return self.root * (self.rows.forces - force.ravel()), -self.root[:, None] * slopes[:, 0, :]

    def linear(self) -> np.ndarray:
        """The parameters (k,) of least squares of a formula that is linear in them."""
        self._check(self.at(np.zeros(len(self.names)))[1])
        values = self._with_best_factors(np.zeros(len(self.names)))
        assert values is not None  # since it is finite
        return values

    def nonlinear(self, own: Mapping[str, float]) -> np.ndarray:
        """The parameters (k,) of the lowest minimum from the starts."""
        found, starts = [], [values for values in map(self._with_best_factors, self._starts(own)) if values is not None]
        sizes = [float(np.linalg.norm(self.at(values)[0])) for values in starts]
        sides = self._sides(own)
        for i in np.argsort(sizes)[: FITS.best].tolist():
            values = self._minimum(starts[i], np.ones(len(self.names), dtype=bool), sides)
            found += [] if values is None else [values]
        if not found:
            raise InputError(f"no start leads to values of {', '.join(self.names)}: give start, values near them")
        values = min(found, key=self._squares)
        self._check(self.at(values)[1])
        return values

    def _minimum(self, start: np.ndarray, free: np.ndarray, sides: np.ndarray) -> np.ndarray | None:
        """The parameters (k,) at the minimum from a start (k,) over the free ones (k,), each on its side (k,) of
        0; None where formula or derivatives have no finite values."""
        from scipy.optimize import least_squares  # slow to import

        outside = FITS.outside * (1 + self._squares(start) ** 0.5)

        def whole(values: np.ndarray) -> np.ndarray:
            found = start.copy()
            found[free] = values
            return found

        def residual(values: np.ndarray) -> np.ndarray:
            residuals = self.at(whole(values))[0]
            return np.where(np.isfinite(residuals), np.clip(residuals, -outside, outside), outside)

        def slopes(values: np.ndarray) -> np.ndarray:
            return self.at(whole(values))[1][:, free]

        if not outside < FITS.overflow:
            return None
        bounds = np.where(sides > 0, 0.0, -np.inf)[free], np.where(sides < 0, 0.0, np.inf)[free]
        try:
            found = least_squares(
                residual, start[free], slopes, bounds, "trf", FITS.tolerance, FITS.tolerance, x_scale="jac"
            )
        except ValueError:  # the derivatives are not finite
            return None
        values = whole(found.x)
        return values if np.isfinite(self.at(values)[1]).all() else None

    def _squares(self, values: np.ndarray) -> float:
        """The sum of the squares of the residuals."""
        with np.errstate(all="ignore"):
            return float(np.square(self.at(values)[0]).sum())

    def _sides(self, own: Mapping[str, float]) -> np.ndarray:
        """The signs (k,) that parameters keep from their stated values, where the formula has no value as they are 0; 0
        for the others."""
        found = np.array([own.get(name, 1.0) for name in self.names])
        at_zero = (np.where(np.arange(len(found)) == i, 0.0, found) for i in range(len(found)))
        kept = [
            name in own and not np.isfinite(self.at(values)[0]).any()
            for name, values in zip(self.names, at_zero, strict=True)
        ]
        return np.sign(found) * kept

    def refuse_open(self, values: np.ndarray, deviation: float) -> None:
        """Raise `InputError` that names each parameter for which a far larger value fits the rows as well, with the
        best values of the others."""
        rounding = np.finfo(float).eps * float(np.linalg.norm(self.root * self.rows.forces))
        most = self._squares(values) + FITS.as_well**2 * max(deviation, rounding) ** 2
        covariance, found = self.inverse(self.at(values)[1]), dict[str, float]()
        for i in (~self.are_linear & (values != 0)).nonzero()[0].tolist():
            larger, free = FITS.farther * values[i], np.arange(len(values)) != i
            along = values + covariance[i] / covariance[i, i] * (larger - values[i])
            for start in (along, np.where(free, values, larger)):
                best = self._minimum(start, free, np.sign(values)) if free.any() else start
                if best is not None and self._squares(best) <= most:
                    found[self.names[i]] = float(larger)
        if found:
            name, larger = next(iter(found.items()))
            both = f"{name} = {larger / FITS.farther:.3g} and {larger:.3g} fit them equally well"
            remedy = f"give {'one of them' if len(found) > 1 else 'it'} a value in the formula, or fit another law"
            raise InputError(f"the rows do not determine {' and '.join(found)}: {both}; {remedy}")

    def _starts(self, own: Mapping[str, float]) -> np.ndarray:
        """Values (m, k) at which to start: the user's own, or 1, and random ones around these."""
        rng, k = np.random.default_rng(0), len(self.names)
        shape = FITS.starts, k
        starts = rng.choice([-1.0, 1.0, 1.0], shape) * 10 ** rng.uniform(-FITS.size, FITS.size, shape)
        for i, name in enumerate(self.names):
            if name in own:
                starts[:, i] = own[name] * np.abs(starts[:, i]) ** (FITS.own_size / FITS.size)
        starts[0] = [own.get(name, 1.0) for name in self.names]
        return starts

    def _with_best_factors(self, values: np.ndarray) -> np.ndarray | None:
        """A start with the best values of the linear parameters, None where the formula is not finite."""
        values = np.where(self.are_linear, 0.0, values)
        residual, slopes = self.at(values)
        slopes = slopes[:, self.are_linear]
        if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
            return None
        sizes = np.linalg.norm(slopes, axis=0)
        sizes[sizes == 0] = 1.0
        values[self.are_linear] = np.linalg.lstsq(-slopes / sizes, residual, rcond=None)[0] / sizes
        return values

    def inverse(self, slopes: np.ndarray) -> np.ndarray:
        """The covariance (k, k) of the parameters for noise of unit deviation."""
        sizes = np.linalg.norm(slopes, axis=0)
        triangle = np.linalg.inv(np.linalg.qr(slopes / sizes, mode="r"))
        return triangle @ triangle.T / np.outer(sizes, sizes)

    def _check(self, slopes: np.ndarray) -> None:
        """Raise `InputError` where the rows do not determine every parameter."""
        if not np.isfinite(slopes).all():
            raise InputError(
                "the formula is not finite at some of the rows: state one that is finite at every measured extension"
            )
        sizes = np.linalg.norm(slopes, axis=0)
        if not sizes.all():
            raise InputError(f"the rows do not depend on the parameter '{self.names[int(np.argmin(sizes))]}'")
        _, values, rows = np.linalg.svd(slopes / sizes, full_matrices=False)
        if values[-1] < FITS.same_direction * values[0]:
            together = [name for name, share in zip(self.names, rows[-1], strict=True) if abs(share) > 0.1]
            raise InputError(f"the rows do not distinguish {' and '.join(together)}: give one of them a value")


@exclusive
def _with_slopes(text: str, names: tuple[str, ...]) -> tuple[np.ndarray, Callable]:
    """The parameters (k,) in which together a formula is linear; (r, parameters) -> its values and their slopes."""
    r, p = ca.SX.sym("r"), ca.SX.sym("p", len(names))
    value = ca.SX(parse(text)(r=r, **dict(zip(names, ca.vertsplit(p), strict=True))))
    linear = list[int]()
    for i in range(len(names)):
        with_this = ca.vertcat(*(p[j] for j in [*linear, i]))
        if not any(ca.which_depends(value, with_this, 2, True)):
            linear.append(i)
    results = [ca.densify(value), ca.densify(ca.jacobian(value, p))]
    return np.isin(np.arange(len(names)), linear), MappedFunction(ca.Function("formula", [r, p], results))


def _lack_of_fit(rows: "MeasuredRows", spread: float, freedom: int, stated: float | None) -> str:
    """In words, where residuals of this spread and number of independent ones are far larger than the rows' noise."""
    from ..recordings import SMOOTHING, SmoothCurves

    noise, known, words = stated, np.inf, "the stated noise"
    if noise is None:
        count = len(rows.extensions) + rows.spare
        if count < SMOOTHING.fewest_noisy or freedom < 1:
            return ""
        curves = SmoothCurves(rows, None)
        noise, known, words = curves.sigma, max(count - curves.freedom, 1.0), "the noise of the rows"
    error = np.sqrt(0.5 / max(freedom, 1) + 0.5 / known)
    scale = max(float(noise), float(np.finfo(float).eps) * float(np.ptp(rows.forces)))
    if spread <= scale * max(FITS.lack_factor, np.exp(FITS.lack_significance * error)):
        return ""
    return (
        f"the formula does not fit: its residuals, {spread:.3g}, are {spread / scale:.2g} times {words}, {scale:.2g}; "
        "the deviations of the parameters do not have what it misses"
    )
