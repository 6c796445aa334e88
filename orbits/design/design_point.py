"""The outputs of a design at orbits, with their slopes along which the orbit stays lossless, and quadratic models.

Second derivatives are differences of exact first ones at neighbours, which need not be orbits.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..errors import FlowError, NoOrbit
from ..flow import flow_of
from ..model import Machine
from ..numerics import TINY, Array
from ..periodic import OF_LOSS, Orbit, dimension_of
from ..shooting import vector
from ..symbolic import QuadraticModels
from ..units import Message, Units, in_units
from .design_problem import DesignProblem, Outputs
from .design_quantities import ABSENT, extremes_of
from .evaluator import DesignPoints, Evaluator, Varied, by_logarithm, evaluator
from .extremes import Place, place_near, places_of
from .tuned_machine import TunedMachine, statement_of_orbits, unknowns_of

# Neighbours differ by this share of a unit, to which second derivatives are then exact.
NEIGHBOUR_SHARE = 1e-5
LARGEST_SHIFT = 1e-3  # of a time or an unknown between neighbours, as a share of itself: they are nearer otherwise
# Demands on a motion stay this far above zero, in the machine's units: a motion that just touches is refused.
DEMAND_MARGIN = 1e-9
# Further places of extremes, by name, which are held equal to the first.
Ties: TypeAlias = Mapping[str, Place]


class Case(NamedTuple):
    """Outputs that are evaluated at a machine's dimensionless orbit.

    ties : further places of extremes
    firsts : places of these extremes that stand for the largest one, whether they are or not
    """

    machine: Machine
    orbit: Orbit
    outputs: Outputs
    ties: Ties
    firsts: Ties = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """The outputs at an orbit.

    outputs : with the demands that the orbit has
    places : of the extremes
    values : (rows,), of the formulas, minus the landing jerk, the demands, the differences between two places of an
        extreme, and the quantities in use
    slopes : (rows, k), the derivatives of the values by the parameters, along which the orbit stays lossless
    models : quadratic models by the change of the parameters, where they were requested: of all but the quantities in
        use, and of the change of the unknowns, see `moved`
    """

    machine: Machine
    orbit: Orbit
    outputs: Outputs
    places: tuple[Place, ...]
    values: Array
    slopes: Array
    models: QuadraticModels | None

    @property
    def demands(self) -> tuple[str, ...]:
        """The quantities that must be positive on a motion."""
        return self.outputs.demands

    @property
    def theta(self) -> Array:
        """The parameters to design, (k,)."""
        return np.array([self.machine.values[name] for name in self.outputs.over])

    def moved(self, change: Array) -> Array:
        """The n unknowns of the orbit after a change of each: of its logarithm, or a difference, see `by_logarithm`."""
        u, logarithmic = unknowns_of(self.machine, self.orbit), by_logarithm(statement_of_orbits(self.machine))
        return np.where(logarithmic, u * np.exp(np.minimum(change, 600.0)), u + change)

    @cached_property
    def scaled(self) -> slice:
        """The results that have a scale: the formulas, minus the landing jerk, and the demands."""
        return slice(len(self.outputs.formulas) + 1 + len(self.demands))

    @cached_property
    def tied(self) -> slice:
        """The differences between two places of an extreme."""
        return slice(self.scaled.stop, len(self.values) - len(self.quantities))

    @cached_property
    def quantities(self) -> dict[str, float]:
        """The quantities in use, by name."""
        names = self.outputs.quantities(self.machine.model, self.machine.values)
        return dict(zip(names, self.values[len(self.values) - len(names) :].tolist(), strict=True))

    @property
    def sizes(self) -> list[float]:
        """The units of the dimensionless landing jerk and demands; 1 for a dimensionless machine."""
        units = self.machine.units or Units(1.0, 1.0, 1.0)
        return [units.of(dimension_of(name)) for name in ("landing_jerk", *self.demands)]


def no_motion(machine: Machine, orbit: Orbit) -> NoOrbit:
    """The error of a machine's dimensionless orbit that is not a motion."""
    return NoOrbit(in_units(Message.joined("; ", orbit.violations), machine.units))


def has_loss(machine: Machine, orbit: Orbit) -> bool:
    """Whether there is a loss coefficient: where another point takes over at a landing, only if that loses enough; and
    not where a law has a corner at lift-off."""
    model = machine.model
    unsure = model.changes_contact or not flow_of(model.flight, tuple(machine.values)).is_smooth
    return not unsure or orbit.certificate.loss_coefficient is not None


def design_points(
    cases: Sequence[Case], problem: DesignProblem | None = None, *, closely: bool = False
) -> list[DesignPoint | NoOrbit]:
    """The outputs at several orbits; the formulas' numbers are in SI for a machine in SI.

    problem : with the units of the parameters, for quadratic models; None for none
    closely : whether second derivatives are differences over two neighbours along each parameter, with an error by the
        square of their distance

    In place of a point is the reason why there is none: a contact that does not end, or a missing extreme. Orbits whose
    extremes have the same kinds of places are evaluated together.
    """
    found: list[Any] = [None if case.orbit.contact else no_motion(case.machine, case.orbit) for case in cases]
    groups = defaultdict[tuple, dict[int, tuple[Case, tuple[Place, ...]]]](dict)
    for model in dict.fromkeys(case.machine.model for case in cases):
        these = [i for i, case in enumerate(cases) if case.machine.model is model and not found[i]]
        machines, orbits = [cases[i].machine for i in these], [cases[i].orbit for i in these]
        used = chain(*(cases[i].outputs.extremes(model, cases[i].machine.values) for i in these))
        places = places_of(machines, orbits, dict.fromkeys(used)) if these else []
        for i, own in zip(these, places, strict=True):
            try:
                case, held = _placed(cases[i], own)
                groups[model, case.outputs, tuple(place.kind for place in held)][i] = case, held
            except NoOrbit as error:
                found[i] = error
    for (model, outputs, kinds), group in groups.items():
        machine = next(iter(group.values()))[0].machine
        tuned = (statement_of_orbits(machine),) if isinstance(machine, TunedMachine) else ()
        evaluate = evaluator(model, tuple(machine.values), outputs, kinds, *tuned)
        for i, point in zip(group, _together(evaluate, [*group.values()], problem, closely), strict=True):
            found[i] = point
    return found


def _placed(case: Case, own: Mapping[str, Place | None]) -> tuple[Case, tuple[Place, ...]]:
    """The case with the demands that its orbit has, and the places that it needs, of the extremes before the extremes
    tied to them; raises `NoOrbit` where one is missing."""
    demands = tuple(name for name in case.outputs.demands if own[extremes_of(name)[0]])
    case = case._replace(outputs=replace(case.outputs, demands=demands))
    model, p, held = case.machine.model, case.machine.values, list[Place]()
    if {*OF_LOSS} & {*case.outputs.quantities(model, p)} and not has_loss(case.machine, case.orbit):
        raise NoOrbit(f"the orbit has no {ABSENT['loss']}")
    for extreme in case.outputs.extremes(model, p):
        if not (place := own[extreme]):
            raise NoOrbit(f"the orbit has no {ABSENT[extreme]}")
        held.append(place_near(case.machine, case.orbit, case.firsts.get(extreme, place)) if case.firsts else place)
    for tie in (place_near(case.machine, case.orbit, tie) for name, tie in case.ties.items() if own.get(name)):
        if tie.kind.extreme in case.firsts or tie.kind not in [place.kind for place in held]:
            held.append(tie)
    return case, tuple(held)


def _together(
    evaluate: Evaluator, group: list[tuple[Case, tuple[Place, ...]]], problem: DesignProblem | None, closely: bool
) -> list[DesignPoint | NoOrbit]:
    """The points of orbits with the same outputs and kinds of places."""
    ps = np.array([vector(case.machine.values) for case, _ in group])
    us = np.array([unknowns_of(case.machine, case.orbit) for case, _ in group])
    ends = [case.orbit.contact.times[-1] for case, _ in group if case.orbit.contact]
    times = [[*(place.time for place in places), end] for (_, places), end in zip(group, ends, strict=True)]
    points = DesignPoints(ps, us, np.array(times))
    try:
        found, moves = evaluate(points)
    except FlowError as error:
        return [error] if len(group) == 1 else [_together(evaluate, [each], problem, closely)[0] for each in group]
    models = _models(evaluate, points, found, moves, problem, closely) if problem else [None] * len(group)
    return [
        DesignPoint(*case[:3], places, *numbers)
        for (case, places), *numbers in zip(group, found.values, found.by, models, strict=True)
    ]


def _models(
    evaluate: Evaluator, points: DesignPoints, found: Varied, moves: DesignPoints, problem: DesignProblem, closely: bool
) -> list[QuadraticModels]:
    """The models at m points, from the slopes there and at neighbours along each parameter.

    moves : the derivatives (m, ..., k) of the points by the parameters
    """
    over, (m, n, k), logarithmic = evaluate.over, moves.us.shape, evaluate.logarithmic
    theta = points.ps[:, over]
    units = problem.units(theta)
    # The time of a place that is not inside half a phase may be zero.
    sizes = np.hstack([points.us[:, logarithmic], np.where(points.times > 0, points.times, np.inf)])
    changes = np.concatenate([moves.us[:, logarithmic], moves.times], axis=1) * units[:, None] / sizes[..., None]
    # Neighbours lie within the bounds, beyond which a formula may have no value.
    inward = np.where(theta > 0.5 * np.add(problem.low, problem.high), -1, 1)
    steps = inward * np.minimum(NEIGHBOUR_SHARE, LARGEST_SHIFT / np.maximum(np.abs(changes).max(1), TINY))
    # The neighbours (m, k) in units of the steps, and the weights of their slopes in a derivative.
    sides, shares = [np.ones((m, k))], [np.ones((m, k))]
    if closely:
        room = np.minimum(problem.change(theta, np.array(problem.high)), -problem.change(theta, np.array(problem.low)))
        between = room > np.abs(steps)
        sides += [np.where(between, -1.0, 2.0)]
        shares = [np.where(between, 0.5, 2.0), np.full((m, k), -0.5)]
    lengths = [(units * np.where(problem.wide, np.expm1(side * steps), side * steps))[:, None] for side in sides]
    shifts = [
        np.concatenate([(each[:, None] + (by * length).swapaxes(1, 2))[:, None] for length in lengths], axis=1)
        for each, by in zip(points, moves, strict=True)
    ]
    near = DesignPoints(*(each.reshape(m * len(sides) * k, -1) for each in shifts))

    def slopes_at(points: DesignPoints, found: Varied, moves: DesignPoints) -> Array:
        """The slopes of the rows and of the unknowns, by the change of the parameters."""
        of_us = moves.us / np.where(logarithmic, points.us, 1.0)[..., None]
        return (
            np.concatenate([found.by[:, evaluate.modelled], of_us], axis=1) * problem.units(points.ps[:, over])[:, None]
        )

    slopes = slopes_at(points, found, moves)
    try:
        beside = slopes_at(near, *evaluate(near)).reshape(m, len(sides), k, -1, k) - slopes[:, None, None]
        bends = sum(beside[:, i] * (share / steps)[:, :, None, None] for i, share in enumerate(shares))
        bends = np.nan_to_num(bends.swapaxes(1, 2), posinf=0.0, neginf=0.0)
    except FlowError:
        bends = np.zeros((*slopes.shape, k))
    values = np.hstack([found.values[:, evaluate.modelled], np.zeros((m, n))])
    return [QuadraticModels(*each) for each in zip(values, slopes, 0.5 * (bends + bends.swapaxes(2, 3)), strict=True)]
