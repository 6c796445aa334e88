"""Mechanisms whose forces are straight lines: their matrices, from which their motions follow without integration."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..laws import Parameters, Scalars
from ..model import LANDED_FORCE, NORMAL_FORCE, TANGENTIAL_FORCE, Modes, linear_modes, straight_line
from ..symbolic import ExactExpression, inner_product, rows_of, total
from .coordinates import Coordinates
from .elements import Potential, Spring
from .lagrange import Mechanics
from .reactions import Reactions
from .stepping import Stepping
from .terms import Term


class LinearEquations(NamedTuple):
    """The equations M y'' = -K y + f of a flight, in contact with a gap that stays closed.

    inertia, stiffness, load : M, K (n, n) and f (n,)
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    load: np.ndarray


class Linear:
    """A mechanism whose springs are straight lines and whose potentials are quadratic, under constant gravity and
    without losses.

    straight : the forces of springs and potentials, each k (along . y + offset - zero) against its own direction, where
        springs have k and zero by their laws, and potentials 1 and 0
    """

    def __init__(self, mechanics: Mechanics, steps: Stepping | None, reactions: Reactions | None):
        self.mechanics, c, flight, self.steps = mechanics, mechanics.coordinates, mechanics.in_flight, steps
        self.reactions = reactions
        self.straight = [term for term in flight.terms if not term.is_weight]
        n, weights = c.size, [term.gradient for term in flight.terms if term.is_weight]
        weight = [total(each[i] for each in weights) for i in range(n)]
        self._weight, self._inertia = (
            c.coefficients([[each] for each in weight]),
            c.coefficients(flight.kinetics.matrix),
        )
        forces = [_straight_force(c, term) for term in self.straight]
        against, along = [term.gradient[:n] for term in self.straight], [c.gradient(force)[:n] for force in forces]
        self._against, self._along = (c.coefficients(rows_of(each, n)) for each in (against, along))
        self._offsets = c.coefficients([list(map(c.at_zero, forces))])
        self.embed = mechanics.gap.embed[:, : mechanics.gap.own]

    @classmethod
    def of(
        cls, mechanics: Mechanics, steps: Stepping | None = None, reactions: Reactions | None = None
    ) -> "Linear | None":
        """The linear form of a mechanism; None where it is not linear."""
        c, flight = mechanics.coordinates, mechanics.in_flight
        linear = mechanics.conservative and not mechanics.gravity.varies and not c.actuators
        linear = linear and not c.varies(each for row in flight.kinetics.matrix for each in row)
        linear = linear and flight.quadratic is None and not (reactions and reactions.by_rates)
        return cls(mechanics, steps, reactions) if linear and all(map(_is_straight(mechanics), flight.terms)) else None

    def equations(self, p: Parameters) -> LinearEquations:
        """The matrices at parameters."""
        inertia, along, against = (
            np.array(each(p), dtype=float) for each in (self._inertia, self._along, self._against)
        )
        load = -np.ravel(self._weight(p)).astype(float)
        stiffness = np.zeros(inertia.shape)
        for term, own, direction, offset in zip(self.straight, along.T, against.T, self._offsets(p)[0], strict=True):
            k, zero = self._line(term, p)
            stiffness += k * np.outer(direction, own)
            load -= k * (offset - zero) * direction
        return LinearEquations(inertia, stiffness, load)

    def flight(self, p: Parameters) -> Modes:
        """The exact flow of the flight."""
        watch, reactions = dict[str, tuple[np.ndarray, float]](), self.reactions
        if reactions and reactions.planar.stands:
            watch = self._forces(reactions.flight.rows(p), np.eye(self.mechanics.size), p)
        return linear_modes(*self.equations(p), watch)

    def _forces(self, rows: Sequence[Scalars], embed: np.ndarray, p: Parameters) -> dict[str, tuple[np.ndarray, float]]:
        """The forces of the ground."""
        terms, offsets = self.mechanics.in_flight.terms, self._offsets(p)[0]
        each = (self._watched(row, terms, embed, offsets, p) for row in rows)
        return dict(zip((NORMAL_FORCE, TANGENTIAL_FORCE), each, strict=True))

    def contact(self, p: Parameters) -> Modes:
        """The exact flow of the contact, with the contact force."""
        (inertia, stiffness, load), embed, m = self.equations(p), self.embed, self.mechanics
        offsets = self._offsets(p)[0]
        rows = zip(m.names_of_forces, m.in_contact.force_coefficients(p), strict=True)
        watch = {name: self._watched(row, m.in_contact.terms, embed, offsets, p) for name, row in rows}
        if self.steps and self.steps.row:
            back = self.steps.states(self.steps.relabelling).inverse
            signs, shifts = np.array(back.signs[::2]), np.array(back.shifts(p)[::2], dtype=float)
            before = np.array(offsets) + shifts @ np.array(self._along(p), dtype=float)
            terms, row = m.in_flight.terms, self.steps.row(p)[0]
            watch[LANDED_FORCE] = self._watched(row, terms, signs[:, None] * embed, before, p)
        if self.reactions:
            watch |= self._forces(self.reactions.contact.rows(p), embed, p)
        return linear_modes(embed.T @ inertia @ embed, embed.T @ stiffness @ embed, load @ embed, watch)

    def _watched(
        self, row: Scalars, terms: Sequence[Term], embed: np.ndarray, offsets: Scalars, p: Parameters
    ) -> tuple[np.ndarray, float]:
        """Weights of the contact states in a sum of the terms, and its value where these are 0."""
        weights, value, along = np.zeros(embed.shape[1]), 0.0, np.array(self._along(p), dtype=float)
        place = {_owner_of(term): j for j, term in enumerate(self.straight)}
        for coefficient, term in zip(row, terms, strict=True):
            if term.is_weight:
                value += coefficient
                continue
            (k, zero), j = self._line(term, p), place[_owner_of(term)]
            weights += coefficient * k * (along[:, j] @ embed)
            value += coefficient * k * (offsets[j] - zero)
        return np.kron(weights, [1.0, 0.0]), float(value)

    def _line(self, term: Term, p: Parameters) -> tuple[float, float]:
        """Stiffness and zero of a force."""
        if isinstance(term.element, Potential):
            return 1.0, 0.0
        return straight_line(self.mechanics.law_of(term.element), p)


def _owner_of(term: Term) -> int:
    """One number for the terms of one force in flight and in contact."""
    return id(term.force if isinstance(term.element, Potential) else term.element)


def _straight_force(c: Coordinates, term: Term) -> ExactExpression:
    """The extension of a spring, or the force of a potential."""
    if isinstance(term.element, Potential):
        return inner_product(term.gradient, c.gradient(term.element.energy))
    return c.scalar(term.place)


def _is_straight(mechanics: Mechanics) -> Callable[[Term], bool]:
    """Whether a term is a weight, a spring whose law and whose extension are straight lines, or the force of a
    quadratic potential."""
    c = mechanics.coordinates

    def is_straight(term: Term) -> bool:
        if isinstance(term.element, Spring):
            return mechanics.law_of(term.element).degree() == 1 and c.affine(term.place) is not None
        if isinstance(term.element, Potential):
            return not c.varies(c.gradient(_straight_force(c, term)))
        return term.is_weight and not c.varies(term.gradient)

    return is_straight
