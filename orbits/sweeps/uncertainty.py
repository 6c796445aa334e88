"""The uncertainty of the quantities of an orbit that follows from uncertain parameters of the machine."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..design.sensitivities import sensitivities
from ..errors import InputError, whole_number
from ..model.machine import Machine
from ..periodic.find import find
from ..result import Axes, Result
from .designs import members_of
from .sweep import sweep as swept
from .sweep_result import QUANTILES, Sweep


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Result, what="uncertainty", in_line=("share", "mean"), printed_digits=6):
    """The spread of the quantities of a machine's orbit due to its uncertain parameters.

    mean, deviation, quantiles : by quantity, over the members whose orbit is a motion; the quantiles by share, as "5%"
    linear : the standard deviation by quantity to first order, from exact sensitivities
    share : of the members whose orbit is a motion
    sweep : the members
    """

    mean: Mapping[str, float]
    deviation: Mapping[str, float]
    quantiles: Mapping[str, Mapping[str, float]]
    linear: Mapping[str, float]
    share: float
    sweep: Sweep

    machine = property(lambda self: self.sweep.machine)

    def title(self) -> str:
        return f"{self.share:.1%} of {len(self.sweep)} members are motions"

    def table(self) -> dict[str, list[Any]]:
        """The quantities, each with its mean, deviation, linear deviation, quantiles and unit, as columns."""
        columns: dict[str, list[object]] = {"quantity": list(self.mean)}
        columns |= {name: [getattr(self, name)[each] for each in self.mean] for name in ("mean", "deviation", "linear")}
        columns |= {f"{share:.0%}": [self.quantiles[each][f"{share:.0%}"] for each in self.mean] for share in QUANTILES}
        return {**columns, "unit": [*map(self.sweep.unit_of, self.mean)]}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the first quantity of the members over the parameters; returns the axes."""
        return self.sweep.plot(axes=axes)


def uncertainty(
    machine: Machine, over: Mapping[str, object], quantities: Sequence[str] = (), *, family: int = 1,
    samples: int = 1024, seed: int = 0, **options: Any,
) -> Uncertainty:  # fmt: skip
    """The spread of the quantities of an orbit when parameters are known only by their distributions.

    machine : as in `sweep`
    over : frozen distributions of `scipy.stats` (or ranges) by name; the parameters vary independently
    quantities : besides alpha and flight_time, as in `sweep`
    family, seed : as in `sweep`
    samples : number of members, sampled by Sobol's sequence
    options : `executor`, `workers`, `client`, `store`, `progress` of `sweep`

    The linear deviation is taken at the machine itself, with the standard deviations of the distributions. Raises
    `NoOrbit` where the machine itself has no such orbit.

    >>> from scipy.stats import norm
    >>> from orbits import uncertainty
    >>> from problems import Hopper
    >>> spread = uncertainty(Hopper("cubic", rest_length=9.0), {"beta": norm(0.3, 0.01)}, samples=64)
    >>> round(spread.deviation["alpha"], 4), round(spread.linear["alpha"], 4)
    (0.0143, 0.0143)
    """
    whole_number("samples", samples, "members", least=2)
    members = members_of(over, samples, "sobol", seed, list(machine.values))
    orbit, texts = find(machine, family), ["alpha", "flight_time", *quantities]
    slopes = sensitivities(machine, orbit, list(over), texts)
    deviations = {
        name: float(axis.distribution.std()) if axis.distribution is not None else float(np.std(axis.at(_MIDDLES)))
        for name, axis in zip(members.names, members.axes, strict=True)
    }
    result = swept(machine, over, samples, sampling="sobol", seed=seed, family=family, quantities=quantities, **options)
    motions = result["status"] == "certified"
    columns = {text: result[text][motions & np.isfinite(result[text])] for text in texts}
    if empty := [text for text, values in columns.items() if len(values) < 2]:
        raise InputError(f"fewer than two members have '{empty[0]}': the distributions reach where there is no hop")
    quantiles = {
        text: {f"{share:.0%}": float(np.quantile(values, share)) for share in QUANTILES}
        for text, values in columns.items()
    }
    linear = {
        text: float(np.sqrt(sum((slopes[text][name] * deviation) ** 2 for name, deviation in deviations.items())))
        for text in texts
    }
    mean = {text: float(values.mean()) for text, values in columns.items()}
    deviation = {text: float(values.std(ddof=1)) for text, values in columns.items()}
    return Uncertainty(mean, deviation, quantiles, linear, float(motions.mean()), result)


# Midpoints of equal shares, at which the deviation of a range or a list is computed.
_MIDDLES = (np.arange(10_000) + 0.5) / 10_000
