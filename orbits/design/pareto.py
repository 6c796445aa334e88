"""Pareto fronts: designs such that none is better than another in both of two objectives."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from ..curves import ENDS_OF_MINIMA, Event
from ..errors import InputError, OrbitsError, is_list, list_of_names, whole_number
from ..io import Document
from ..model import Machine
from ..periodic import StartLike, orbit_of
from ..result import Axes, Progress, shown
from ..running import exclusive, interrupts
from .design_curve import SeveralDesigns, designs_along
from .design_problem import Constraint, DesignProblem, design_problem, known_formula
from .local_search import attempt
from .moving_number import Moving
from .optimality import Design
from .optimize import Origin, best_design, multistart, starting_points
from .sensitivities import quantities, sensitivities
from .tuned_machine import names_of_designs, untuned, with_tuning


class FrontOptions(NamedTuple):
    """The ends of fronts."""

    same: float = 1e-9  # objectives that differ by a smaller share are the same: constraints are met to about this
    worth: float = 1e-4  # an end is moved if the other objective gains this share while its own stays the same
    probe: float = 1e-3  # distance over which an end is probed for that, as a share of the parameters' range
    # Over the probe an objective with a slope changes by the probe, one with curvature alone by its square. It is flat
    # if it changes by less than this share of the latter.
    flat: float = 0.1


ENDS = FrontOptions()


@dataclass(frozen=True, eq=False, repr=False)
class Front(SeveralDesigns, what="front"):
    """Designs such that none is better than another in both objectives, in ascending order of the first objective.

    texts : the two objectives, both minimised
    designs : each certified
    refused : (level of the second objective, reason) for each level without a design
    events : where constraints, bounds and conditions of a motion become active or cease to be, by the value of the
        second objective
    """

    texts: tuple[str, str]
    designs: tuple[Design, ...]
    refused: tuple[tuple[float, str], ...]
    seconds: float
    events: tuple[Event, ...] = ()

    @property
    def values(self) -> np.ndarray:
        """The objectives (m, 2) of the designs."""
        return np.array([_objectives(design) for design in self.designs])

    def _documented(self, designs: list[Document]) -> Document:
        return {
            "objectives": list(self.texts),
            "points": [{"values": row, **own} for row, own in zip(self.values.tolist(), designs, strict=True)],
            "refused": [{"level": level, "reason": reason} for level, reason in self.refused],
            "events": self._rows_of_events(),
            "seconds": self.seconds,
        }

    @property
    def units(self) -> dict[str, str]:
        """The units of the objectives and parameters by name; empty for a dimensionless machine."""
        return {**self.designs[0].units, **{text: self.designs[0].unit_of(text.lstrip("-")) for text in self.texts}}

    def _line(self) -> dict[str, object]:
        return {"minimise": self.texts, "designs": len(self.designs), "seconds": self.seconds}

    def title(self) -> str:
        return f"Pareto front, minimise {' and '.join(self.texts)}: {len(self.designs)} certified designs"

    def _notes(self) -> list[str]:
        levels = [f"{self.texts[1]} <= {level:.6g}: {reason}" for level, reason in self.refused]
        happened = [f"at {self.texts[1]} = {each.value:.9g}: {each.text} {each.kind}" for each in self.events]
        return [*levels, *happened, f"found in {self.seconds:.2f} s"]

    def table(self) -> dict[str, list[float]]:
        """The objectives and parameters of the designs as columns."""
        columns = dict(zip(self.texts, self.values.T.tolist(), strict=True))
        return columns | {name: self.column(name).tolist() for name in self.designs[0].parameters}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the objectives of the designs against each other; returns the axes."""
        return shown("plot").plot_front(self, axes)

    @classmethod
    def of_saved(cls, document: Any, machine: Machine | None = None) -> "Front":
        """The front from what `saved` returned, for a machine with any values of the designed parameters; raises
        `ValueError` where its parts contradict each other."""
        designs = tuple(Design.of_saved(point, machine) for point in document["points"])
        if not designs or any(design.pair is None for design in designs):
            raise ValueError("it has no designs with two objectives")
        refused = [(each["level"], each["reason"]) for each in document["refused"]]
        own = cls._fields_in({**document, "texts": document["objectives"], "refused": refused})
        return cls(designs=designs, **own)


@exclusive
def pareto(
    machine: Machine,
    *,
    minimise: tuple[str, str],
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[str] = (),
    points: int = 9,
    family: int = 1,
    start: StartLike | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, float] | None = None,
    starts: int | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Front:
    """The Pareto front of two objectives.

    minimise : the two objectives, formulas as in `optimize`; to maximise one, give it a minus sign, such as "-alpha"
    points : number of designs, at most
    machine, over, subject_to, family, start, tune, at, starts, seed, progress : as in `optimize`

    Returns the designs in ascending order of the first objective, each certified as by `optimize`. Both ends of the
    front are designed first. Then the first objective is minimised while the second is bounded at evenly spaced levels
    between the ends (the epsilon-constraint method of Haimes, Lasdon and Wismer, 1971). The optimality conditions are
    followed from level to level. Where such a curve ends, a search starts from the previous design and from both ends.
    With `starts`, such a search runs at every level, from further starts too. Dominated designs are left out. Raises
    the errors of `optimize` where an end has no optimum.

    >>> from orbits import pareto
    >>> from problems import hopper_in_si
    >>> leg = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
    >>> both, over = ("-centre_of_mass_rise", "largest_contact_force"), {"k": (500.0, 5e4), "b": (0.0, 1e7)}
    >>> front = pareto(leg, minimise=both, over=over, subject_to=["stroke <= 0.25"], points=3)
    >>> front.values.shape
    (3, 2)
    """
    named = list_of_names("minimise", minimise) if is_list(minimise) else []
    if len({*named}) != 2 or len(named) != 2:
        raise InputError(f"minimise = {minimise!r}; it must be two different objectives")
    points = whole_number("points", points, "designs", 2)
    report = progress or (lambda share: None)
    with interrupts.deferred():
        began, texts = time.perf_counter(), (named[0], named[1])
        stated = with_tuning(machine, tune, at, over)
        known = names_of_designs(stated)
        problems = [design_problem(machine, text, None, over, subject_to, known) for text in texts]
        ends, origin = [], Origin.of(stated, family, start)
        starting = starting_points(origin.machine, problems[0], starts, seed) if starts else []
        for i, problem in enumerate(problems):
            within = lambda share, i=i: report((i + share) / points)  # noqa: E731
            best = _with_both(multistart(origin, problem, starts, seed, within), texts)
            ends.append(_corner(best, problems[1 - i], i, origin, texts))
            report((i + 1) / points)
        # Where one design is best in both objectives there are no levels between the ends.
        (_, high), (_, low) = map(_objectives, ends)
        apart = _dominates([low], [high])
        levels = np.linspace(high, low, points)[1:-1].tolist() if apart else []
        search = _Levels(problems[0], origin, texts, (ends[0], ends[1]), starting)
        between, refused, events = search.designs(levels, lambda done: report((done + 2) / points))
        designs = [ends[0], *between, *(ends[1:] if apart else [])]
        front = [d for d in designs if not any(_dominates(_objectives(other), _objectives(d)) for other in designs)]
        front, seconds = sorted(front, key=_objectives), time.perf_counter() - began
        return Front(texts, tuple(front), tuple(refused.items()), seconds, tuple(events))


@dataclass(frozen=True)
class _Levels:
    """The designs between the ends of a front, each with the first objective least below a level of the second one.

    problem : of the first objective
    further : starts of a search at each level, in addition to the known designs; with any no curves are followed
    """

    problem: DesignProblem
    origin: Origin
    texts: tuple[str, str]
    ends: tuple[Design, Design]
    further: Sequence[Mapping[str, Any]]

    def designs(
        self, levels: Sequence[float], report: Callable[[int], None]
    ) -> tuple[list[Design], dict[float, str], list[Event]]:
        """The designs at falling levels, the reason at each level without one, and the events of their curves.

        A curve begins at the first end; where it ends, a search finds the design at the next level. Where a search from
        the other end finds a better one at the last level, the curve through that is better as far as it is.
        """
        found, refused, events, left = dict[float, Design](), dict[float, str](), list[Event](), [*levels]
        searched, last = False, self.ends[0]
        while left:
            reached, happened = self._followed(last, left)
            found, events, left = found | reached, events + happened, left[len(reached) :]
            if searched := bool(left):
                known = tuple(dict.fromkeys([*[*found.values()][-1:], *self.ends]))
                try:
                    found[left[0]] = last = self._searched(left[0], known)
                except OrbitsError as error:
                    refused[left[0]] = f"none found from {len(known) + len(self.further)} starts: {error}"
                left = left[1:]
            report(len(found) + len(refused))
        if levels and not searched:
            events = self._from_other_end(levels, found, events)
        return [found[level] for level in levels if level in found], refused, events

    def _from_other_end(self, levels: Sequence[float], found: dict[float, Design], events: list[Event]) -> list[Event]:
        """The events of the curves, after designs that were found are replaced by better ones of a curve from the last
        level upwards, to which a search from the second end leads."""
        try:
            other = self._searched(levels[-1], self.ends[1:])
        except OrbitsError:
            return events
        if not self._better(other, found[levels[-1]]):
            return events
        reached, happened = self._followed(other, levels[-2::-1])
        for level, design in {levels[-1]: other, **reached}.items():
            if level in found and not self._better(design, found[level]):
                break
            found[level], highest = design, level
        values, others = (np.array([event.value for event in each], float) for each in (events, happened))
        return [*compress(events, values > highest), *reversed([*compress(happened, others <= highest)])]

    @staticmethod
    def _better(design: Design, other: Design) -> bool:
        """Whether the first objective of a design is less than that of another by more than rounding."""
        return _dominates(_objectives(design)[:1], _objectives(other)[:1])

    def _searched(self, level: float, known: Sequence[Design]) -> Design:
        """The design at a level that a search from known ones finds."""
        problem = _with_bound(self.problem, self.texts[1], level, self.origin.machine)
        starts = [*({**design.parameters, "motion": design.motion} for design in known), *self.further]
        return _with_both(best_design(self.origin, problem, starts), self.texts)

    def _followed(self, design: Design, levels: Sequence[float]) -> tuple[dict[float, Design], list[Event]]:
        """The designs at the first of some levels, as far as the curve from a design leads, and its events."""
        if self.further or not levels:
            return {}, []
        begin, end = _objectives(design)[1], levels[-1]
        problem = _with_bound(self.problem, self.texts[1], begin, self.origin.machine)
        limit = len(problem.constraints) - 1
        moving = Moving(problem.constraints[limit].text, begin, end, constraint=limit, sides=(False, True))
        shares = [(level - begin) / (end - begin) for level in levels]
        try:
            curve = designs_along(design, problem, moving, shares)
        except OrbitsError:
            return {}, []
        at = {moving.value(share): level for share, level in zip(shares, levels, strict=True)}
        pairs = zip(curve.values, curve.designs, strict=True)
        reached = {at[value]: _with_both(found, self.texts) for value, found in pairs if value in at}
        return reached, [event for event in curve.events if event.kind not in ENDS_OF_MINIMA]


def _corner(end: Design, other: DesignProblem, index: int, origin: Origin, texts: tuple[str, str]) -> Design:
    """An end of the front: the objective of this index is least, and the other one is least at that value."""
    if not _flat(end, other, index, origin, texts):
        return end
    own, rival = _objectives(end)[index], _objectives(end)[1 - index]
    problem = _with_bound(other, texts[index], own + ENDS.same * abs(own), origin.machine)
    start = {**end.parameters, "motion": end.motion}
    try:
        further = _with_both(best_design(origin, problem, [start]), texts)
    except OrbitsError:
        return end
    return further if rival - _objectives(further)[1 - index] > ENDS.worth * abs(rival) else end


def _flat(end: Design, problem: DesignProblem, index: int, origin: Origin, texts: tuple[str, str]) -> bool:
    """Whether the objective of this index stays the same over a short distance along which the other one falls fastest,
    with the active constraints of an end held active."""
    span = np.subtract(problem.high, problem.low)
    active = {constraint.text for constraint in end.active}
    held = [constraint.formula.text for constraint in problem.constraints if constraint.text in active]
    tune, at = (end.tune, end.at) if end.tuned else (None, None)
    slopes = sensitivities(end.source, end.orbit, problem.names, [texts[1 - index], *held], tune=tune, at=at)
    rows = np.array([[slope[name] for name in problem.names] for slope in slopes.values()]) * span
    theta = problem.theta(end.source)
    on_bounds = np.eye(len(span))[(theta == problem.low) | (theta == problem.high)]
    fixed = np.vstack([rows[1:], on_bounds])
    direction = -rows[0] + (fixed.T @ np.linalg.lstsq(fixed.T, rows[0], rcond=None)[0] if len(fixed) else 0.0)
    # A direction that is only rounding of the slope does not count: the other objective cannot fall.
    if np.linalg.norm(direction) <= 1e-6 * np.linalg.norm(rows[0]):
        return False
    probe = np.clip(theta + ENDS.probe * span * direction / np.linalg.norm(direction), problem.low, problem.high)
    own_machine, own_orbit = end.motion
    machine = own_machine.with_values(**dict(zip(problem.names, probe.tolist(), strict=True)))
    (motion,) = origin._replace(machine=own_machine, orbit=origin.orbit and own_orbit).motions([machine])
    if isinstance(motion, OrbitsError):
        return False
    machine, orbit = motion
    found = attempt(quantities, machine, orbit_of(untuned(machine), orbit), [texts[index]])
    own = _objectives(end)[index]
    return isinstance(found, dict) and abs(found[texts[index]] - own) <= ENDS.flat * ENDS.probe**2 * abs(own)


def _with_bound(problem: DesignProblem, text: str, level: float, machine: Machine) -> DesignProblem:
    """A problem with the further constraint that an objective is no more than a level."""
    formula = known_formula(text, names_of_designs(machine), "the objective", machine)
    constraint = Constraint(f"{text} <= {level:.9g}", formula, -np.inf, level)
    return replace(problem, constraints=(*problem.constraints, constraint))


def _dominates(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether a design is better in one objective and not worse in any, by more than rounding."""
    slack = [2 * ENDS.same * abs(value) for value in other]
    pairs = list(zip(one, other, slack, strict=True))
    return all(a <= b + s for a, b, s in pairs) and any(a < b - s for a, b, s in pairs)


def _with_both(design: Design, texts: tuple[str, str]) -> Design:
    """A design with the values of both objectives."""
    machine, _ = design.motion
    values = quantities(machine, design.orbit, texts)
    return replace(design, pair=(values[texts[0]], values[texts[1]]))


def _objectives(design: Design) -> tuple[float, float]:
    """Both objectives of a design on a front."""
    assert design.pair is not None
    return design.pair
