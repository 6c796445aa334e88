"""Mechanisms whose springs are straight lines: their matrices, from which their motions follow without integration."""

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..laws.law import Parameters
from ..model.modes import Modes, linear_modes
from ..model.relative import straight_line
from .elements import Spring
from .lagrange import Mechanics, at_zero
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
        self.mechanics, m = mechanics, mechanics
        self.springs = [(i, term) for i, term in enumerate(m.terms) if isinstance(term.element, Spring)]
        weight = sum((term.gradient for term in m.terms if term.is_weight), ca.SX(m.size, 1))
        self._weight, self._inertia = m.coefficients(ca.densify(weight)), m.coefficients(m.inertia)
        self._along = m.coefficients(ca.horzcat(*(term.gradient for _, term in self.springs)))
        self._offsets = m.coefficients(ca.horzcat(*(self._offset(term) for _, term in self.springs)))
        self.embed = m.embed[:, : m.size - 1]

    @classmethod
    def of(cls, mechanics: Mechanics) -> "Linear | None":
        """Those of a mechanism; None for one that is not linear."""
        linear = mechanics.conservative and not mechanics.varying and not mechanics.actuators
        linear = linear and not mechanics.varies(mechanics.inertia)
        return cls(mechanics) if linear and all(map(_is_straight(mechanics), mechanics.terms)) else None

    def _offset(self, term: Term) -> ca.SX:
        """The extension of a spring where all coordinates are 0."""
        return at_zero(self.mechanics.scalar(term.place), self.mechanics.y)

    def equations(self, p: Parameters) -> LinearEquations:
        """The matrices at parameters."""
        inertia, along = np.array(self._inertia(p), dtype=float), np.array(self._along(p), dtype=float)
        load = -np.ravel(self._weight(p)).astype(float)
        stiffness = np.zeros(inertia.shape)
        for (_, term), direction, offset in zip(self.springs, along.T, self._offsets(p)[0], strict=True):
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
        place = {id(term.element): j for j, (_, term) in enumerate(self.springs)}
        for coefficient, term in zip(m.contact_force_coefficients(p)[0], m.contact_terms, strict=True):
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

    def is_straight(term: Term) -> bool:
        if isinstance(term.element, Spring):
            return mechanics.law_of(term.element).degree() == 1 and mechanics.affine(term.place) is not None
        return term.is_weight and not mechanics.varies(term.gradient)

    return is_straight
