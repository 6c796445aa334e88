"""The whole `Model` of a mechanism, derived from its mechanics."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..symbolic.exclusive import exclusive
from .coefficients import Coefficients
from .elements import Element, Scalar, Spring, names_in, value_of
from .laws import Key, Parameters, Scalars
from .linear import Linear, LinearEquations
from .mechanics import GRAVITY_SHARE, Mechanics, weighted_sum
from .model import Knee, Model
from .one_law import launch_of
from .phase import Affine, Phase
from .relative import pieces_along, reach_along
from .state_formula import StateFormula

# What a model says where the mechanism has no words of its own.
USUAL_WORDS = {
    "liftoff": "the force at which the contact opens",
    "gap": "the gap closes in flight",
    "pull": "the contact would have to pull",
    "separation": "parts of the machine pass through each other",
    "end": "contact: it never opens again",
}


class Structure(NamedTuple):
    """A mechanism without the values of its parameters, see `Mechanism`; equal ones share a model."""

    name: str
    coordinates: tuple[str, ...]
    elements: tuple[Element, ...]
    gap: Scalar
    inertia: tuple[tuple[Scalar, ...], ...]
    gravity: Key
    surface_gravity: Scalar
    counts: Scalar
    launch: str | None
    heights: tuple[tuple[str, Scalar], ...]
    separation: Scalar | None
    energy_unit: Scalar
    rest: tuple[tuple[str, Scalar], ...]
    knees: tuple[tuple[str | None, str, Scalar], ...]
    actuators: tuple[tuple[str, str], ...]
    words: tuple[tuple[str, str], ...]
    parameters: tuple[str, ...]


@exclusive
@lru_cache(maxsize=64)
def derived_model(structure: Structure) -> Model:
    """The model of a mechanism; raises `InputError` for what is no mechanism."""
    s, mechanics = structure, _mechanics_of(structure)
    parts = _Parts(structure, mechanics)
    launch = launch_of(mechanics, parts.words["liftoff"], dict(s.rest).get(parts.launched_name, 0.0))
    linear = Linear.of(mechanics)
    moves_alone = launch is not None and launch.reduction and mechanics.conservative and not s.actuators
    still = launch if moves_alone and not mechanics.varying else None
    return Model(
        name=s.name,
        flight=parts.flight(linear and linear.flight),
        contact=parts.contact(linear and linear.contact),
        launch=parts.launch,
        launch_unknowns=parts.launch_unknowns,
        liftoff=parts.liftoff,
        landing=parts.landing,
        reversor=(1, -1) * mechanics.size if mechanics.conservative and not s.actuators else None,
        release=launch.relative.release if launch else parts.no_release,
        touchdown=parts.touchdown,
        embed=parts.embed,
        flight_gradient=parts.flight_gradient,
        contact_gradient=parts.contact_gradient,
        extension=parts.extension,
        gap=lambda p: parts.gap,
        separation=parts.separation,
        heights=parts.heights,
        impact_mass=parts.impact_mass,
        impact=parts.impact,
        contact_speed=parts.contact_speed,
        violations={name: parts.words[name] for name in ("gap", "pull", "separation", "end")},
        springs=parts.drawn,
        homotopy=GRAVITY_SHARE if mechanics.varying else None,
        conservative=mechanics.conservative and not s.actuators,
        reduction=still and still.reduction,
        tension=parts.tension,
        search=launch.relative.search if launch and mechanics.conservative else None,
        relative=launch.relative if launch and moves_alone else None,
        rest=parts.rest if s.rest else None,
        knees=parts.knees if s.knees else None,
    )


@lru_cache(maxsize=64)
def derived_launch(structure: Structure) -> str:
    """The coordinate that is launched."""
    return _Parts(structure, _mechanics_of(structure)).launched_name


@exclusive
def linear_equations(structure: Structure, p: Parameters) -> LinearEquations:
    """The matrices of a mechanism whose springs are straight lines; raises `InputError` for another."""
    linear = Linear.of(_mechanics_of(structure))
    if linear is None:
        raise InputError(f"the {structure.name} is not linear: a law or an extension of it is no straight line")
    return linear.equations(p)


@lru_cache(maxsize=64)
def _mechanics_of(s: Structure) -> Mechanics:
    return Mechanics(
        s.coordinates, s.actuators, s.elements, s.inertia, s.gap, s.gravity, s.surface_gravity, s.parameters
    )


class _Parts:
    """The parts of a model, see `Model` for each, from the mechanics of a structure."""

    def __init__(self, structure: Structure, mechanics: Mechanics):
        self.structure, self.mechanics, self.size = structure, mechanics, mechanics.size
        self.words = {**USUAL_WORDS, **dict(structure.words)}
        places = [state for name in structure.coordinates for state in (name, f"{name}'")]
        self.states = (*places, *(name for name, _ in structure.actuators))
        self.springs = [element for element in structure.elements if isinstance(element, Spring)]
        kept = [mechanics.moved[i] for i in mechanics.kept]
        names = [state for name in kept[: self.size - 1] for state in (name, f"{name}'")]
        launched = structure.launch or kept[self.size - 2]
        if launched not in kept:
            raise InputError(f"launch '{launched}' is no coordinate of the contact; those are {', '.join(kept)}")
        own = {launched: "liftoff", f"{launched}'": "alpha"}
        self.contact_states = (*names, *kept[self.size - 1 :])
        self.launched, self.launched_name = names.index(launched), launched  # its place in the contact state
        self.unknowns = [own.get(name, name) for name in names]
        others = tuple(name for name in self.unknowns if name not in ("liftoff", "alpha"))
        self.launch_unknowns = ("liftoff", "alpha", *others)
        self.embed = self._embed()
        ends = len(structure.actuators)
        self.gap = Affine(_interleaved([*mechanics.gap.tolist(), *[0.0] * ends], ends))
        self.gap_speed = Affine(_interleaved(mechanics.gap.tolist(), ends, 1))
        self.extension = self._numbers(structure.counts, "counts")
        self.contact_speed = Affine(tuple(float(i == self.launched + 1) for i in range(len(self.contact_states))))
        self._heights = [(name, self._function(height)) for name, height in structure.heights]
        self._distance = None if structure.separation is None else self._function(structure.separation)
        unit = mechanics.scalar(structure.energy_unit)
        self._impact_mass = Coefficients(mechanics.impact_mass / unit, mechanics.y, mechanics.p)
        self.flight_gradient = self._gradient(
            mechanics.terms, mechanics.gradients, mechanics.inertia, mechanics.y, unit
        )
        self.contact_gradient = self._gradient(
            mechanics.contact_terms, mechanics.contact_gradients, mechanics.contact_inertia, mechanics.s, unit
        )
        self.drawn = self._drawn()

    def _embed(self) -> np.ndarray:
        """The matrix from contact states to flight states."""
        n, ends, embed = self.size, len(self.structure.actuators), self.mechanics.embed
        matrix = np.zeros((2 * n + ends, 2 * n - 2 + ends))
        matrix[: 2 * n : 2, : 2 * n - 2 : 2] = matrix[1 : 2 * n : 2, 1 : 2 * n - 2 : 2] = embed[:n, : n - 1]
        matrix[2 * n :, 2 * n - 2 :] = np.eye(ends)
        return matrix

    def _function(self, expression: Scalar) -> Callable:
        """p -> a height or distance as a function of the flight state."""
        found, ends = self.mechanics.affine(expression), len(self.structure.actuators)
        if found is None and not isinstance(expression, str):
            raise InputError("a height that is no sum of coordinates is a formula of coordinates and parameters")
        if found is None:
            names = names_in(expression) & set(self.structure.parameters)
            return lambda p: StateFormula(expression, self.states, {name: p[name] for name in names})

        def affine(p: Parameters) -> Affine:
            *weights, offset = found(p)[0]
            return Affine(_interleaved(weights, ends), offset)

        return affine

    def _numbers(self, expression: Scalar, what: str) -> Affine:
        """A sum of coordinates with numbers before them as a function of the flight state."""
        found = self.mechanics.affine(expression)
        if found is None or np.isnan(found.constants[:-1]).any():
            raise InputError(
                f'{what} = {expression!r} is no sum of coordinates with numbers before them, as "body - foot"'
            )
        return Affine(_interleaved(found.constants[:-1], len(self.structure.actuators)))

    def flight(self, closed_form: Callable | None) -> Phase:
        """The flight."""
        pieces, reaches = self._along(np.eye(len(self.mechanics.moved)))
        return Phase("flight", self.states, self.mechanics.flight, {}, pieces, closed_form, reaches)

    def contact(self, closed_form: Callable | None) -> Phase:
        """The contact."""
        watch, (pieces, reaches) = {"contact force": self.mechanics.contact_force}, self._along(self.mechanics.embed)
        return Phase("contact", self.contact_states, self.mechanics.contact, watch, pieces, closed_form, reaches)

    def _along(self, embed: np.ndarray) -> tuple[Any, tuple]:
        """The `pieces` and the `reaches` of a phase whose coordinates `embed` turns into all."""
        pieces, reaches, ends = None, list[tuple](), len(self.structure.actuators)
        for spring in self.springs:
            weights = self._weights(spring.extension, embed, ends)
            if spring.force.pieces and (pieces or weights is None):
                raise InputError(
                    f"spring '{spring.force.text}': one law in pieces can be taken, along a sum of coordinates"
                )
            if weights:
                pieces = pieces or pieces_along(spring.force, weights)
                reaches += reach_along(spring.force, weights)
        for term in self.mechanics.terms if self.mechanics.varying else ():
            if term.what == "gravity" and (weights := self._weights(term.place, embed, ends)) and any(weights):
                reaches += reach_along(self.mechanics.gravity, weights)
        return pieces, tuple(dict.fromkeys(reaches))

    def _weights(self, expression: Scalar, embed: np.ndarray, ends: int) -> tuple[float, ...] | None:
        found = self.mechanics.affine(expression)
        if found is None or np.isnan(found.constants[:-1]).any():
            return None
        return _interleaved((np.array(found.constants[:-1]) @ embed).tolist(), ends)

    def launch(self, u: Parameters, p: Parameters) -> list[Any]:
        """The flight state at lift-off."""
        return [weighted_sum(row, self._released(u)) for row in self.embed.tolist()]

    def touchdown(self, u: Parameters, p: Parameters) -> list[Any]:
        """The contact state after a lossless landing."""
        return [value if i % 2 == 0 else -value for i, value in enumerate(self._released(u))]

    def _released(self, u: Parameters) -> list[Any]:
        """The contact state at lift-off, with the actuators where they rest."""
        return [*(u[name] for name in self.unknowns), *(0.0 for _ in self.structure.actuators)]

    def liftoff(self, u: Parameters, p: Parameters, q: Scalars) -> Any:
        """What vanishes at lift-off: the force of the contact, below 0 beyond."""
        return self.mechanics.contact_force(self._released(u), p, q)

    def landing(self, u: Parameters, x: Scalars, p: Parameters) -> list[Any]:
        """What vanishes at a lossless landing."""
        launched = 2 * self.mechanics.kept[self.launched // 2]
        return [*(weighted_sum(each.weights, x) for each in (self.gap, self.gap_speed)), x[launched] - u["liftoff"]]

    def no_release(self, alpha: ArrayLike, p: Parameters) -> np.ndarray:
        """Refuses a launch that is more than a speed."""
        raise InputError(f"a launch of a {self.structure.name} is more than a speed: give the flight state")

    def impact_mass(self, x: Scalars, p: Parameters) -> Any:
        """Twice the energy that a plastic impact loses, over the square of the gap's speed."""
        return self._impact_mass(p, self._place(x))[0][0]

    def impact(self, x: Scalars, p: Parameters) -> list[Any]:
        """The direction in which an impact changes the flight state."""
        return list(_interleaved(self.mechanics.impact(p, self._place(x))[0], len(self.structure.actuators), 1))

    def _place(self, x: Scalars) -> list[Any]:
        """The coordinates, with the actuators' displacements, of a flight state."""
        ends = len(x) - len(self.structure.actuators)
        return [*x[:ends:2], *x[ends:]]

    def separation(self, p: Parameters) -> Affine | StateFormula | None:
        """The distance that must stay positive."""
        return self._distance and self._distance(p)

    def rest(self, p: Parameters) -> list[Any]:
        """The flight state at rest with the springs unloaded."""
        places = dict(self.structure.rest)
        each = [value_of(places.get(name, 0.0), {}, p) for name in self.mechanics.moved]
        return list(_interleaved(each, len(self.structure.actuators)))

    def knees(self, p: Parameters) -> list[Knee]:
        """The pairs of heights that a knee joins."""
        return [(lower, upper, float(value_of(length, {}, p))) for lower, upper, length in self.structure.knees]

    def heights(self, p: Parameters) -> dict[str, Affine | StateFormula]:
        """The heights by name."""
        return {name: height(p) for name, height in self._heights}

    def tension(self, x: Scalars, p: Parameters, q: Scalars) -> Any:
        """The force of the first spring in a flight state."""
        spring, (y, _) = self.springs[0], self.mechanics.positions_and_rates(x, p)
        place = dict(zip(self.mechanics.moved, y, strict=True))
        return spring.force.expression(value_of(spring.extension, place, p), p, q)

    def _gradient(self, terms: Sequence, gradients: ca.SX, inertia: ca.SX, place: ca.SX, unit: ca.SX) -> Callable:
        """(x, p, q) -> the gradient of the energy in a phase, in a unit of energy."""
        mechanics, (rates, columns) = self.mechanics, (inertia.shape[0], len(terms))
        slopes = gradients @ ca.SX(np.diag([float(term.conservative) for term in terms])) / unit
        of_forces = Coefficients(slopes, place, mechanics.p)
        of_rates = Coefficients(inertia / unit, place, mechanics.p)
        assert of_forces.shape[1] == columns
        turning = mechanics.turning(inertia / unit, place)

        def gradient(x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
            own, v = mechanics.positions_and_rates(x, p)
            y, all_rates = mechanics.embedded(own, v)
            rows, masses = of_forces(p, own), of_rates(p, own)
            forces = mechanics.forces(terms, rows, y, all_rates, p, q)
            by_place = [weighted_sum(row, forces) + turn for row, turn in zip(rows, turning(own, v, p), strict=True)]
            by_rate = [weighted_sum(row, v[:rates]) for row in masses]
            pairs = [part for pair in zip(by_place, by_rate, strict=False) for part in pair]
            return [*pairs, *by_place[rates:]]

        return gradient

    def _drawn(self) -> tuple[tuple[str | None, str], ...]:
        """The pairs of heights, lower and upper, that a spring joins; None is the ground."""
        mechanics, known = self.mechanics, dict[tuple, str | None]()
        for name, height in self.structure.heights:
            if (weights := self._weights(height, np.eye(len(mechanics.moved)), 0)) is not None:
                known.setdefault(weights, name)
        pairs = []
        for spring in self.springs:
            weights = self._weights(spring.extension, np.eye(len(mechanics.moved)), 0)
            if weights is None:
                continue
            if weights in known:
                pairs.append((None, known[weights]))
            pairs += [
                (low, high)
                for a, high in known.items()
                for b, low in known.items()
                if np.array_equal(np.subtract(a, b)[: 2 * self.size], weights[: 2 * self.size])
            ]
        return tuple(dict.fromkeys(pairs))


def _interleaved(weights: Sequence[Any], ends: int, first: int = 0) -> tuple[Any, ...]:
    """Weights of coordinates, or where `first` is 1 of their rates, as weights of the states, of which the last `ends`
    have no rates."""
    pairs = weights[: len(weights) - ends] if ends and not first else weights
    states = [weight if place == first else 0.0 for weight in pairs for place in (0, 1)]
    return (*states, *(weights[len(weights) - ends :] if ends and not first else [0.0] * ends))
