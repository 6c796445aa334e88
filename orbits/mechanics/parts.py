"""The parts of a model, from the equations of a mechanism."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..laws import Algebraic, Key, Parameters, Scalars
from ..model import (
    LANDED_FORCE,
    LANDED_HOLDING,
    Affine,
    Knee,
    Phase,
    Pieces,
    SignedShift,
    StateFormula,
    pieces_along,
    weighted_sum,
)
from ..symbolic import ZERO, exact_number, inner_product
from .coefficients import Coefficients
from .coordinates import Coordinates
from .elements import Scalar, Spring, names_in, value_of
from .lagrange import Mechanics, forces_of
from .lone_extension import Alone
from .reactions import Reactions, reactions_of
from .stepping import Stepping, steps_of
from .structure import USUAL_WORDS, Structure, words_of_gaps


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of a model, see `Model` for each, from the mechanics of a structure.

    launched : the coordinate that is launched
    extension, extension_offset : of the spring that is counted, as in `Model`
    counted : as from `_counted`
    height_functions, distance : p -> the heights, by name, and the separation, each as a function of the flight state
    mass, mass_on_points : of impacts, functions of the coordinates: of the speeds of the gap and of what sticks, and
        with the impulses as those across and along the ground
    by_forces, by_rates, turning : the gradient of the energy per force and per rate, and the slopes of the kinetic
        energy by the coordinates
    drawn : as `Model.springs`
    alone : the extension that moves alone, None where none does
    steps : the maps of a machine that steps, None where one point lands and opens again
    reactions : the forces of the ground, None where no mass states where it is across
    """

    structure: Structure
    mechanics: Mechanics
    launched: str
    extension: Affine
    extension_offset: Callable | None
    counted: list[tuple[Spring, Coefficients]]
    height_functions: dict[str, Callable]
    distance: Callable | None
    mass: Coefficients
    mass_on_points: Coefficients
    by_forces: Coefficients
    by_rates: Coefficients
    turning: Callable
    drawn: tuple[tuple[str | None, str], ...]
    alone: Alone | None
    steps: Stepping | None
    reactions: Reactions | None

    @classmethod
    def of(cls, s: Structure, mechanics: Mechanics) -> "Parts":
        """The parts of a structure whose springs have no laws yet."""
        c, flight, left = mechanics.coordinates, mechanics.in_flight, mechanics.gap.left[: mechanics.gap.own]
        known = [c.names[i] for i in left]
        launched = s.launch or known[-1]
        if launched not in known:
            raise InputError(
                f"launch '{launched}' is not a coordinate of the contact; choose one of {', '.join(known)}"
            )
        unit = c.scalar(s.energy_unit)
        over = [1 / unit if term.conservative else ZERO for term in flight.terms]
        of_forces = [[each * own for each, own in zip(row, over, strict=True)] for row in flight.gradients]
        matrices = flight.impact_mass, flight.kinetics.matrix
        masses, inertia = ([[each / unit for each in row] for row in matrix] for matrix in matrices)
        steps = steps_of(c, s, mechanics)
        return cls(
            s, mechanics, launched, _sum_of_coordinates(c, s.counts, "counts"), _offset(c, s.counts), _counted(c, s),
            {name: _height(c, height) for name, height in s.heights},
            None if s.separation is None else _height(c, s.separation),
            c.coefficients(masses), c.coefficients(mechanics.gap.on_points(masses)),
            c.coefficients(of_forces), c.coefficients(inertia), mechanics.turning(unit),
            _drawn(c, s), Alone.of(mechanics), steps, reactions_of(mechanics, s.inertia, s.friction, steps, s.hangs),
        )  # fmt: skip

    def with_laws(self, laws: Sequence[Key]) -> "Parts":
        """The parts with the laws of the springs."""
        return replace(self, mechanics=self.mechanics.with_laws(laws))

    @property
    def words(self) -> dict[str, str]:
        """The words of messages."""
        named = words_of_gaps([name for name, _ in self.structure.gaps]) if self.steps else {}
        return {**USUAL_WORDS, **named, **dict(self.structure.words)}

    @property
    def _ends(self) -> int:
        return len(self.structure.actuators)

    @property
    def _states_in_contact(self) -> list[str]:
        """The coordinates that move in contact with their speeds, then what sticks anywhere."""
        names = [self.structure.coordinates[i] for i in self.mechanics.gap.left[: self.mechanics.gap.own]]
        return [*(state for name in names for state in (name, f"{name}'")), *self.structure.anywhere]

    @property
    def launch_unknowns(self) -> tuple[str, ...]:
        """The names of the unknowns of a launch."""
        own = (self.launched, f"{self.launched}'")
        return ("liftoff", "alpha", *(name for name in self._states_in_contact if name not in own))

    @property
    def embed(self) -> np.ndarray:
        """The matrix from contact states to flight states."""
        n, ends, embed, own = self.mechanics.size, self._ends, self.mechanics.gap.embed, self.mechanics.gap.own
        still = len(self.structure.anywhere)
        matrix = np.zeros((2 * n + ends, 2 * own + still + ends))
        matrix[: 2 * n : 2, : 2 * own : 2] = matrix[1 : 2 * n : 2, 1 : 2 * own : 2] = embed[:n, :own]
        matrix[: 2 * n : 2, 2 * own : 2 * own + still] = embed[:n, own : own + still]
        matrix[2 * n :, 2 * own + still :] = np.eye(ends)
        return matrix

    @property
    def height(self) -> Callable | None:
        """p -> the gap as a formula; None where it is a sum of coordinates."""
        gap = None if self.mechanics.gap.height is None else self.structure.gap
        return None if gap is None else _height(self.mechanics.coordinates, gap)

    @property
    def segments(self) -> dict[str, tuple[float, ...]]:
        """The weights of the flight states in the angles of limbs, by name."""
        c, each = self.mechanics.coordinates, self.structure.segments
        return {name: _sum_of_coordinates(c, angle, f"segment '{name}'").weights for name, angle in each}

    @property
    def gap(self) -> Affine:
        """The gap."""
        return Affine(_interleaved([*self.mechanics.gap.numbers.tolist(), *[0.0] * self._ends], self._ends))

    def maps(self, reversible: bool) -> dict[str, Any]:
        """The reversor, the relabelling and the landing gap of a model, whose motions may be turned back or not."""
        n, steps, feet = self.mechanics.size, self.steps, tuple(name for name, _ in self.structure.gaps)
        if steps is None:
            return {"reversor": (1, -1) * n if reversible else None}
        label, back = steps.states(steps.relabelling), steps.states(steps.reversor)
        found: dict[str, Any] = {"landing_gap": steps.landing_gap(self.mechanics.gap.weights), "reversor": None}
        found["feet"] = 2 * feet if len(feet) == 1 else feet
        if steps.reversible and reversible:
            found |= {"reversor": back.signs, "reversor_shift": back.shift}
        if label.shift or label.signs != (1,) * len(label.signs):
            found |= {"symmetry": label.signs, "symmetry_shift": label.shift}
        return found

    def flight(self, closed_form: Callable | None) -> Phase:
        """The flight."""
        m, pieces = self.mechanics, self._pieces(contact=False)
        watch = self.reactions.watch(m, contact=False) if self.reactions and self.reactions.planar.stands else {}
        return Phase("flight", _states(m.coordinates), m.flight, watch, pieces, closed_form)

    def contact(self, closed_form: Callable | None) -> Phase:
        """The contact."""
        forces, pieces = enumerate(self.mechanics.names_of_forces), self._pieces(contact=True)
        watch: dict[str, Callable] = {name: partial(self.mechanics.contact_force, held=i) for i, name in forces}
        if self.steps and self.steps.row:
            watch[LANDED_FORCE] = self.steps.landed_force(self.mechanics)
        elif self.steps and self.steps.turned:
            watch |= self._forces_on_landed()
        if self.reactions:
            watch |= self.reactions.watch(self.mechanics, contact=True)
        states = (*self._states_in_contact, *(name for name, _ in self.structure.actuators))
        return Phase("contact", states, self.mechanics.contact, watch, pieces, closed_form)

    def _forces_on_landed(self) -> dict[str, Callable]:
        """The forces on the point that has landed, of a machine that stands on both: those on the point that opens, in
        the labels of before."""
        assert self.steps is not None
        back = self.steps.states(self.steps.relabelling).inverse
        places = [_states(self.mechanics.coordinates).index(name) for name in self._states_in_contact]
        own = SignedShift(tuple(back.signs[i] for i in places), lambda p: [back.shifts(p)[i] for i in places])

        def before(x: Scalars, p: Parameters, q: Scalars, held: int) -> Algebraic:
            return self.mechanics.contact_force(own.image(x, p), p, q, held)

        return {name: partial(before, held=i) for i, name in enumerate((LANDED_FORCE, LANDED_HOLDING))}

    @property
    def hysteretic(self) -> tuple[float, ...] | None:
        """The weights of the rate of the spring with hysteresis in the flight state, None without one; raises
        `InputError` for several, and for an extension whose rate is not a sum of speeds."""
        springs = self.mechanics.hysteretic
        if not springs:
            return None
        weights, text = self.mechanics.coordinates.weights(springs[0].extension), springs[0].extension
        if len(springs) > 1:
            several = (
                "springs with hysteresis, but only one can be followed, since at rest their forces depend on "
                "one another"
            )
            raise InputError(f"the {self.structure.name} has {len(springs)} {several}; give the others their `.mean`")
        if weights is None or any(weights[self.mechanics.size :]):
            rate = "the rate of its extension must be a sum of speeds, since it decides which branch holds"
            raise InputError(f"the spring with hysteresis along '{text}': {rate}; use its law's `.mean`")
        return _interleaved(list(map(float, weights[: self.mechanics.size])), self._ends, 1)

    def _pieces(self, contact: bool) -> Pieces | None:
        """The `pieces` of the contact, or of the flight."""
        mechanics, pieces = self.mechanics, None
        for spring in springs_of(self.structure):
            weights = self._weights(spring.extension, contact)
            law = mechanics.law_of(spring)
            if law.pieces and (pieces or weights is None):
                why = (
                    "since a motion is followed across the breakpoints of one extension; state springs along one "
                    "extension as one law, springs.function(force, breakpoints=...), or fit a formula to the others"
                )
                raise InputError(
                    f"spring '{law.text}': a machine may have one law in pieces, along a sum of coordinates, {why}"
                )
            if weights:
                pieces = pieces or pieces_along(law, weights, self._offset(spring.extension))
        return pieces

    def _weights(self, expression: Scalar, contact: bool) -> tuple[float, ...] | None:
        """The weights of the states of a phase in an expression that is a sum of coordinates; None for another."""
        if (weights := self.mechanics.coordinates.weights(expression)) is None:
            return None
        own = self.mechanics.gap.weights_inside(weights) if contact else weights
        return _interleaved(list(map(float, own)), self._ends + contact * len(self.structure.anywhere))

    def _offset(self, expression: Scalar) -> Callable | None:
        """p -> what a sum of coordinates is where all of them are 0; None where that is 0."""
        return _offset(self.mechanics.coordinates, expression)

    def no_release(self, alpha: ArrayLike, p: Parameters) -> np.ndarray:
        """Refuses a launch that is more than a speed."""
        raise InputError(f"a launch of a {self.structure.name} has several numbers: give the flight state")

    def impact_mass(self, x: Scalars, p: Parameters) -> Algebraic:
        """Twice the energy that a plastic impact loses, over the square of the gap's speed."""
        return self.mass(p, self._place(x))[0][0]

    def impact(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The direction in which an impact changes the flight state."""
        return list(_interleaved(self.mechanics.in_flight.impact(p, self._place(x))[0], self._ends, 1))

    def sticking(self, x: Scalars, p: Parameters) -> tuple[list[list[Algebraic]], ...]:
        """The directions of what sticks, and the masses of the speeds of the gap and of that, as in `Model`."""
        place = self._place(x)
        directions = self.mechanics.in_flight.impact(p, place)[1:]
        across = [list(_interleaved(each, self._ends, 1)) for each in directions]
        return across, self.mass(p, place), self.mass_on_points(p, place)

    def _place(self, x: Scalars) -> list[Algebraic]:
        """The coordinates, with the actuators' displacements, of a flight state."""
        ends = len(x) - self._ends
        return [*x[:ends:2], *x[ends:]]

    def separation(self, p: Parameters) -> Affine | StateFormula | None:
        """The distance that must stay positive."""
        return self.distance and self.distance(p)

    def rest(self, p: Parameters) -> list[Algebraic]:
        """The flight state at rest with the springs unloaded."""
        places = dict(self.structure.rest)
        each = [value_of(places.get(name, 0.0), {}, p) for name in self.mechanics.coordinates.moved]
        return list(_interleaved(each, self._ends))

    def knees(self, p: Parameters) -> list[Knee]:
        """The pairs of heights that a knee joins."""
        return [(lower, upper, float(value_of(length, {}, p))) for lower, upper, length in self.structure.knees]

    def heights(self, p: Parameters) -> dict[str, Affine | StateFormula]:
        """The heights by name."""
        return {name: height(p) for name, height in self.height_functions.items()}

    def tension(self, x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
        """The force of all springs against the extension that is counted, in a flight state."""
        y, _ = self.mechanics.positions_and_rates(x, p)
        place = self.mechanics.coordinates.named(y)
        forces = [
            self.mechanics.law_of(spring).expression(value_of(spring.extension, place, p), p, q)
            for spring, _ in self.counted
        ]
        return weighted_sum([ratio(p)[0][0] for _, ratio in self.counted], forces)

    def spring_forces(self) -> dict[str, Callable]:
        """The force of each spring in a flight state, by the names of `names_of_springs`."""

        def force_of(spring: Spring) -> Callable:
            def force(x: Scalars, p: Parameters, q: Scalars) -> Algebraic:
                place = self.mechanics.coordinates.named(self.mechanics.positions_and_rates(x, p)[0])
                return self.mechanics.law_of(spring).expression(value_of(spring.extension, place, p), p, q)

            return force

        springs = springs_of(self.structure)
        return dict(zip(names_of_springs(springs), map(force_of, springs), strict=True))

    def flight_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        """The gradient of the energy in flight."""
        mechanics = self.mechanics
        y, v = mechanics.positions_and_rates(x, p)
        rows, masses = self.by_forces(p, y), self.by_rates(p, y)
        forces = forces_of(mechanics.in_flight.terms, rows, (y, v), p, q)
        by_place = [weighted_sum(row, forces) + turn for row, turn in zip(rows, self.turning(y, v, p), strict=True)]
        by_rate = [weighted_sum(row, v[: len(masses)]) for row in masses]
        pairs = [part for pair in zip(by_place, by_rate, strict=False) for part in pair]
        return [*pairs, *by_place[len(masses) :]]


def springs_of(s: Structure) -> list[Spring]:
    """The springs of a structure."""
    return [element for element in s.elements if isinstance(element, Spring)]


def names_of_springs(springs: Sequence[Spring]) -> list[str]:
    """The names of the springs' forces: "spring force", of several springs with the extension of each, or with its
    number where the extension is not a formula, or also that of another spring."""
    if len(springs) == 1:
        return ["spring force"]
    texts = [spring.extension if isinstance(spring.extension, str) else "" for spring in springs]
    own = [text if text and texts.count(text) == 1 else str(i) for i, text in enumerate(texts, 1)]
    return [f"spring force of {each}" for each in own]


def _states(c: Coordinates) -> tuple[str, ...]:
    """The flight states; the displacements of the actuators, which have no speeds, come last."""
    return (*(state for name in c.names for state in (name, f"{name}'")), *(name for name, _ in c.actuators))


def _height(c: Coordinates, expression: Scalar) -> Callable:
    """p -> a height or distance as a function of the flight state."""
    found, ends = c.affine(expression), len(c.actuators)
    if found is None:
        if not isinstance(expression, str):
            raise InputError(
                "a height that is not a sum of coordinates must be a formula of coordinates and parameters"
            )
        text, names, states = expression, names_in(expression) & c.p.keys(), _states(c)
        return lambda p: StateFormula(text, states, {name: p[name] for name in names})

    def affine(p: Parameters) -> Affine:
        *weights, offset = found(p)[0]
        return Affine(_interleaved(weights, ends), offset)

    if found.places:
        return affine
    fixed = affine({})
    return lambda p: fixed


def _sum_of_coordinates(c: Coordinates, expression: Scalar, what: str) -> Affine:
    """A sum of coordinates with numbers before them as a function of the flight state."""
    weights = c.weights(expression)
    if weights is None or not any(weights[: c.size]):
        raise InputError(
            f'{what} = {expression!r} is not a sum of coordinates with numbers before them, such as "body - foot"'
        )
    return Affine(_interleaved(list(map(float, weights)), len(c.actuators)))


def _offset(c: Coordinates, expression: Scalar) -> Callable | None:
    """p -> the value of an expression where all coordinates are 0; None where that is 0."""
    found = c.coefficients([[c.at_zero(expression)]])
    return None if found.exact[0] == 0 else lambda p: found(p)[0][0]


def _counted(c: Coordinates, s: Structure) -> list[tuple[Spring, Coefficients]]:
    """The springs along the extension that is counted, however long at rest, each with the change of its own
    extension per change of that one; none where such a ratio depends on the configuration."""
    along = list(map(exact_number, (c.weights(s.counts) or [])[: c.size]))
    found = list[tuple[Spring, Coefficients]]()
    for spring in springs_of(s):
        gradient = c.gradient(spring.extension)[: c.size]
        ratio = inner_product(gradient, along) / inner_product(along, along)
        across = [slope - ratio * each for slope, each in zip(gradient, along, strict=True)]
        numbers = c.coefficients([[ratio, *across]])
        if any(each != 0 for each in numbers.exact[1:]) or numbers.exact[0] == 0:
            continue
        if numbers.by_coordinates:
            return []
        found.append((spring, c.coefficients([[ratio]])))
    return found


def _drawn(c: Coordinates, s: Structure) -> tuple[tuple[str | None, str], ...]:
    """The pairs of heights, lower and upper, that a spring joins; None is the ground."""
    known = dict[tuple[Fraction, ...], str]()
    for name, height in s.heights:
        if (weights := c.weights(height)) is not None:
            known.setdefault(tuple(weights), name)
    pairs = list[tuple[str | None, str]]()
    for spring in springs_of(s):
        if (weights := c.weights(spring.extension)) is None:
            continue
        if tuple(weights) in known:
            pairs.append((None, known[tuple(weights)]))
        pairs += [
            (low, high)
            for a, high in known.items()
            for b, low in known.items()
            if [upper - lower for upper, lower in zip(a, b, strict=True)][: c.size] == weights[: c.size]
        ]
    return tuple(dict.fromkeys(pairs))


def _interleaved(weights: Scalars, ends: int, first: int = 0) -> tuple[Algebraic, ...]:
    """Weights of coordinates, or where `first` is 1 of their rates, as weights of the states; the last `ends`
    states have no rates."""
    last = len(weights) if first else len(weights) - ends
    states = [weight if place == first else 0.0 for weight in weights[:last] for place in (0, 1)]
    return (*states, *(weights[last:] or [0.0] * ends))
