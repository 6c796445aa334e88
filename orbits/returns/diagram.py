"""A bifurcation diagram of return maps: branches of periodic launches, their bifurcations, and the attractor."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..continuation import End, Options, StepControl
from ..errors import InputError
from ..io import Document, one_line
from ..model import Machine, title_of_machine
from ..result import Axes, Result, Row, known, shown, stored
from .bifurcation import WORDS_OF_STABILITY, Bifurcation, name_of_hops
from .bifurcation_curve import BifurcationCurve
from .followed_events import follow_bifurcation

BranchEnd = End  # both names can be imported
# Names that the parameter of a diagram cannot have, since tables and documents have these names too.
RESERVED_IN_DIAGRAMS = ("branch", "period", "value", "alpha", "other", "multiplier", "stable", "ends", "kind", "note")


@dataclass(frozen=True, eq=False)
class Branch:
    """A curve of periodic launches in the plane of parameter and launch speed.

    period : the number of hops
    values : of the parameter (n,), in order along the curve, which may turn round
    alphas : launch speeds (n, period) of the hops
    multipliers : of the hops (n,), NaN where they have none. Where a launch has d numbers, the multiplier of largest
        modulus; if it is complex, its modulus
    ends : at the first and the last point
    names, launches : the names of the d numbers of a launch, and the launches (n, period, d); empty where a launch is a
        speed
    spectra : (n, d, 2), the real and imaginary parts of all multipliers there
    """

    period: int
    values: np.ndarray
    alphas: np.ndarray
    multipliers: np.ndarray
    ends: tuple[End, End]
    names: tuple[str, ...] = ()
    launches: np.ndarray | None = None
    spectra: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not len(self.values) == len(self.alphas) == len(self.multipliers) > 0:
            raise ValueError(
                "a branch must have the same number of values, launch speeds and multipliers, and at least one"
            )

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        ends = {"start": float(self.values[0]), "stop": float(self.values[-1])}
        return one_line(self, {"period": self.period, "points": len(self), **ends})

    @property
    def stable(self) -> list[bool | None]:
        """Whether the hops (n,) attract their neighbours, that is, whether the absolute value of the multiplier is
        below 1; None without a multiplier, where stability is not known."""
        return [_settles(each) for each in self.multipliers.tolist()]

    def stretches(self) -> list[tuple[float, float, bool | None]]:
        """The parts of the curve, in order: each from one value of the parameter to another, and whether it is stable,
        None if not known. Parts meet at a bifurcation, which is a point of the curve."""
        return [(float(self.values[a]), float(self.values[b]), stable) for a, b, stable in self.parts()]

    def parts(self) -> list[tuple[int, int, bool | None]]:
        """The `stretches` by the indices of their first and their last point."""
        before, behind = self.multipliers[:-1], self.multipliers[1:]
        # A bifurcation, with 1, -1 or no multiplier, has the stability of the points next to it.
        between = np.where(np.isnan(before), behind, np.where(np.isnan(behind), before, 0.5 * (before + behind)))
        stable = [_settles(each) for each in between.tolist()]
        cuts = [0, *(i for i in range(1, len(stable)) if stable[i] != stable[i - 1]), len(self) - 1]
        return [(a, b, stable[a]) for a, b in pairwise(cuts) if b > a]


@dataclass(frozen=True, eq=False, repr=False)
class BifurcationDiagram(Result, what="bifurcation diagram"):
    """The periodic launches of the return maps of a machine along a parameter, as `bifurcations` follows them.

    along : name of the parameter
    span : the range of the parameter
    between : the range of launch speeds
    machine : in words and numbers
    branches, events : the curves, and the bifurcations on them, ascending in the parameter
    visits : (k, 2), values of the parameter, and launch speeds of the attractor there
    units : of launch speeds and parameters, by name; empty for a dimensionless machine
    inject : the injection, if it is not the parameter
    source : the machine; None for a diagram from a file
    """

    along: str
    span: tuple[float, float]
    between: tuple[float, float]
    machine: Mapping[str, Any]
    branches: tuple[Branch, ...]
    events: tuple[Bifurcation, ...]
    visits: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    units: Mapping[str, str] = field(default_factory=dict)
    inject: float = 0.0
    source: Machine | None = field(default=None, repr=False, compare=False)

    def saved(self) -> Document:
        """The saved document, see `Result`, without the machine itself."""
        return Result.saved(replace(self, source=None))

    def _line(self) -> dict[str, object]:
        counts = {"branches": len(self.branches), "events": len(self.events)}
        return {"along": self.along, "span": self.span, "between": self.between, **counts}

    def title(self) -> str:
        unit, speed = (f" {self.unit_of(name)}".rstrip() for name in (self.along, "alpha"))
        (low, high), (slow, fast) = self.span, self.between
        ranges = f"along {self.along} from {low:g} to {high:g}{unit}, launch speeds {slow:g} to {fast:g}{speed}"
        return f"return map of {title_of_machine(self.machine)}, {ranges}"

    def _rows(self) -> Iterator[Row]:
        """Each branch with its stretches and ends, and each event."""
        unit, speed = (f" {self.unit_of(name)}".rstrip() for name in (self.along, "alpha"))
        if not self.branches:
            yield Row("no launch of period one comes back there", {"branches": 0}, ("",))
        for i, branch in enumerate(self.branches):
            count = {
                f"branch {i}": name_of_hops(branch.period),
                f"points of branch {i}": len(branch),
            }
            yield Row(f"branch {i}", count, ("{}, {} points",))
            for a, b, stable in branch.stretches():
                ends = {f"start of a stretch of branch {i}": a, f"stop of a stretch of branch {i}": b}
                text = f"{self.along} = {{:.12g}} to {{:.12g}}{unit}: {WORDS_OF_STABILITY[stable]}"
                yield Row("", ends, (text,))
            for where, end in zip(("begins", "ends"), branch.ends, strict=True):
                yield Row("", {f"branch {i} {where}": end.reason}, (f"{where}: {{}}",))
        for event in self.events:
            launches = ", ".join(f"{alpha:.12g}" for alpha in event.alphas)
            values = {event.kind: event.value, f"alpha at {event.kind}": launches, f"note of {event.kind}": event.note}
            note = ": {}" if event.note else ""
            yield Row(event.kind, values, (f"{self.along} = {{:.12g}}{unit}, alpha = {{}}{speed}{note}",))

    def unit_of(self, name: str) -> str:
        """The unit of a column, see `Result`; all launch speeds of a branch have that of the first."""
        return super().unit_of("alpha" if name.removeprefix("other ").split(" ")[0] == "alpha" else name)

    def periodic(self, value: float) -> list[tuple[int, float, float]]:
        """The periodic launches at a value of the parameter, by linear interpolation between the points of the
        branches: (period, launch speed, multiplier) of each, ascending in the launch speed."""
        found = []
        for branch in self.branches:
            ahead = branch.values - value
            exact = ahead == 0
            if branch.ends[1].kind == "closed":  # its last point is its first one
                exact[-1] = False
            places = [(i, i, 0.0) for i in np.flatnonzero(exact)]
            for i in np.flatnonzero(ahead[1:] * ahead[:-1] < 0):
                places.append((i, i + 1, float(ahead[i] / (ahead[i] - ahead[i + 1]))))
            for i, k, share in places:
                alphas = branch.alphas[i] + share * (branch.alphas[k] - branch.alphas[i])
                slope = branch.multipliers[i] + share * (branch.multipliers[k] - branch.multipliers[i])
                found += [(branch.period, float(alpha), float(slope)) for alpha in alphas]
        return sorted(found, key=lambda each: each[1])

    def follow_event(
        self, event: Bifurcation | str, second: str, stop: float | tuple[float, float], *,
        machine: Machine | None = None, at: Sequence[float] = Options.at, longest: float = Options.longest,
        most: int = Options.most, step_control: StepControl = Options.step_control, output: str | Path | None = None,
    ) -> BifurcationCurve:  # fmt: skip
        """Follow a flip, a fold or a border collision of the diagram as a second parameter goes to `stop`; returns a
        curve in two parameters.

        event : one of the `events`, or a kind, for the first event of this kind
        second : name of the second parameter, "inject" or one of the machine
        stop : its last value, or a pair: a bound behind the first value, and the last value
        machine : of the diagram, needed for a diagram from a file
        at, longest, most, step_control : as in `orbits.follow`
        output : a file to which the curve is saved

        The equations of the hops and of the bifurcation are solved together, with exact derivatives. The curve ends
        where the numbers of impacts of the hops change. Raises `InputError` for another kind of event, where the pieces
        of a law move with the first parameter, and for a machine with a restitution.

        >>> from orbits import bifurcations
        >>> from problems import Hopper
        >>> diagram = bifurcations(Hopper(), "inject", (0.06, 0.08), (4.5, 4.6), samples=50, sections=2, attractor=0)
        >>> flips = diagram.follow_event(diagram.events[0], "mass_ratio", 1.2)
        >>> [round(number, 6) for number in (diagram.events[0].value, *flips.at(1.2))]
        [0.071587, 0.073369]
        """
        if (machine := self.source if machine is None else machine) is None:
            raise InputError("a diagram from a file does not hold its machine: pass it as machine=")
        if isinstance(event, str):
            kinds = {each.kind: each for each in reversed(self.events)}
            if event not in kinds:
                raise InputError(f"the diagram has no {event}; its events are {', '.join(sorted(kinds)) or 'none'}")
            event = kinds[event]
        options: dict[str, Any] = {"at": at, "longest": longest, "most": most, "step_control": step_control}
        curve = follow_bifurcation(machine, self.along, event, second, stop, inject=self.inject, **options)
        if output is not None:
            curve.save(output)
        return curve

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the launch speeds against the parameter; returns the axes. See `orbits.show.map_figures`."""
        return shown("map_figures").plot_bifurcations(self, axes)

    def document(self) -> Document:
        branches = [
            {
                "period": branch.period,
                self.along: branch.values.tolist(),
                "alpha": branch.alphas.tolist(),
                "multiplier": known(branch.multipliers),
                "stable": branch.stable,
                "ends": [*map(stored, branch.ends)],
                **({} if branch.launches is None else {"names": branch.names, "launches": branch.launches.tolist()}),
                **({} if branch.spectra is None else {"spectra": branch.spectra.tolist()}),
            }
            for branch in self.branches
        ]
        events = [
            {
                "kind": event.kind,
                self.along: event.value,
                "alpha": list(event.alphas),
                "multiplier": known(event.multiplier)[0],
                "branch": event.branch,
                "note": event.note,
                **({"border": event.border, "sides": known(event.sides)} if event.border else {}),
            }
            for event in self.events
        ]
        whole = {"machine": self.machine, "along": self.along, "from": self.span[0], "to": self.span[1]}
        whole |= {"between": list(self.between), "branches": branches, "events": events}
        visits = {self.along: self.visits[:, 0].tolist(), "alpha": self.visits[:, 1].tolist()}
        return {**whole, "attractor": visits, **({"units": self.units} if self.units else {})}

    def table(self) -> dict[str, np.ndarray]:
        """The points of all branches as columns, with as many launch speeds as the longest period has; the multiplier
        is that of the hops, NaN where they have none."""
        longest = max([2, *(branch.period for branch in self.branches)])
        alphas = ["alpha", "other alpha", *(f"alpha {hop}" for hop in range(3, longest + 1))]
        names, empty = ["branch", "period", self.along, *alphas, "multiplier", "stable"], np.zeros(0)
        parts = [[empty.astype(int), empty.astype(int), *(empty for _ in names[3:]), empty.astype(object)]]
        for i, branch in enumerate(self.branches):
            whole, launches = np.ones(len(branch), int), np.full((len(branch), longest), np.nan)
            launches[:, : branch.period] = branch.alphas
            numbers = branch.values, *launches.T, branch.multipliers, np.array(branch.stable, object)
            parts.append([i * whole, branch.period * whole, *numbers])
        return dict(zip(names, map(np.concatenate, zip(*parts, strict=True)), strict=True))


def _settles(multiplier: float) -> bool | None:
    """Whether hops with a multiplier attract their neighbours; None without one."""
    return None if np.isnan(multiplier) else abs(multiplier) < 1
