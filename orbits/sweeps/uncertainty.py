"""The uncertainty of the quantities of an orbit that follows from uncertain parameters of the machine."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..design import sensitivities
from ..errors import InputError, list_of_names, whole_number
from ..model import Machine, check_machine, free_parameters
from ..periodic import StartLike, find, start_or_own
from ..result import Axes, Result, shown
from .designs import members_of
from .sweep import sweep as swept
from .sweep_result import QUANTILES, Sweep


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Result, what="uncertainty", in_line=("share", "mean"), printed_digits=6):
    """The spread of the quantities of a machine's orbit due to its uncertain parameters.

    mean, deviation, quantiles : by quantity, over the members whose orbit is a motion; the quantiles by share, such as
        "5%"
    linear : the standard deviation by quantity to first order, from exact sensitivities
    share : of the members whose orbit is a motion
    sweep : the members
    violations : of the machine's own orbit, at which the linear deviation is taken; empty if it is a motion
    """

    mean: Mapping[str, float]
    deviation: Mapping[str, float]
    quantiles: Mapping[str, Mapping[str, float]]
    linear: Mapping[str, float]
    share: float
    sweep: Sweep
    violations: tuple[str, ...] = ()

    machine = property(lambda self: self.sweep.machine)

    def title(self) -> str:
        own = f"; the machine's own orbit is inadmissible: {', '.join(self.violations)}" if self.violations else ""
        return f"{self.share:.1%} of {len(self.sweep)} members are motions{own}"

    def table(self) -> dict[str, list[Any]]:
        """The quantities, each with its mean, deviation, linear deviation, quantiles and unit, as columns."""
        columns: dict[str, list[object]] = {"quantity": list(self.mean)}
        columns |= {name: [getattr(self, name)[each] for each in self.mean] for name in ("mean", "deviation", "linear")}
        columns |= {f"{share:.0%}": [self.quantiles[each][f"{share:.0%}"] for each in self.mean] for share in QUANTILES}
        return {**columns, "unit": [*map(self.sweep.unit_of, self.mean)]}

    def plot(self, quantity: str | None = None, axes: Axes | None = None) -> Axes:
        """Plot the distribution of a quantity over the members, the first one if None, with the normal distribution of
        the linear deviation; returns the axes. `sweep.plot()` draws the members over the parameters."""
        return shown("shares").plot_uncertainty(self, quantity, axes)


def uncertainty(
    machine: Machine, over: Any, quantities: str | Sequence[str] = (), *, family: int = 1,
    start: StartLike | None = None, samples: int = 1024, seed: int = 0, **options: Any,
) -> Uncertainty:  # fmt: skip
    """The spread of the quantities of an orbit when only the distributions of some parameters are known.

    machine : as in `sweep`
    over : frozen distributions of `scipy.stats` (or ranges) by name, of parameters that vary independently; correlated
        parameters need a tuple of names and a frozen `multivariate_normal`. Or a result with such `distributions()`,
        for example of `springs.fit`
    quantities : in addition to alpha and flight_time, as in `sweep`
    family, start, seed : as in `sweep`
    samples : number of members, sampled by Sobol's sequence
    options : `executor`, `workers`, `client`, `store`, `progress` of `sweep`

    The linear deviation is taken at the machine itself, with the standard deviations of the distributions; if the
    machine's own orbit is inadmissible, the first line says so. Raises `NoOrbit` if the machine itself has no such
    orbit.

    >>> from scipy.stats import norm
    >>> from orbits import uncertainty
    >>> from problems import Hopper
    >>> spread = uncertainty(Hopper("cubic", rest_length=9.0), {"beta": norm(0.3, 0.01)}, samples=64)
    >>> round(spread.deviation["alpha"], 4), round(spread.linear["alpha"], 4)
    (0.0143, 0.0143)
    """
    check_machine(machine, "with_values")
    whole_number("samples", samples, "members", least=2)
    over = over.distributions() if hasattr(over, "distributions") else over
    uncertain = _uncertain(over, samples, seed, machine)
    start = start_or_own(machine, start, family)
    orbit = find(machine, family) if start is None else find(machine, start=start)
    quantities = list_of_names("quantities", quantities)
    texts = [*dict.fromkeys(("alpha", "flight_time", *quantities))]
    slopes = sensitivities(machine, orbit, list(uncertain.names), texts)
    options |= {"seed": seed, "family": family, "quantities": quantities, "start": None if start is None else orbit}
    if uncertain.correlated:
        result = swept(machine, None, dict(zip(uncertain.names, uncertain.values.T, strict=True)), **options)
    else:
        result = swept(machine, over, samples, sampling="sobol", **options)
    motions = result["status"] == "certified"
    columns = {text: result[text][motions & np.isfinite(result[text])] for text in texts}
    if empty := [text for text, values in columns.items() if len(values) < 2]:
        why = f"the machine's own orbit is inadmissible: {', '.join(orbit.violations)}" if orbit.violations else ""
        why = why or "the distributions reach machines without a hop"
        raise InputError(f"fewer than two members are motions with '{empty[0]}': {why}")
    quantiles = {
        text: {f"{share:.0%}": float(np.quantile(values, share)) for share in QUANTILES}
        for text, values in columns.items()
    }
    rows = {text: np.array([slopes[text][name] for name in uncertain.names]) for text in texts}
    linear = {text: float(np.sqrt(row @ uncertain.covariance @ row)) for text, row in rows.items()}
    mean = {text: float(values.mean()) for text, values in columns.items()}
    deviation = {text: float(values.std(ddof=1)) for text, values in columns.items()}
    return Uncertainty(mean, deviation, quantiles, linear, float(motions.mean()), result, orbit.violations)


class _Uncertain(NamedTuple):
    """Uncertain parameters (k,) with their covariance (k, k), and a Sobol sample (m, k) of them."""

    names: tuple[str, ...]
    covariance: np.ndarray
    values: np.ndarray
    correlated: bool


def _uncertain(over: Any, samples: int, seed: int, machine: Machine) -> _Uncertain:
    """The parameters that the mapping `over` states; raises `InputError` where it states them wrongly."""
    groups = {key: each for key, each in over.items() if isinstance(key, tuple)} if isinstance(over, Mapping) else {}
    for key, each in groups.items():
        if not hasattr(each, "cov") or np.shape(each.mean) != (len(key),):
            raise InputError(f"over {key}: correlated parameters need a multivariate_normal of {len(key)} numbers")
    if groups:
        from scipy.stats import norm  # slow to import

        names = [name for key in over for name in (key if key in groups else (key,))]
        if len({*names}) < len(names):
            raise InputError(f"over: a parameter is named twice among {', '.join(map(str, names))}")
        over = {name: over.get(name, norm()) for name in names}
    members = members_of(over, samples, "sobol", seed, free_parameters(machine), machine)
    deviations = [
        float(axis.distribution.std()) if axis.distribution is not None else float(np.std(axis.at(_MIDDLES)))
        for axis in members.axes
    ]
    covariance, values = np.diag(np.square(deviations)), members.values.copy()
    for key, each in groups.items():
        places = [members.names.index(name) for name in key]
        sizes, axes = np.linalg.eigh(each.cov)
        covariance[np.ix_(places, places)] = each.cov
        values[:, places] = each.mean + values[:, places] @ (axes * np.sqrt(np.maximum(sizes, 0.0))).T
    return _Uncertain(members.names, covariance, values, bool(groups))


# Midpoints of equal shares, at which the deviation of a range or a list is computed.
_MIDDLES = (np.arange(10_000) + 0.5) / 10_000
