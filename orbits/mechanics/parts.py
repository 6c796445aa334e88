"""The parts of a model, from the equations of a mechanism."""

from collections.abc import Callable, Sequence
from copy import copy
from fractions import Fraction
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..laws.law import Key, Parameters, Scalars
from ..model.model import Knee
from ..model.phase import Affine, Phase
from ..model.relative import pieces_along, reach_along
from ..model.state_formula import StateFormula
from .coefficients import Coefficients, Symbols
from .elements import Scalar, Spring, names_in, value_of
from .lagrange import Mechanics
from .lone_extension import Alone
from .structure import USUAL_WORDS, Structure
from .terms import Term, weighted_sum


class _Slopes(NamedTuple):
    """What the gradient of an energy is made of: the coefficients of forces and of rates, and the slopes of the kinetic
    energy by the coordinates."""

    by_forces: Coefficients
    by_rates: Coefficients
    turning: Callable


class Parts:
    """The parts of a model, see `Model` for each, from the mechanics of a structure."""

    def __init__(self, structure: Structure, mechanics: Mechanics):
        self.structure, self.mechanics, self.size = structure, mechanics, mechanics.size
        self.words = {**USUAL_WORDS, **dict(structure.words)}
        places = [state for name in structure.coordinates for state in (name, f"{name}'")]
        self.states = (*places, *(name for name, _ in structure.actuators))
        self.springs = [element for element in structure.elements if isinstance(element, Spring)]
        # The contact: its states, and which of its coordinates is launched.
        kept = [mechanics.moved[i] for i in mechanics.kept]
        names = [state for name in kept[: self.size - 1] for state in (name, f"{name}'")]
        launched = structure.launch or kept[self.size - 2]
        if launched not in kept[: self.size - 1]:
            known = ", ".join(kept[: self.size - 1])
            raise InputError(f"launch '{launched}' is no coordinate of the contact; those are {known}")
        own = {launched: "liftoff", f"{launched}'": "alpha"}
        self.contact_states = (*names, *kept[self.size - 1 :])
        self.launched, self.launched_name = names.index(launched), launched  # its place in the contact state
        self.unknowns = [own.get(name, name) for name in names]
        others = tuple(name for name in self.unknowns if name not in ("liftoff", "alpha"))
        self.launch_unknowns = ("liftoff", "alpha", *others)
        self.embed = self._embed()
        self._rows = self.embed.tolist()
        # What is linear in the flight state; the displacements of the actuators come last in it.
        ends = len(structure.actuators)
        self.gap = Affine(_interleaved([*mechanics.gap.tolist(), *[0.0] * ends], ends))
        self.gap_speed = Affine(_interleaved(mechanics.gap.tolist(), ends, 1))
        self.extension = self._numbers(structure.counts, "counts")
        self.counted = self._counted()
        self.contact_speed = Affine(tuple(float(i == self.launched + 1) for i in range(len(self.contact_states))))
        # What may be any function of it, and what impacts and energies are made of.
        self._heights = [(name, self._function(height)) for name, height in structure.heights]
        self._distance = None if structure.separation is None else self._function(structure.separation)
        unit = mechanics.scalar(structure.energy_unit)
        self._impact_mass = mechanics.coefficients(mechanics.impact_mass / unit)
        self._in_flight = self._slopes(
            mechanics.terms, mechanics.gradients, mechanics.inertia, mechanics.in_flight, unit
        )
        self._in_contact = self._slopes(
            mechanics.contact_terms, mechanics.contact_gradients, mechanics.contact_inertia, mechanics.in_contact, unit
        )
        self.drawn, self.alone = self._drawn(), Alone.of(mechanics)

    def with_laws(self, laws: Sequence[Key]) -> "Parts":
        """The parts with the laws of the springs."""
        found = copy(self)
        found.mechanics = self.mechanics.with_laws(laws)
        return found

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
        if found is None:
            if not isinstance(expression, str):
                raise InputError("a height that is no sum of coordinates is a formula of coordinates and parameters")
            text, names = expression, names_in(expression) & set(self.structure.parameters)
            return lambda p: StateFormula(text, self.states, {name: p[name] for name in names})

        def affine(p: Parameters) -> Affine:
            *weights, offset = found(p)[0]
            return Affine(_interleaved(weights, ends), offset)

        if not found.places:
            fixed = affine({})
            return lambda p: fixed
        return affine

    def _numbers(self, expression: Scalar, what: str) -> Affine:
        """A sum of coordinates with numbers before them as a function of the flight state."""
        weights = self.mechanics.weights(expression)
        if weights is None or not any(weights[: self.size]):
            raise InputError(
                f'{what} = {expression!r} is no sum of coordinates with numbers before them, as "body - foot"'
            )
        return Affine(_interleaved(list(map(float, weights)), len(self.structure.actuators)))

    def flight(self, closed_form: Callable | None) -> Phase:
        """The flight."""
        pieces, reaches = self._along(contact=False)
        return Phase("flight", self.states, self.mechanics.flight, {}, pieces, closed_form, reaches)

    def contact(self, closed_form: Callable | None) -> Phase:
        """The contact."""
        watch, (pieces, reaches) = {"contact force": self.mechanics.contact_force}, self._along(contact=True)
        return Phase("contact", self.contact_states, self.mechanics.contact, watch, pieces, closed_form, reaches)

    def _along(self, contact: bool) -> tuple[Any, tuple]:
        """The `pieces` and the `reaches` of the contact, or of the flight."""
        pieces, reaches = None, list[tuple]()
        for spring in self.springs:
            weights = self._weights(spring.extension, contact)
            law = self.mechanics.law_of(spring)
            if law.pieces and (pieces or weights is None):
                raise InputError(f"spring '{law.text}': one law in pieces can be taken, along a sum of coordinates")
            if weights:
                pieces = pieces or pieces_along(law, weights)
                reaches += reach_along(law, weights)
        for term in self.mechanics.terms if self.mechanics.varying else ():
            if term.what == "gravity" and (weights := self._weights(term.place, contact)) and any(weights):
                reaches += reach_along(self.mechanics.gravity, weights)
        return pieces, tuple(dict.fromkeys(reaches))

    def _weights(self, expression: Scalar, contact: bool) -> tuple[float, ...] | None:
        """The weights of the states of a phase in an expression that is a sum of coordinates; None for another."""
        if (weights := self.mechanics.weights(expression)) is None:
            return None
        own = self.mechanics.weights_in_contact(weights) if contact else weights
        return _interleaved(list(map(float, own)), len(self.structure.actuators))

    def _counted(self) -> list[tuple[Spring, Coefficients]]:
        """The springs along the extension that is counted, however long at rest, each with the change of its own
        extension per change of that one; none where such a ratio depends on the configuration."""
        mechanics, weights = self.mechanics, self.mechanics.weights(self.structure.counts) or []
        along = ca.vertcat(*map(mechanics.numerals.number, weights[: self.size]))
        found = list[tuple[Spring, Coefficients]]()
        for spring in self.springs:
            gradient = mechanics.gradient(spring.extension)[: self.size]
            ratio = ca.dot(gradient, along) / ca.dot(along, along)
            numbers = mechanics.coefficients(ca.vertcat(ratio, gradient - ratio * along))
            if any(each != 0 for each in numbers.exact[1:]) or numbers.exact[0] == 0:
                continue
            if numbers.by_coordinates:
                return []
            found.append((spring, mechanics.coefficients(ratio)))
        return found

    def launch(self, u: Parameters, p: Parameters) -> list[Any]:
        """The flight state at lift-off."""
        released = self._released(u)
        return [weighted_sum(row, released) for row in self._rows]

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
        """What vanishes at a lossless landing: the gap, its speed and its acceleration.

        Where the contact has one coordinate, this being as at lift-off says the last. So it is stated too where a law
        is in pieces, of which a landing is not told the one that holds."""
        closed = [weighted_sum(each.weights, x) for each in (self.gap, self.gap_speed)]
        if self.size == 2 or any(law.pieces for law in self.mechanics.laws):
            return [*closed, x[2 * self.mechanics.kept[self.launched // 2]] - u["liftoff"]]
        return [*closed, weighted_sum(self.gap_speed.weights, self.mechanics.flight(x, p, []))]

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
        """The force of all springs against the extension that is counted, in a flight state."""
        y, _ = self.mechanics.positions_and_rates(x, p)
        place = dict(zip(self.mechanics.moved, y, strict=True))
        forces = [
            self.mechanics.law_of(spring).expression(value_of(spring.extension, place, p), p, q)
            for spring, _ in self.counted
        ]
        return weighted_sum([ratio(p)[0][0] for _, ratio in self.counted], forces)

    def _slopes(
        self, terms: Sequence[Term], gradients: ca.SX, inertia: ca.SX, symbols: Symbols, unit: ca.SX
    ) -> _Slopes:
        """What the gradient of the energy in a phase is made of, in a unit of energy."""
        mechanics = self.mechanics
        of_forces = gradients @ ca.SX(np.diag([float(term.conservative) for term in terms])) / unit
        forces, rates = (mechanics.coefficients(matrix, symbols) for matrix in (of_forces, inertia / unit))
        return _Slopes(forces, rates, mechanics.turning(inertia / unit, symbols))

    def flight_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        """The gradient of the energy in flight."""
        return self._gradient(self._in_flight, self.mechanics.terms, x, p, q)

    def contact_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        """The gradient of the energy in contact."""
        return self._gradient(self._in_contact, self.mechanics.contact_terms, x, p, q)

    def _gradient(self, slopes: _Slopes, terms: Sequence[Term], x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        mechanics = self.mechanics
        own, v = mechanics.positions_and_rates(x, p)
        rows, masses = slopes.by_forces(p, own), slopes.by_rates(p, own)
        forces = mechanics.forces(terms, rows, mechanics.embedded(own, v), p, q)
        by_place = [weighted_sum(row, forces) + turn for row, turn in zip(rows, slopes.turning(own, v, p), strict=True)]
        by_rate = [weighted_sum(row, v[: len(masses)]) for row in masses]
        pairs = [part for pair in zip(by_place, by_rate, strict=False) for part in pair]
        return [*pairs, *by_place[len(masses) :]]

    def _drawn(self) -> tuple[tuple[str | None, str], ...]:
        """The pairs of heights, lower and upper, that a spring joins; None is the ground."""
        mechanics, known = self.mechanics, dict[tuple[Fraction, ...], str]()
        for name, height in self.structure.heights:
            if (weights := mechanics.weights(height)) is not None:
                known.setdefault(tuple(weights), name)
        pairs = list[tuple[str | None, str]]()
        for spring in self.springs:
            if (weights := mechanics.weights(spring.extension)) is None:
                continue
            if tuple(weights) in known:
                pairs.append((None, known[tuple(weights)]))
            pairs += [
                (low, high)
                for a, high in known.items()
                for b, low in known.items()
                if [upper - lower for upper, lower in zip(a, b, strict=True)][: self.size] == weights[: self.size]
            ]
        return tuple(dict.fromkeys(pairs))


def _interleaved(weights: Sequence[Any], ends: int, first: int = 0) -> tuple[Any, ...]:
    """Weights of coordinates, or where `first` is 1 of their rates, as weights of the states, of which the last `ends`
    have no rates."""
    pairs = weights[: len(weights) - ends] if ends and not first else weights
    states = [weight if place == first else 0.0 for weight in pairs for place in (0, 1)]
    return (*states, *(weights[len(weights) - ends :] if ends and not first else [0.0] * ends))
