"""The periods to which launches settle, over two parameters: which period attracts where.

Each value of the machine's parameters has a map, which is resolved into polynomials; many launches are mapped together,
at all values of the injection. Launches outside of the polynomials' range, and in what they leave out, take the map
itself.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import InputError, finite_number, range_of, whole_number
from ..hops import CAP
from ..io import Document
from ..model import Machine, machine_in_words, title_of_machine
from ..result import Axes, Progress, Result, Row, shown, stored
from ..running import exclusive
from ..units import LIFTOFF_SPEED
from .diagram import RESERVED_IN_DIAGRAMS
from .launch_cycles import INJECT, RESTITUTION, MapsAlong, parameters_of_maps
from .return_map import ReturnMap, pieces_between
from .settling import CHAOTIC, HAS_PERIOD, OUT_OF_RANGE, PERIODS, UNSETTLED, SettlingMap, settled


@dataclass(frozen=True, eq=False, repr=False)
class PeriodDiagram(Result, what="diagram of periods", dimension="launch"):
    """The periods to which launches of return maps settle, over two parameters.

    along, second : names of the parameters
    machine : in words and numbers
    values, others : of the two parameters, (nx,) and (ny,), ascending
    starts : the initial launch speeds (k,)
    status : (ny, nx, k), what each settles to: "periodic", "outside" (periodic, with launches outside the range),
        "chaotic" (the slopes are above 1 on average), "longer" (neither chaotic nor of a period up to the longest: a
        longer period, or slow convergence that needs more hops), "leaves" (ever faster), or why there is no next
        launch: "rests" and other statuses of a hop
    periods : (ny, nx, k), 0 where there is none
    launches : (ny, nx, k), the largest launch speed of the cycle, or the last launch speed of other hops that continue;
        else NaN
    exponents : (ny, nx, k), the mean logarithm of the slopes where there is no period; else NaN
    longest, hops : the longest period that was tested, and the largest number of hops
    units : of launch speeds and parameters, by name; empty for a dimensionless machine
    """

    along: str
    second: str
    machine: Mapping[str, Any]
    values: np.ndarray
    others: np.ndarray
    starts: tuple[float, ...]
    status: np.ndarray
    periods: np.ndarray
    launches: np.ndarray
    exponents: np.ndarray
    longest: int
    hops: int
    units: Mapping[str, str] = field(default_factory=dict)

    def title(self) -> str:
        unit, other = (f" {self.unit_of(name)}".rstrip() for name in (self.along, self.second))
        (a, b), (c, d) = self.values[[0, -1]].tolist(), self.others[[0, -1]].tolist()
        ranges = f"{self.along} {a:g} to {b:g}{unit} and {self.second} {c:g} to {d:g}{other}"
        return f"periods of the hops of {title_of_machine(self.machine)}, {ranges}"

    def _line(self) -> dict[str, object]:
        return {"along": self.along, "second": self.second, "shape": self.status.shape, "longest": self.longest}

    def heads(self) -> list[str]:
        return ["", "launches", "share"]

    def _rows(self) -> Iterator[Row]:
        """The number of launches of each period and of each other status."""
        for name, chosen in self._kinds():
            values = {f"launches that are {name}": int(chosen.sum()), f"share {name}": float(chosen.mean())}
            yield Row(name, values, ("{}", "{:.2%}"))

    def _kinds(self) -> Iterator[tuple[str, np.ndarray]]:
        """The names of what is found, "period 1" before others, each with where it is (ny, nx, k)."""
        inside = self.status == HAS_PERIOD
        for period in np.unique(self.periods[inside]).tolist():
            yield f"period {period}", inside & (self.periods == period)
        for name in np.unique(self.status[~inside].astype(str)).tolist():
            yield name, self.status == name

    def _notes(self) -> list[str]:
        count, several = int(self.several.sum()), len(self.starts)
        text = f"{count} of {self.several.size} places lead to different periods from the {several} launches"
        return [text] if several > 1 and count else []

    def unit_of(self, name: str) -> str:
        """The unit of a column, see `Result`; it is the same for all launch speeds."""
        return super().unit_of("alpha" if name in ("start", "launch") else name)

    @property
    def first(self) -> np.ndarray:
        """For each place (ny, nx), the index of the first start whose hops continue in the range; 0 if there is
        none."""
        return np.argmax(self._stays, axis=2)

    @property
    def _stays(self) -> np.ndarray:
        """Which launches (ny, nx, k) continue in the range."""
        return np.isin(self.status, (HAS_PERIOD, CHAOTIC, UNSETTLED))

    @property
    def several(self) -> np.ndarray:
        """The places (ny, nx) where starts whose hops continue in the range lead to different periods."""
        first = np.take_along_axis(self.periods, self.first[:, :, None], axis=2)
        return ((self.periods != first) & self._stays).any(axis=2)

    def period(self) -> np.ndarray:
        """The periods (ny, nx) of the first start whose hops continue in the range: 0 if it has no period, -1 if there
        is no such start."""
        found = np.take_along_axis(self.periods, self.first[:, :, None], axis=2)[:, :, 0]
        return np.where(self._stays.any(axis=2), found, -1)

    def table(self) -> dict[str, np.ndarray]:
        """A row for each launch: both parameters, the start, what it settles to, its period and its launch speed."""
        ny, nx, k = self.status.shape
        places = np.meshgrid(self.others, self.values, self.starts, indexing="ij")
        columns = (places[1], places[0], places[2], self.status, self.periods, self.launches, self.exponents)
        names = self.along, self.second, "start", "status", "period", "launch", "exponent"
        return {name: np.reshape(column, ny * nx * k) for name, column in zip(names, columns, strict=True)}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the periods as coloured cells, the second parameter upwards, with a dot where the starts lead to
        different periods; returns the axes. Draw a `BifurcationCurve` over it with its own `plot(axes)`."""
        return shown("period_figures").plot_periods(self, axes)

    def document(self) -> Document:
        columns = {name: stored(column.tolist()) for name, column in self.table().items()}
        whole = {"machine": self.machine, "along": self.along, "second": self.second, "longest": self.longest}
        return {**whole, "hops": self.hops, **columns, **({"units": self.units} if self.units else {})}


@exclusive
def period_diagram(
    machine: Machine, over: Mapping[str, tuple[float, float]], between: tuple[float, float], *,
    samples: tuple[int, int] = (100, 100), starts: Sequence[float] | None = None, inject: float = 0.0,
    longest: int = 16, hops: int = 2048, grid: int = 400, cap: int = CAP, progress: Progress = None,
) -> PeriodDiagram:  # fmt: skip
    """The periods to which launches settle, over two parameters of the return map.

    machine : as for `ReturnMap`, where a launch is a speed
    over : the ranges of two parameters by name: "inject", "restitution" or parameters of the machine, the second one
        drawn upwards
    between : the range of launch speeds in which the map is resolved into polynomials; outside it, each hop takes
        longer
    samples : the numbers of values of the two parameters
    starts : initial launch speeds, by default 3 in the range; several of them show where different periods attract
    inject : the injection, if it is not one of the two parameters
    longest : the longest tested period
    hops : the most hops from each launch
    grid : number of launches in the grid on which the borders of the map are searched, as in `periodic_hops`
    cap : number of impacts in one hop after which its computation is ended
    progress : called with the completed share

    All values of the injection share one map, which takes some 0.2 s for each value of the other parameter. If the
    injection is not one of the two parameters, each place needs its own map. A launch is periodic if the launches of
    twice the longest period come back within a relative difference of 1e-8. Raises `InputError` for invalid arguments.
    """
    axes, (low, high) = _checked_axes(machine, over, samples, inject), range_of("between", between)
    if not low > 0:
        raise InputError(f"between = {between!r}; launch speeds must be above 0")
    if starts is None:
        own = np.linspace(low, high, PERIODS.starts + 2)[1:-1]
    elif not np.iterable(starts) or isinstance(starts, str):
        raise InputError(f"starts = {starts!r}; it must be a list of launch speeds")
    else:
        own = np.array([finite_number("starts", start) for start in starts])
    if not (len(own) and (own > 0).all()):
        raise InputError(f"starts = {starts!r}; they must be launch speeds above 0")
    longest, hops = whole_number("longest", longest, "hops"), whole_number("hops", hops, "hops")
    if hops < 4 * longest:
        raise InputError(f"hops = {hops}: to show a period of {longest}, it must be at least {4 * longest}")
    grid, (along, second) = whole_number("grid", grid, "launches", 2), axes
    maps = {name: values for name, values in axes.items() if name != INJECT}
    injections, shape = axes.get(INJECT, np.array([inject])), [len(values) for values in maps.values()]
    parts = list[tuple[np.ndarray, ...]]()
    for index in np.ndindex(*shape):
        one = _machine_with(machine, {name: float(maps[name][i]) for name, i in zip(maps, index, strict=True)})
        speed = one.units.of(LIFTOFF_SPEED) if one.units else 1.0
        plain = ReturnMap(one, cap=cap).dimensionless()
        step = SettlingMap(plain, pieces_between(plain, low / speed, high / speed, grid))
        many = np.tile(own / speed, len(injections)), np.repeat(injections / speed, len(own))
        status, periods, launches, exponents = settled(step, *many, longest, hops, PERIODS.escaped * high / speed)
        launches = launches * speed
        status[(status == HAS_PERIOD) & ~((launches >= low) & (launches <= high))] = OUT_OF_RANGE
        parts.append((status, periods, launches, exponents))
        if progress:
            progress(len(parts) / int(np.prod(shape)))
    # The injection, which each map has all values of, comes after the other parameters.
    places = [[*maps, *([INJECT] if INJECT in axes else [])].index(name) for name in (second, along)]
    whole = [*shape, *([len(injections)] if INJECT in axes else []), len(own)]
    found = [np.stack(each).reshape(whole).transpose(*places, 2) for each in zip(*parts, strict=True)]
    first, last = axes[along][[0, -1]].tolist()
    texts = MapsAlong(machine, along, first, last, 0.0, cap).units
    about = along, second, machine_in_words(machine), axes[along], axes[second], tuple(own.tolist())
    return PeriodDiagram(*about, found[0], found[1], found[2], found[3], longest, hops, texts)


def _checked_axes(
    machine: Machine, over: Mapping[str, tuple[float, float]], samples: tuple[int, int], inject: float
) -> dict[str, np.ndarray]:
    """The values of both parameters by name."""
    if not isinstance(over, Mapping) or len(over) != 2:
        raise InputError(f"over = {over!r}; it must map the names of two parameters to their ranges")
    if not machine.model.one_speed:
        raise InputError(f"a launch of a {machine.model.name} has several numbers, so there is no diagram of periods")
    for name in over:
        if name in (*RESERVED_IN_DIAGRAMS, "start", "status", "launch", "exponent"):
            raise InputError(f"a parameter called '{name}' has the name of a column of diagrams; rename it")
        if name not in (known := parameters_of_maps(machine)):
            raise InputError(f"the return map has no parameter '{name}'; it has {', '.join(known)}")
    if INJECT in over and finite_number("inject", inject) != 0:
        raise InputError(f"inject = {inject:g}, but over already states inject: leave it out")
    try:
        counts = [whole_number("samples", count, "values", 2) for count in samples]
        pairs = [*zip(over.items(), counts, strict=True)]
    except (TypeError, ValueError):
        raise InputError(f"samples = {samples!r}; it must be two numbers of values") from None
    return {name: np.linspace(*range_of(name, ends), count) for (name, ends), count in pairs}


def _machine_with(machine: Machine, values: Mapping[str, float]) -> Machine:
    """The machine with other values, the restitution among them."""
    own = {name: value for name, value in values.items() if name != RESTITUTION}
    machine = machine.with_values(**own) if own else machine
    return replace(machine, restitution=values[RESTITUTION]) if RESTITUTION in values else machine  # type: ignore
