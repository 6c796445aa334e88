"""Mechanisms whose springs are straight lines: their matrices, from which their motions follow without integration."""

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..laws.law import Parameters
from ..model.modes import Modes, linear_modes
from ..model.relative import straight_line
from .elements import Spring
from .lagrange import Mechanics
from .terms import Term


class LinearEquations(NamedTuple):
    """The equations M y'' = -K y + f of a flight, in contact with a gap that stays closed.

    inertia, stiffness, load : M, K (n, n) and f (n,)
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    load: np.ndarray


class Linear:
    """A mechanism whose springs are straight lines, under constant gravity and without losses."""

    def __init__(self, mechanics: Mechanics):
        self.mechanics, c, flight = mechanics, mechanics.coordinates, mechanics.in_flight
        self.springs = [term for term in flight.terms if isinstance(term.element, Spring)]
        weight = sum((term.gradient for term in flight.terms if term.is_weight), ca.SX(c.size, 1))
        self._weight, self._inertia = c.coefficients(ca.densify(weight)), c.coefficients(flight.inertia)
        self._along = c.coefficients(ca.horzcat(*(term.gradient for term in self.springs)))
        self._offsets = c.coefficients(ca.horzcat(*(c.at_zero(term.place) for term in self.springs)))
        self.embed = mechanics.gap.embed[:, : c.size - 1]

    @classmethod
    def of(cls, mechanics: Mechanics) -> "Linear | None":
        """The linear form of a mechanism; None where it is not linear."""
        c, flight = mechanics.coordinates, mechanics.in_flight
        linear = mechanics.conservative and not mechanics.gravity.varies and not c.actuators
        linear = linear and not c.varies(flight.inertia)
        return cls(mechanics) if linear and all(map(_is_straight(mechanics), flight.terms)) else None

    def equations(self, p: Parameters) -> LinearEquations:
        """The matrices at parameters."""
        inertia, along = np.array(self._inertia(p), dtype=float), np.array(self._along(p), dtype=float)
        load = -np.ravel(self._weight(p)).astype(float)
        stiffness = np.zeros(inertia.shape)
        for term, direction, offset in zip(self.springs, along.T, self._offsets(p)[0], strict=True):
            k, zero = straight_line(self.mechanics.law_of(term.element), p)
            stiffness += k * np.outer(direction, direction)
            load -= k * (offset - zero) * direction
        return LinearEquations(inertia, stiffness, load)

    def flight(self, p: Parameters) -> Modes:
        """The exact flow of the flight."""
        return linear_modes(*self.equations(p))

    def contact(self, p: Parameters) -> Modes:
        """The exact flow of the contact, with the contact force."""
        (inertia, stiffness, load), embed, m = self.equations(p), self.embed, self.mechanics
        weights, value = np.zeros(m.size - 1), 0.0
        along, offsets = np.array(self._along(p), dtype=float), self._offsets(p)[0]
        place = {id(term.element): j for j, term in enumerate(self.springs)}
        for coefficient, term in zip(m.in_contact.force_coefficients(p)[0], m.in_contact.terms, strict=True):
            if (j := place.get(id(term.element))) is None:
                value += coefficient
                continue
            k, zero = straight_line(self.mechanics.law_of(term.element), p)
            weights += coefficient * k * (along[:, j] @ embed)
            value += coefficient * k * (offsets[j] - zero)
        force = np.kron(weights, [1.0, 0.0]), float(value)
        return linear_modes(
            embed.T @ inertia @ embed, embed.T @ stiffness @ embed, load @ embed, {"contact force": force}
        )


def _is_straight(mechanics: Mechanics) -> Callable[[Term], bool]:
    """Whether a term is a weight, or a spring whose law and whose extension are straight lines."""
    c = mechanics.coordinates

    def is_straight(term: Term) -> bool:
        if isinstance(term.element, Spring):
            return mechanics.law_of(term.element).degree() == 1 and c.affine(term.place) is not None
        return term.is_weight and not c.varies(term.gradient)

    return is_straight
