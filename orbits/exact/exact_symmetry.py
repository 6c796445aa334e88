"""Time reversal of the equations of a stated machine, decided exactly.

Let the reversor R of the flight take coordinates y to D y + d, and their rates v to -D v, with a matrix D of signs; the
relabelling S takes y to E y + e, and v to E v. A flight from a launch x that comes to a state R leaves as it is
continues to R x, if R turns the equations: M(R y) = D M(y) D for the inertia, and F(R y, R v) = D F(y, v) for the
forces. The contact begins at S R x, and continues to Rc S R x = x from a state that Rc = S R leaves as it is, if Rc
turns its equations. Both need that R and Rc are their own inverses, and that Rc takes the closed gap to itself.

The force on the point that lands, at a state z before the relabelling, is that on the point that opens at R z, since R
takes one gap to the other. So in the contact, at S z, it is that at Rc S z = R z.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from ..symbolic import ZERO, Column, ExactExpression, derivative_by, substitute, total, vanishes
from .refusal import Unproved


@dataclass(frozen=True)
class ExactReversor:
    """The map of coordinates y to signs y + shifts, and of their rates v to -signs v."""

    signs: tuple[int, ...]
    shifts: Column

    @classmethod
    def of(
        cls, images: Sequence[ExactExpression], y: Sequence[ExactExpression], names: Sequence[str]
    ) -> "ExactReversor":
        """The map of coordinates to these images; raises `Unproved` for another kind of map."""
        signs = list[int]()
        for i, each in enumerate(images):
            slopes = [derivative_by(each, place) for place in y]
            sign = next((sign for sign in (1, -1) if all(x.is_(sign * (i == j)) for j, x in enumerate(slopes))), 0)
            if not sign:
                raise Unproved(f"'{names[i]}' must be mapped to itself or its negative, plus an amount")
            signs.append(sign)
        return cls(tuple(signs), substitute(images, dict.fromkeys(y, ZERO)))

    def after(self, first: "ExactReversor") -> "ExactReversor":
        """The map of coordinates that does `first`, and then this one."""
        signs = tuple(a * b for a, b in zip(self.signs, first.signs, strict=True))
        return ExactReversor(signs, [ZERO if vanishes(each) else each for each in self.places(first.shifts)])

    def on(self, coordinates: Sequence[int]) -> "ExactReversor":
        """The map of some coordinates alone."""
        return ExactReversor(tuple(self.signs[i] for i in coordinates), [self.shifts[i] for i in coordinates])

    def places(self, y: Sequence[ExactExpression]) -> Column:
        """The images of coordinates."""
        return [sign * each + shift for sign, each, shift in zip(self.signs, y, self.shifts, strict=True)]

    def rates(self, v: Sequence[ExactExpression]) -> Column:
        """The images of rates."""
        return [-sign * each for sign, each in zip(self.signs, v, strict=True)]

    def turned(self, functions: Sequence[ExactExpression], y: Column, v: Column) -> Column:
        """Functions of the image of a state, as functions of the state."""
        return substitute(functions, dict(zip([*y, *v], [*self.places(y), *self.rates(v)], strict=True)))

    def fixed(self, y: Column, v: Column) -> Column:
        """The functions that vanish where a state is its own image."""
        each = zip(self.signs, y, v, self.shifts, strict=True)
        return [rate if sign > 0 else place - shift / 2 for sign, place, rate, shift in each]

    def check_turns(
        self, what: str, y: Column, v: Column, inertia: Sequence[Column], forces: Sequence[Column],
        weights: Sequence[Fraction] = (), breaks: Sequence[ExactExpression] = (),
    ) -> int:  # fmt: skip
        """Raise `Unproved` unless the map is its own inverse and turns the equations with this inertia and these forces
        (laws, n), where the laws change at breakpoints of a sum of coordinates with these weights. Returns 1 where the
        image of a state has the law with the same number, and -1 where that is so counted from the last law."""
        signs = self.signs
        if not all(vanishes(shift) for sign, shift in zip(signs, self.shifts, strict=True) if sign > 0):
            raise Unproved(f"{what} is not its own inverse")
        for sign, row in zip(signs, inertia, strict=True):
            images = zip(signs, row, self.turned(row, y, v), strict=True)
            if not all(vanishes(image - sign * other * each) for other, each, image in images):
                raise Unproved(f"{what} does not preserve the inertia")
        order = next((sign for sign, weight in zip(signs, weights, strict=False) if weight), 1)
        turned = all(sign == order for sign, weight in zip(signs, weights, strict=False) if weight)
        shift = total(weight * each for weight, each in zip(weights, self.shifts, strict=False))
        if not (turned and all(vanishes(order * a + shift - b) for a, b in zip(breaks, breaks[::order], strict=True))):
            raise Unproved(f"{what} does not map the breakpoints of the spring's law to themselves")
        for own, other in zip(forces, forces[::order], strict=True):
            images = zip(signs, own, self.turned(other, y, v), strict=True)
            if not all(vanishes(image - sign * each) for sign, each, image in images):
                raise Unproved(f"{what} does not reverse the forces; a spring may have to be odd")
        return order
