"""The outputs of a design at many points together, with exact derivatives.

The unknowns u of the simplest statement of an orbit are functions of the parameters theta by its equations. All else
follows: an extreme is stationary at its place, and in the middle of the contact its speed or its place vanishes, or
half its time is one of the unknowns, so that derivatives of states at fixed times suffice.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..errors import InputError
from ..flow import flow_of
from ..model import Model, Phase, Statement
from ..numerics import Array, solve
from ..periodic import OF_LOSS, VARIATIONAL, dimension_of, landing_factors
from ..symbolic import MappedFunction, cached
from ..units import Units
from .design_problem import Outputs
from .design_quantities import (
    base_statement,
    expressions,
    extreme_of,
    landing_sensitivity,
    left_at_landing,
    variational_arc,
)
from .extremes import Kind, extreme_function, start_function


class DesignPoints(NamedTuple):
    """Points (m,): parameters (m, np), unknowns (m, n), and times (m, e + 1) of the extremes from the start of their
    phase, and half the contact times."""

    ps: Array
    us: Array
    times: Array


class Varied(NamedTuple):
    """Numbers (m, rows) at m points, and their derivatives (m, rows, K) by K unknowns or parameters."""

    values: Array
    by: Array

    def only(self, rows: list[int]) -> "Varied":
        """Some of the rows."""
        return Varied(self.values[:, rows], self.by[:, rows])

    def plus(self, other: "Varied", share: Any = 1.0) -> "Varied":
        """The sum with a share, a number or (m, 1), of other numbers."""
        return Varied(self.values + share * other.values, self.by + np.reshape(share, (-1, 1, 1)) * other.by)

    def times(self, other: "Varied") -> "Varied":
        """The products with other numbers."""
        by = self.by * other.values[..., None] + self.values[..., None] * other.by
        return Varied(self.values * other.values, by)


class VariedOrbit(NamedTuple):
    """Orbits at points (m,), varied by the parameters theta: the parameters, the unknowns, half the times of flight and
    contact, the landing sensitivities where they are in use, and the states in which flight, contact and the motions of
    the simplest statement begin, by name."""

    p: Varied
    u: Varied
    half: Varied
    contact: Varied
    slope: Varied
    begins: dict[str, Varied]


class Evaluator:
    """The outputs of a design by its parameters theta (k,); without any no derivatives are taken.

    kinds : the places of the extremes; an extreme that occurs again is tied to its first place
    tuned : the statement of orbits with tuned parameters; None for the simplest one
    """

    def __init__(
        self, model: Model, names: tuple[str, ...], outputs: Outputs, kinds: tuple[Kind, ...],
        tuned: Statement | None = None,
    ):  # fmt: skip
        statement, k = tuned or base_statement(model), len(outputs.over)
        self.model, self.names, self.outputs, self.kinds = model, names, outputs, kinds
        self.over, n = [names.index(name) for name in outputs.over], len(statement.unknowns)
        columns = k + n if k else 0
        self.du, self.dp = np.eye(n, columns, k), np.zeros((len(names), columns))
        self.dp[self.over, range(k)] = 1.0
        for j, name in enumerate(reversed(statement.tuned if k else ()), start=1):
            self.dp[names.index(name), -j] = 1.0
        self.logarithmic = by_logarithm(statement)
        extremes = [kind.extreme for kind in kinds]
        first = [extremes.index(extreme) for extreme in extremes]
        u, p = ca.SX.sym("u", n), ca.SX.sym("p", len(names))
        unknowns = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
        values = dict(zip(names, ca.vertsplit(p), strict=True))
        used, arcs = outputs.quantities(model, values), statement.arcs
        self.variational = any(name in VARIATIONAL for name in used)
        longer = variational_arc(model, tuned) if self.variational else arcs[0]
        phases = {"flight": model.flight, "contact": model.contact, "half": longer.phase}
        # The phases of the arcs: half the flight and, where the launch has several unknowns, half the contact.
        self.halves = ("half", "contact")[: len(arcs)]
        ends = [ca.SX.sym("end", len(phases[half].states)) for half in self.halves]
        begun, launched = [_data_of(phases[half]) for half in self.halves], _data_of(phases["flight"])
        begins = model.launch(unknowns, values), model.touchdown(unknowns, values), longer.start(unknowns, [], values)
        self.flows = {name: flow_of(phase, names) for name, phase in phases.items()}
        self.begins = {name: of_varied([u, p], begin) for name, begin in zip(phases, begins, strict=True)}
        self.durations = of_varied([u, p], [arc.duration(unknowns, values) for arc in arcs])
        half, contact, slope = (ca.SX.sym(name) for name in ("half", "contact", "slope"))
        factors = ca.SX.sym("factors", 2)
        largest, states, before = ca.SX.sym("extremes", len(kinds)), ca.vertsplit(ends[0]), list[ca.SX]()
        equations = [landing_sensitivity(model, half, states, values, tuned) if self.variational else 0.0]
        for arc, end, data in zip(arcs, ends, begun, strict=True):
            start = arc.start(unknowns, before, values)
            before = ca.vertsplit(end)[: len(start)]
            equations += [
                *arc.guard(unknowns, start, values, ca.vertsplit(data)),
                *arc.conditions(unknowns, before, values),
            ]
        self.closing = of_varied([u, *ends, half, p, *begun], equations)
        of_extremes = {extreme: largest[i] for extreme, i in zip(extremes, first, strict=True)}
        at, names_of_all = (
            (unknowns | {"contact": contact}, slope, ca.vertsplit(factors), values),
            [*used, "landing_jerk"],
        )
        found = expressions(model, names_of_all, of_extremes, *at, ca.vertsplit(launched))
        # Formulas and quantities are in SI for a model in SI, whose units vary with its parameters. A rise is a length.
        units = model.units(values) if model.units else Units(1.0, 1.0, 1.0)
        stated = values | {name: found[name] * units.of(dimension_of(name)) for name in used}
        results = [formula(**{name: stated[name] for name in formula.names}) for formula in outputs.formulas]
        results += [-found["landing_jerk"], *map(found.get, outputs.demands)]
        results += [largest[i] - largest[j] for j, i in enumerate(first) if i != j]
        self.modelled = slice(len(results))
        results += map(stated.get, used)
        self.results = of_varied([u, contact, largest, slope, factors, p, launched], results)
        # Of a landing with a speed, where another point takes over.
        hands_over = model.changes_contact and any(name in OF_LOSS for name in used)
        self.share_left = of_varied([u, p], [left_at_landing(model, unknowns, values)]) if hands_over else None
        middle = model.mid_contact(values)
        self.middle = np.array([middle.weights], dtype=float), of_varied([p], [middle.offset])

    def __call__(self, points: DesignPoints) -> tuple[Varied, DesignPoints]:
        """The results at some points by the parameters theta, and the derivatives (m, ..., k) of the points, along
        which the equations of an orbit hold; raises `FlowError` where a motion cannot be followed.

        The rows are the `modelled` ones: the formulas, minus the landing jerk, the demands, and the differences between
        two places of an extreme; and then the quantities in use.
        """
        p, u, half, contact, slope, begins = self.orbit(points)
        times = Varied(points.times, np.zeros((*points.times.shape, len(self.over))))
        times.by[:, -1:] = contact.by
        extremes = times.only([*range(len(self.kinds))])
        for j, (extreme, index, where) in enumerate(self.kinds):
            phase, _ = extreme_of(self.model, extreme)[index]
            at = {"middle": half if phase == "flight" else contact, "inside": times.only([j])}.get(where)
            x = self.after(phase, begins[phase], at, p) if at else begins[phase]
            of_extreme = _of_extreme(self.model, self.names, extreme, index, where == "start")
            found = of_extreme(x, p, self._data(phase, x, p))
            extremes.values[:, j], extremes.by[:, j] = found.values[:, 0], found.by[:, 0]
            if where == "inside":  # The rate of the function along the motion stays zero.
                times.by[:, j] = -found.by[:, 1] / found.values[:, 2:]
        launched = self._data("flight", begins["flight"], p)
        results = self.results(u, contact, extremes, slope, self._factors(u, p), p, launched)
        return results, DesignPoints(p.by, u.by, times.by)

    def orbit(self, points: DesignPoints) -> VariedOrbit:
        """The orbits at some points, varied by the parameters theta, along which their equations hold; raises
        `FlowError` where a motion cannot be followed."""
        if self.variational:
            self._refuse_jumps(points.ps[0])
        m, k = len(points.ps), len(self.over)
        p, u = (Varied(x, np.tile(dx, (m, 1, 1))) for x, dx in ((points.ps, self.dp), (points.us, self.du)))
        durations, begun = self.durations(u, p), [self.begins[half](u, p) for half in self.halves]
        parts = [
            (half, begin, durations.only([i]), p)
            for i, (half, begin) in enumerate(zip(self.halves, begun, strict=True))
        ]
        ends, data = [self.after(*part) for part in parts], [self._data(half, begin, p) for half, begin, _, _ in parts]
        closed = self.closing(u, *ends, durations.only([0]), p, *data)
        # From here on all derivatives are by theta.
        us_by = -solve(closed.by[:, 1:, k:], closed.by[:, 1:, :k]) if k else u.by
        along = np.concatenate([np.tile(np.eye(k), (m, 1, 1)), us_by], axis=1)[:, : u.by.shape[2]]
        p, u, durations, slope = (Varied(x, by @ along) for x, by in (p, u, durations, closed.only([0])))
        begins = {phase: begin(u, p) for phase, begin in self.begins.items()}
        contact = durations.only([-1])
        if len(self.halves) < 2:  # A function of the contact vanishes in its middle.
            contact = Varied(points.times[:, -1:], np.zeros((m, 1, k)))
            x, (weights, offset) = self.after("contact", begins["contact"], contact, p), self.middle
            rates = self.rates("contact", x.values, p)
            contact = contact._replace(by=-(weights @ x.by + offset(p).by) / (weights @ rates[:, :, None]))
        return VariedOrbit(p, u, durations.only([0]), contact, slope, begins)

    def _refuse_jumps(self, p: Array) -> None:
        """Raise `InputError` where the force jumps: the variation of the flight is then no motion without jumps."""
        flow = self.flows["flight"]
        if jumps := flow.jumps(p):
            remedy = f"the force jumps at the extension {jumps[0]:.6g}: round the law there"
            raise InputError(f"{' and '.join(VARIATIONAL)} need a continuous force, and {remedy}")

    def _factors(self, u: Varied, p: Varied) -> Varied:
        """What landings without and with a bounce lose as multiples of C (m, 2)."""
        if self.share_left is None:
            m, k = len(p.values), p.by.shape[2]
            return Varied(np.tile(landing_factors(0.0)[0], (m, 1)), np.zeros((m, 2, k)))
        shares = self.share_left(u, p)
        factors, slopes = np.swapaxes([landing_factors(share) for share in shares.values[:, 0].tolist()], 0, 1)
        return Varied(factors, slopes[:, :, None] * shares.by)

    def _data(self, phase: str, x: Varied, p: Varied) -> Varied:
        """The data (m, nq) of the pieces at states of a phase."""
        values, slopes = self.flows[phase].piece_data(x.values, p.values)
        return Varied(values, slopes @ p.by)

    def rates(self, phase: str, x: Array, p: Varied) -> Array:
        """The rates (m, size) at states (m, size) of a phase."""
        flow = self.flows[phase]
        return flow.fields(x, np.hstack([p.values, flow.data_of_pieces(x, p.values)]))[0]

    def after(self, phase: str, begin: Varied, time: Varied, p: Varied) -> Varied:
        """The states (m, size) of motions of a phase after times (m, 1)."""
        flow, (m, _, columns) = self.flows[phase], p.by.shape
        # Each column is a motion of its own, so that one stepper serves any number of them.
        lanes, few = np.repeat(np.arange(m), columns or 1), min(columns, 1)
        seeds = [by.swapaxes(1, 2).reshape(len(lanes), by.shape[1], few) for _, by in (begin, p)]
        paths, slopes = flow.run_all(begin.values[lanes], p.values[lanes], time.values[lanes, 0], *seeds)
        ends = paths.finals[:: columns or 1, : flow.size]
        rates = self.rates(phase, ends, p)[:, :, None]
        return Varied(ends, slopes.reshape(m, columns, flow.size).swapaxes(1, 2) + rates * time.by)


# The evaluator, cached for the next call with the same arguments.
evaluator = cached(Evaluator)


def by_logarithm(statement: Statement) -> Array:
    """Whether each of the unknowns (n,) of a statement is positive, so that its changes are measured by its logarithm:
    the times, and the speed of a launch that has no other; the others may have either sign."""
    return np.isin(statement.unknowns, statement.durations)


@cached
def _of_extreme(
    model: Model, names: tuple[str, ...], extreme: str, index: int, at_start: bool
) -> Callable[..., Varied]:
    """`extreme_function` of varied arguments, or `start_function`."""
    function = (start_function if at_start else extreme_function)(model, names, extreme, index)
    arguments = function.sx_in()
    return of_varied(arguments, function.call(arguments))


def _data_of(phase: Phase) -> ca.SX:
    """Symbols of the data of a phase's pieces."""
    return ca.SX.sym("q", phase.pieces.size if phase.pieces else 0)


def of_varied(arguments: list[ca.SX], results: list) -> Callable[..., Varied]:
    """The function from arguments, columns of symbols, to results, where both are varied."""
    value = ca.vertcat(*results)
    slopes = ca.jacobian(value, ca.vertcat(*arguments))
    function = MappedFunction(ca.Function("slopes", arguments, [ca.densify(value), ca.densify(slopes)]))

    def along(*varied: Varied) -> Varied:
        found, slopes = function(*(each.values for each in varied))
        return Varied(found[:, :, 0], slopes @ np.concatenate([each.by for each in varied], axis=1))

    return along
