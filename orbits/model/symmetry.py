"""Maps of states that flip signs and shift places: the reversors of motions, and the relabelling of contacts.

Let R be the reversor of the flight and S the relabelling, which names the contact that opens next. A lossless orbit is
launched at x0 and lands at R x0; the relabelled machine stands at S R x0, and mid-contact is fixed by the reversor of
the contact Rc = S R. With S the identity, and R the flip of all speeds, the machine returns to the same contact.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..laws import Algebraic, Parameters, Scalars
from .phase import Affine, is_used

# p -> the shifts (n,) of a state, numbers, arrays (m,) or expressions.
Shift: TypeAlias = Callable[[Parameters], Scalars]


def _moved_by(value: Algebraic, sign: int, shift: Algebraic) -> Algebraic:
    turned = -value if sign < 0 else value
    return turned + shift if is_used(shift) else turned


@dataclass(frozen=True, eq=False)
class SignedShift:
    """The map x -> signs x + shift of a state x (n,).

    signs : (n,), each 1 or -1
    shift : None where it is 0
    """

    signs: tuple[int, ...]
    shift: Shift | None = None

    def shifts(self, p: Parameters) -> list[Algebraic]:
        """The shifts (n,); shifts that vanish are the number 0."""
        return [0.0] * len(self.signs) if self.shift is None else list(self.shift(p))

    def __call__(self, states: np.ndarray, p: Parameters) -> np.ndarray:
        """The images (..., n) of states (..., n), with shifts that are numbers."""
        return states * np.array(self.signs) + np.array(self.shifts(p), dtype=float)

    def image(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The image (n,) of a state."""
        if self.shift is None:
            return [-value if sign < 0 else value for value, sign in zip(x, self.signs, strict=True)]
        return list(map(_moved_by, x, self.signs, self.shifts(p)))

    def fixed(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The expressions that vanish on the states that the map, its own inverse, leaves as they are."""
        each = zip(x, self.shifts(p), self.signs, strict=True)
        return [_moved_by(value, 1, -0.5 * shift) for value, shift, sign in each if sign < 0]

    def after(self, first: "SignedShift") -> "SignedShift":
        """The map that does `first` and then this one."""
        signs = tuple(a * b for a, b in zip(self.signs, first.signs, strict=True))
        moves = self.shift is not None or first.shift is not None
        return SignedShift(signs, (lambda p: self.image(first.shifts(p), p)) if moves else None)

    @property
    def inverse(self) -> "SignedShift":
        """The map back."""
        if self.shift is None:
            return self
        return SignedShift(self.signs, lambda p: [-s * d for s, d in zip(self.signs, self.shifts(p), strict=True)])

    def of(self, function: Affine, p: Parameters) -> Affine:
        """An affine function of the image of a state, as a function of the state."""
        weights = tuple(weight * sign for weight, sign in zip(function.weights, self.signs, strict=True))
        return Affine(weights, function.at(self.shifts(p)))

    def rows(self, coefficients: np.ndarray, p: Parameters) -> np.ndarray:
        """Taylor coefficients (N, n, K + 1) of the images, from those of rows (N, rows, K + 1) that begin with the
        states, and parameters that are numbers or (N,)."""
        found = coefficients[:, : len(self.signs)] * np.array(self.signs)[:, None]
        for i, shift in enumerate(self.shifts(p)):
            found[:, i, 0] += shift
        return found
