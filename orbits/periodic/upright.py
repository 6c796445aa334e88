"""The upright motions of a model with a mirror: its lateral coordinates, which the mirror turns over, are 0 in them.

A reversor R that turns some places over is the flip of all rates, which turns back motions without friction, and the
mirror that turns these places over with their rates. So upright motions, as the vertical hop of a runner, are those of
a smaller model. Where its lateral states are 0 an expression has a parameter that is 0: put in as a number, it would
leave roots of squares, as sqrt(0 + y**2), which have no Taylor series.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import casadi as ca
import numpy as np

from ..errors import InputError, NoOrbit
from ..laws.law import Algebraic, Parameters, Scalars
from ..model.linear_guess import linear_guess
from ..model.machine import Machine
from ..model.model import CONTACT_FORCE, Model, as_derived, names_of_holding
from ..model.phase import Affine, Phase
from ..model.relative import FASTEST_IN_DETAIL, Search, half_angle
from ..model.state_formula import StateFormula
from ..symbolic.calls import single_assignment

# The mirror is checked at this number of random places, to this share of the largest rate.
PLACES_CHECKED, MIRRORED_TO = 8, 1e-9
# The launch speeds at which a search for nonlinear upright motions begins are apart by this share of their scale.
SPACING = 0.05
# Two slopes of a field that agree to this share are the same; Newton steps to the extension at lift-off.
STRAIGHT_TO, MOST_STEPS_TO_LIFTOFF = 1e-9, 40


@dataclass(frozen=True, eq=False)
class Mirrored:
    """The states of a model with a mirror, by phase: the numbers of those that it leaves as they are, the upright ones,
    and of those that it turns over, the lateral ones.

    Raises `InputError` for a model that has no mirror, and for one that changes its point of contact.
    """

    model: Model

    def __post_init__(self) -> None:
        model = self.model
        if model.reversor is None or not self.coordinates:
            raise InputError(
                f"time reversal turns over no coordinate of a {model.name}: without a mirror nothing branches off its "
                'upright motion; state reversor={"angle": "-angle"} for a coordinate that leans'
            )
        if len(self.coordinates) == len(model.flight.states) // 2 or model.landing_gap or model.changes_contact:
            raise InputError(
                f"a {model.name} has no upright motion: its reversor turns over "
                + ("every coordinate" if not model.changes_contact else "its points of contact")
            )
        if not self._holds:
            raise InputError(f"the mirror of {', '.join(self.coordinates)} changes the equations of a {model.name}")

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the lateral coordinates."""
        signs = zip(self.model.flight.states, self.model.reversor or (), strict=False)
        return tuple(name for name, sign in signs if sign < 0 and not name.endswith("'"))

    def lateral(self, phase: Phase) -> list[int]:
        """The numbers of the lateral states of a phase."""
        return [i for i, name in enumerate(phase.states) if name.removesuffix("'") in self.coordinates]

    def upright(self, phase: Phase) -> list[int]:
        """The numbers of the upright states of a phase."""
        lateral = self.lateral(phase)
        return [i for i in range(len(phase.states)) if i not in lateral]

    def whole(self, phase: Phase, upright: Scalars) -> list[Algebraic]:
        """The state of a phase whose upright states are these."""
        own = dict(zip(self.upright(phase), upright, strict=False))
        return [own.get(i, 0.0) for i in range(len(phase.states))]

    @cached_property
    def _holds(self) -> bool:
        """Whether the mirror turns fields and forces into themselves, at random places near the state at rest."""
        names, random = tuple(self._values), np.random.default_rng(0)
        holding = names_of_holding(self.model.sticks)
        for phase in (self.model.flight, self.model.contact):
            signs = np.ones(len(phase.states))
            signs[self.lateral(phase)] = -1
            watched = {CONTACT_FORCE: 1.0, **dict.fromkeys(holding, -1.0)} if phase is self.model.contact else {}
            x, p = ca.SX.sym("x", len(phase.states)), ca.SX.sym("p", len(names))
            states, known = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True))
            q = phase.data(states, known)
            results = [*phase.field(states, known, q), *(phase.watch[name](states, known, q) for name in watched)]
            function = ca.Function("mirrored", [x, p], [ca.densify(ca.vertcat(*results))])
            turned = np.append(signs, list(watched.values()))
            for _ in range(PLACES_CHECKED):
                values = random.uniform(0.5, 1.5, len(names))
                place = random.uniform(0.5, 1.5, len(signs))
                one, other = (np.array(function(each, values)).ravel() for each in (place, signs * place))
                apart = np.abs(other - turned * one)
                if np.isfinite(apart).all() and apart.max() > MIRRORED_TO * max(1.0, np.abs(one).max()):
                    return False
        return True

    @cached_property
    def _values(self) -> tuple[str, ...]:
        """The names of the parameters that the phases use."""
        return _names_used(self.model)


def _names_used(model: Model) -> tuple[str, ...]:
    """The names of the parameters that the phases of a model look up."""

    class Noted(dict):
        def __missing__(self, name: str) -> ca.SX:
            return self.setdefault(name, ca.SX.sym(name))

    noted = Noted()
    for phase in (model.flight, model.contact):
        x = ca.vertsplit(ca.SX.sym("x", len(phase.states)))
        q = phase.data(x, noted)
        phase.field(x, noted, q)
        for watched in phase.watch.values():
            watched(x, noted, q)
    return tuple(noted)


@lru_cache(maxsize=64)
def mirrored(model: Model) -> Mirrored:
    """The mirror of a model; raises `InputError` where it has none."""
    return Mirrored(model)


@dataclass(frozen=True)
class UprightMachine:
    """The machine of the upright motions of another one, as `find` takes it."""

    machine: Machine

    @property
    def model(self) -> Model:
        """Its kind."""
        return upright_model(self.machine.model)

    @property
    def values(self) -> dict[str, float]:
        """Its parameters."""
        return self.machine.values

    units, restitution = None, 0.0

    @property
    def rest_length(self) -> float | None:
        """As in `Machine`."""
        return self.machine.rest_length

    def with_values(self, **values: float) -> Self:
        """As in `Machine`."""
        return replace(self, machine=self.machine.with_values(**values))

    def describe(self) -> dict[str, Any]:
        """As in `Machine`."""
        return self.machine.describe() | {"machine": f"upright {self.model.name}"}


@lru_cache(maxsize=64)
def upright_model(model: Model) -> Model:
    """The model of the upright motions of a model with a mirror."""
    m = mirrored(model)
    flight, contact = m.upright(model.flight), m.upright(model.contact)
    unknowns = [name for name in model.launch_unknowns if name.removesuffix("'") not in m.coordinates]
    whole = lambda x: m.whole(model.flight, x)  # noqa: E731

    def affine(function: Affine) -> Affine:
        return Affine(tuple(function.weights[i] for i in flight), function.offset)

    def function(of: Affine | StateFormula) -> Affine | StateFormula:
        if isinstance(of, Affine):
            return affine(of)
        names = tuple(of.states[i] for i in flight)
        lateral = {name: 0.0 for name in of.states if name not in names}
        return StateFormula(of.text, names, {**of.values, **lateral}, of.sizes and tuple(of.sizes[i] for i in flight))

    def gradient(x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        found = model.flight_gradient(whole(x), p, q)
        return [found[i] for i in flight]

    def impact(x: Scalars, p: Parameters) -> list[Algebraic]:
        found = model.impact(whole(x), p)
        return [found[i] for i in flight]

    def of_distance(p: Parameters) -> Affine | StateFormula | None:
        distance = model.separation(p)
        return None if distance is None else function(distance)

    def rest(p: Parameters) -> list[Algebraic]:
        found = model.rest(p) if model.rest else [0.0] * len(model.flight.states)
        return [found[i] for i in flight]

    found = replace(
        model,
        name=model.name,
        flight=upright_phase(m, model.flight),
        contact=upright_phase(m, model.contact),
        launch_unknowns=tuple(unknowns),
        reversor=tuple(model.reversor[i] for i in flight) if model.reversor else None,
        reversor_shift=None,
        symmetry=None,
        symmetry_shift=None,
        release=lambda alpha, p: _released(found, alpha, p),
        embed=np.array(model.embed)[np.ix_(flight, contact)],
        flight_gradient=gradient,
        extension=affine(model.extension),
        gap=lambda p: affine(model.gap(p)),
        guess=lambda family, p: linear_guess(found, family, p),
        separation=of_distance,
        heights=lambda p: {name: function(height) for name, height in model.heights(p).items()},
        impact_mass=lambda x, p: model.impact_mass(whole(x), p),
        impact=impact,
        tension=None,
        spring_forces={},
        spring_dimensions={},
        reduction=None,
        liftoff_slope=None,
        search=lambda p: _search(found, p),
        rest=rest,
        planar=None,
        feet=(),
        sticks=(),
        sticking=None,
    )
    return as_derived(found)


def upright_phase(m: Mirrored, phase: Phase) -> Phase:
    """The phase of the upright states."""
    places = m.upright(phase)

    def field(x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        found = phase.field(m.whole(phase, x), p, q)
        return without_corners([found[i] for i in places])

    def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
        (found,) = without_corners([phase.watch[CONTACT_FORCE](m.whole(phase, x), p, q)])
        return found

    watch = {CONTACT_FORCE: force} if CONTACT_FORCE in phase.watch else {}
    if phase.pieces:
        raise InputError("a law in pieces has no second derivatives: branch points of machines with one are not found")
    reaches = tuple((tuple(weights[i] for i in places), step) for weights, step in phase.reaches)
    return Phase(phase.name, tuple(phase.states[i] for i in places), field, watch, reaches=reaches)


def without_corners(expressions: Sequence[Algebraic]) -> list[Algebraic]:
    """Expressions with x or -x in place of the absolute value of x, by its sign where all symbols are near 1."""
    if not any(isinstance(each, ca.SX) for each in expressions):
        return list(expressions)
    whole = ca.densify(ca.vertcat(*expressions))
    symbols = ca.symvar(whole)
    function, near = ca.Function("with_corners", symbols, [whole]), np.linspace(0.97, 1.03, len(symbols))
    instructions = single_assignment(function)
    if not any(op == ca.OP_FABS for op, *_ in instructions):
        return ca.vertsplit(whole)
    values, results = list[ca.SX](), [ca.SX(0)] * whole.numel()
    for op, arguments, constant in instructions:
        if op == ca.OP_OUTPUT:
            results[arguments[2]] = values[arguments[0]]
            values.append(values[arguments[0]])
        elif op == ca.OP_INPUT:
            values.append(symbols[arguments[0]])
        elif op == ca.OP_CONST:
            values.append(ca.SX(constant))
        elif op == ca.OP_FABS:
            inside = values[arguments[0]]
            values.append(inside if float(ca.Function("inside", symbols, [inside])(*near)) > 0 else -inside)
        else:
            taken = [values[i] for i in arguments]
            values.append(ca.SX.unary(op, *taken) if len(taken) == 1 else ca.SX.binary(op, *taken))
    return results


@lru_cache(maxsize=64)
def _liftoff_force(model: Model, names: tuple[str, ...]) -> ca.Function:
    """(liftoff, alpha, parameters) -> the contact force at launch, and its derivative by the first."""
    u, p = ca.SX.sym("u", 2), ca.SX.sym("p", len(names))
    known = dict(zip(names, ca.vertsplit(p), strict=True))
    (force,) = model.liftoff({"liftoff": u[0], "alpha": u[1]}, known, [])
    return ca.Function("force", [u, p], [force, ca.jacobian(force, u)[0]])


def _released(model: Model, alpha: Any, p: Mapping[str, float]) -> np.ndarray:
    """As `Model.release`, by Newton's method from where the machine rests with its springs unloaded."""
    if not model.one_speed:
        raise InputError(f"an upright launch of a {model.name} is more than a speed: state the upright orbit, start=")
    force, numbers, alphas = _liftoff_force(model, tuple(p)), list(p.values()), np.atleast_1d(alpha).astype(float)
    rest, place = model.rest(p), model.flight.states.index(model.launched[0])
    found = np.full(alphas.shape, float(rest[place]))
    for i, speed in enumerate(alphas.tolist()):
        for _ in range(MOST_STEPS_TO_LIFTOFF):
            value, slope = (float(each) for each in force([found[i], speed], numbers))
            step = -value / slope if slope else np.nan
            found[i] += step
            if not np.abs(step) > 1e-15 * np.abs(found[i]):
                break
        if not np.isfinite(found[i]):
            raise NoOrbit(f"no force of a {model.name} lifts its foot: its lift-off is not found")
    return found


def _search(model: Model, p: Mapping[str, float]) -> Search:
    """How to search for upright orbits, from the motion with straight lines in place of the forces."""
    near = linear_guess(model, 1, p)
    flight, names, rest = model.flight, tuple(p), np.array(model.rest(p), dtype=float)
    x, known = ca.SX.sym("x", len(rest)), ca.SX.sym("p", len(names))
    rates = flight.field(ca.vertsplit(x), dict(zip(names, ca.vertsplit(known), strict=True)), [])
    slopes = ca.Function("slopes", [x, known], [ca.jacobian(ca.vertcat(*rates), x)])
    one, other = (np.array(slopes(share * rest, list(p.values()))) for share in (1.0, 0.75))
    straight = bool(np.abs(one - other).max() <= STRAIGHT_TO * np.abs(one).max())
    scale, pace = near["alpha"] / half_angle(1), near["duration"] / near["alpha"]
    return Search(scale, SPACING, FASTEST_IN_DETAIL, straight, pace)
