"""How far the state of a vector field may go until one of the functions in it changes by more than its series shows.

A Taylor series at one place does not see a bump, a step or a bend at another, where that has decayed below rounding. A
formula states where: each function that decays or bends has arguments between which it does not vary, and arguments
about which it does. So its argument may change up to the nearest of these, or by the scale of the function if it is
there. The operations between lead such a change back to one of the state, by bounds that hold for all changes up to it
(interval arithmetic, solved for the width of the interval).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

from .calls import single_assignment
from .recursion import affine_degree, applied


class ScaleOptions(NamedTuple):
    """How far the arguments of functions may go in a step."""

    # An exponential of less than minus this, 9e-27, is invisible next to a force, even multiplied by 1e10, nor what is
    # left of 1 in a saturated function. There the argument may go until the exponential is this large.
    hidden: float = 60.0
    # Where they can be seen, arguments of exponentials may change this much: more than series of order 28 ever allow,
    # and little enough that a step cannot pass from one side to the other.
    visible: float = 12.0
    # Where they can be seen, arguments of saturated functions may change this much, for the same reason.
    turn: float = 6.0
    # Share of itself by which a divisor, or what is under a root, may come nearer to 0. A term that is below rounding
    # at the beginning of a step is then at most 100 times as large at its end.
    near_singular: float = 0.99


SCALES = ScaleOptions()


class Room(NamedTuple):
    """By how much a value may fall and rise."""

    down: ca.SX
    up: ca.SX

    @classmethod
    def to_both_sides(cls, change: ca.SX) -> "Room":
        """Equal room on both sides."""
        return cls(change, change)

    @property
    def least(self) -> ca.SX:
        """The lesser of both."""
        return ca.fmin(*self)

    def over(self, factor: ca.SX) -> "Room":
        """The change of a value whose product with a factor changes by this."""
        sides = (self, self[::-1])
        return Room(*(ca.if_else(factor < 0, other, own) / ca.fabs(factor) for own, other in zip(*sides, strict=True)))


class Reach(NamedTuple):
    """A coordinate of the state with `weights` (1, n), functions of the parameters, and how far a step may lead along
    it, a function of the state and the parameters."""

    weights: ca.SX
    change: Room


def reaches_of(field: ca.Function, x: ca.SX, p: ca.SX, waves: bool = False) -> list[Reach]:
    """How far a step of a field (x, p) -> x' may lead along coordinates, none where nothing in it hides, as functions
    of the symbols x and p; an operation without a bound, as a comparison, sets none.

    waves : whether sines count, which hide from samples but not from series
    """
    hiding = _HIDING | _WAVES if waves else _HIDING
    tape = single_assignment(field)
    values, degrees, origins = list[ca.SX](), list[int](), list[frozenset[int]]()
    waving = list[bool]()  # whether a result is by sines
    for i, (op, inputs, constant) in enumerate(tape):
        value, degree, varying = ca.SX() if constant is None else ca.SX(constant), 0, list[int]()
        if op == ca.OP_INPUT:
            value, degree = (x, p)[inputs[0]][inputs[1]], 1 - inputs[0]
        elif op != ca.OP_OUTPUT and constant is None:
            value, varying = applied(op, [values[j] for j in inputs]), [j for j in inputs if degrees[j]]
            degree = affine_degree(op, [degrees[j] for j in inputs])
        # A sum of several states is a coordinate of its own; what follows from one alone leads back to that.
        begins = degree == 1 and len({*varying}) != 1
        values.append(value)
        degrees.append(degree)
        waving.append(op in _WAVES or any(waving[j] for j in varying))
        origins.append(frozenset({i}) if begins else frozenset().union(*(origins[j] for j in varying)))
    allowed: dict[int, Room] = {}  # changes of the results of instructions
    weights = {i: ca.jacobian(values[i], x) for i in frozenset().union(*origins)}
    for i, (op, inputs, _) in reversed(list(enumerate(tape))):
        if op in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST) or degrees[i] == 0:
            continue
        arguments, varies = [values[j] for j in inputs], [degrees[j] > 0 for j in inputs]
        if op in hiding and (len(origins[i]) == 1 or op in _DECAYING):
            for j, change in zip(inputs, hiding[op](arguments, varies), strict=True):
                if change is not None and waving[j] and op not in _DECAYING:
                    (origin,) = origins[i]
                    _allow(allowed, origin, _by_slopes(values[j], x, weights[origin], change))
                else:
                    _allow(allowed, j, change)
        if i in allowed and i not in origins[i]:
            linear = op in _LINEAR_BACK and affine_degree(op, varies) == 1
            back = _LINEAR_BACK[op](arguments, varies, allowed[i]) if linear else ()
            if op in _BACK and not linear:
                back = _BACK[op](arguments, varies, values[i], allowed[i].least)
            for j, change in zip(inputs, back, strict=bool(back)):
                _allow(allowed, j, change)
    coordinates = [i for i in sorted(frozenset().union(*origins)) if i in allowed]
    return [Reach(weights[i], allowed[i]) for i in coordinates]


def kinks_of(field: ca.Function, x: ca.SX, p: ca.SX) -> ca.SX:
    """What vanishes where an absolute value, a sign or a comparison of the state in a field (x, p) -> x' changes its
    branch, functions of the symbols x and p."""
    values, found = list[ca.SX](), list[ca.SX]()
    for op, inputs, constant in single_assignment(field):
        value = ca.SX() if constant is None else ca.SX(constant)
        if op == ca.OP_INPUT:
            value = (x, p)[inputs[0]][inputs[1]]
        elif op != ca.OP_OUTPUT and constant is None:
            value = applied(op, arguments := [values[j] for j in inputs])
            if op in _KINKED and ca.depends_on(kink := _KINKED[op](arguments), x):
                found.append(kink)
        values.append(value)
    return ca.SX(ca.vertcat(*found))


def _by_slopes(value: ca.SX, x: ca.SX, weights: ca.SX, change: ca.SX) -> ca.SX:
    """How far a value of one coordinate, with these weights, changes no more than this by its first and second
    derivative. So are sines bounded, since their intervals are so wide that a step toward a double root of a sum of
    them, as of the inertia of a straight knee, would shrink with the square of the distance."""
    direction = weights.T / (weights @ weights.T)
    slope = ca.jacobian(value, x) @ direction
    first, second = ca.fabs(slope) / change, ca.fabs(ca.jacobian(slope, x) @ direction) / change
    return 2 / (first + ca.sqrt(first**2 + 2 * second))


def _allow(allowed: dict[int, Room], instruction: int, change: Room | ca.SX | None) -> None:
    """Let the result of an instruction change no more than this."""
    if change is not None:
        new = change if isinstance(change, Room) else Room.to_both_sides(change)
        allowed[instruction] = Room(*map(ca.fmin, allowed[instruction], new)) if instruction in allowed else new


_WAVES: dict[int, Callable] = dict.fromkeys((ca.OP_SIN, ca.OP_COS, ca.OP_TAN), lambda a, varies: [ca.SX(SCALES.turn)])
_KINKED: dict[int, Callable] = {
    **dict.fromkeys((ca.OP_FABS, ca.OP_SIGN), lambda a: a[0]),
    **dict.fromkeys((ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE), lambda a: a[0] - a[1]),
}

# Each entry gives, from the arguments (a, b) of an operation and whether each varies, how much each may change; None
# where that is not bounded.


def _of_quotient(a, varies):
    hidden = ca.fabs(a[1]) - ca.fabs(a[0]) * math.exp(SCALES.hidden)  # the quotient stays out of sight
    return [None, ca.fmax(SCALES.near_singular * ca.fabs(a[1]), hidden) if varies[1] else None]


def _of_powers(a, varies):
    whole = ca.logic_and(a[1] >= 1, ca.floor(a[1]) == a[1])  # a polynomial hides nothing
    polynomial = float(whole) if whole.is_constant() else 0.0
    return [None if polynomial else ca.if_else(whole, ca.inf, SCALES.near_singular * ca.fabs(a[0])), None]


def _saturated(turn: float, hidden: float) -> Callable:
    def changes(a, varies):
        # Away from 0 the function saturates, and hides nothing.
        down, up = (ca.if_else(side < 0, ca.inf, ca.fmax(turn, side - hidden)) for side in (a[0], -a[0]))
        return [Room(down, up)]

    return changes


def _exponential(a, varies):
    # One that decreases hides nothing, nor does a large one.
    return [Room(ca.SX(ca.inf), ca.fmax(SCALES.visible + ca.fmax(a[0], 0), -SCALES.hidden - a[0]))]


def _near(distance: Callable) -> Callable:
    """To the singularity at this distance from an argument."""
    return lambda a, varies: [SCALES.near_singular * distance(a[0])]


_DECAYING = {
    ca.OP_EXP: _exponential,
    ca.OP_EXPM1: _exponential,
    ca.OP_TANH: _saturated(SCALES.turn, SCALES.hidden / 2),
    ca.OP_ERF: _saturated(math.sqrt(SCALES.turn), math.sqrt(SCALES.hidden)),
}
_HIDING: dict[int, Callable] = {
    **_DECAYING,
    ca.OP_DIV: _of_quotient,
    ca.OP_INV: lambda a, varies: _of_quotient([ca.SX(1), a[0]], [False, True])[1:],
    **dict.fromkeys((ca.OP_POW, ca.OP_CONSTPOW), _of_powers),
    **dict.fromkeys((ca.OP_SQRT, ca.OP_LOG), _near(ca.fabs)),
    ca.OP_LOG1P: _near(lambda a: ca.fabs(1 + a)),
    **dict.fromkeys((ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATANH), _near(lambda a: ca.fabs(1 - ca.fabs(a)))),
    ca.OP_ACOSH: _near(lambda a: ca.fabs(a - 1)),
    **dict.fromkeys((ca.OP_ATAN, ca.OP_ASINH), _near(lambda a: ca.sqrt(1 + a**2))),
}

# Each entry gives, from the arguments of an operation that is linear in the varying ones, whether each varies, and how
# much its result may change, how much each argument may change; of a product and a quotient with one varying argument.
_LINEAR_BACK: dict[int, Callable] = {
    ca.OP_ASSIGN: lambda a, varies, change: [change],
    ca.OP_NEG: lambda a, varies, change: [change.over(ca.SX(-1))],
    ca.OP_TWICE: lambda a, varies, change: [change.over(ca.SX(2))],
    ca.OP_ADD: lambda a, varies, change: [change.over(ca.SX(sum(varies))) if each else None for each in varies],
    ca.OP_SUB: lambda a, varies, change: [
        change.over(ca.SX(sign * sum(varies))) if each else None for sign, each in zip((1, -1), varies, strict=True)
    ],
    ca.OP_MUL: lambda a, varies, change: [change.over(a[1 - i]) if varies[i] else None for i in (0, 1)],
    ca.OP_DIV: lambda a, varies, change: [change.over(1 / a[1]), None],
}

# Each entry gives, from the arguments of another operation, whether each varies, its result and how much this may
# change on either side, how much each argument may change.


def _through_sum(a, varies, result, change):
    return [change / sum(varies) if each else None for each in varies]


def _through_product(a, varies, result, change):
    # A third of the change for each term of (a + da)(b + db) - a b. Where the product is smaller than that, the larger
    # factor may double.
    first, second = map(ca.fabs, a)
    larger, least = ca.fmax(ca.fmax(first, second), 1e-3 * ca.sqrt(change)), 3 * first * second >= change
    small, large = change / (3 * larger), larger
    by_first = ca.if_else(first > second, large, small), ca.if_else(first > second, small, large)
    return [ca.if_else(least, change / (3 * other), by) for other, by in zip((second, first), by_first, strict=True)]


def _through_quotient(a, varies, result, change):
    below, size = ca.fabs(a[1]), ca.fabs(result)
    if not varies[0]:
        return [None, below * change / (size + change)]
    return [change * below / 4, ca.fmin(below / 2, change * below / (4 * size))]


def _through_power(a, varies, result, change):
    base, exponent, size = ca.fabs(a[0]), ca.fabs(a[1]), ca.fabs(result)
    if not varies[1]:
        # The size grows by the change, and shrinks by less, as the slope is steeper on the outer side.
        little = base * ca.expm1(ca.log1p(change / size) / exponent)
        polynomial = ca.if_else(change < size, little, (size + change) ** (1 / exponent) - base)
        other = base * ca.fmin(0.5, change / (size * exponent * 2.0**exponent))
        return [ca.if_else(a[1] >= 1, polynomial, other), None]
    inner = 0.25 * ca.log1p(change / size)  # of b log a in exp(b log a), half by each factor
    by_base = base * ca.fmin(0.5, inner / exponent) if varies[0] else None
    return [by_base, inner / (1 + ca.fabs(ca.log(base)))]


def _through_exponential(a, varies, result, change):
    # Far below 0 the exponential of -a overflows; elsewhere a small change is lost next to it in the first logarithm.
    return [ca.if_else(a[0] < -SCALES.hidden, ca.log(change + ca.exp(a[0])) - a[0], ca.log1p(change * ca.exp(-a[0])))]


def _through_growth(a, varies, result, change):
    return [ca.log1p(change * ca.exp(-ca.fabs(a[0])))]


def _through_saturated(hidden: float) -> Callable:
    """Slopes are at most 1, or hardly more; out of sight the argument is free."""
    return lambda a, varies, result, change: [ca.fmax(0.8 * change, ca.fabs(a[0]) - hidden)]


def _through_slope(slope: Callable, room: Callable, everywhere: float = 0.0) -> Callable:
    """Of a function with this bound of its slope while its argument changes by less than `room`; whatever the argument
    is, this share of the change is allowed too."""

    def back(a, varies, result, change):
        return [ca.fmax(everywhere * change, ca.fmin(room(a[0]), change / slope(a[0])))]

    return back


_HALF_WAY = lambda a: (1 - ca.fabs(a)) / 2  # noqa: E731 -- to the singularity
_BACK: dict[int, Callable] = {
    **dict.fromkeys((ca.OP_FMIN, ca.OP_FMAX), _through_sum),
    ca.OP_FABS: lambda a, varies, result, change: [change],
    ca.OP_MUL: _through_product,
    ca.OP_SQ: lambda a, varies, result, change: [change / (ca.fabs(a[0]) + ca.sqrt(result + change))],
    ca.OP_DIV: _through_quotient,
    ca.OP_INV: lambda a, varies, result, change: [ca.fabs(a[0]) * change / (ca.fabs(result) + change)],
    **dict.fromkeys((ca.OP_POW, ca.OP_CONSTPOW), _through_power),
    ca.OP_SQRT: lambda a, varies, result, change: [ca.fmin(change, result) * result],
    **dict.fromkeys((ca.OP_EXP, ca.OP_EXPM1), _through_exponential),
    ca.OP_LOG: lambda a, varies, result, change: [-ca.fabs(a[0]) * ca.expm1(-change)],
    ca.OP_LOG1P: lambda a, varies, result, change: [-ca.fabs(1 + a[0]) * ca.expm1(-change)],
    **dict.fromkeys((ca.OP_SINH, ca.OP_COSH), _through_growth),
    **dict.fromkeys((ca.OP_SIN, ca.OP_COS), lambda a, varies, result, change: [change]),
    ca.OP_TAN: lambda a, varies, result, change: [change / (1 + (ca.fabs(result) + change) ** 2)],
    ca.OP_TANH: _through_saturated(SCALES.hidden / 2),
    ca.OP_ERF: _through_saturated(math.sqrt(SCALES.hidden)),
    ca.OP_ATAN: _through_slope(lambda a: 1 / (1 + a**2 / 4), lambda a: ca.fabs(a) / 2, 1.0),
    ca.OP_ASINH: _through_slope(lambda a: 1 / ca.sqrt(1 + a**2 / 4), lambda a: ca.fabs(a) / 2, 1.0),
    ca.OP_ACOSH: _through_slope(lambda a: 1 / ca.sqrt(a - 1), lambda a: (a - 1) / 2),
    **dict.fromkeys((ca.OP_ASIN, ca.OP_ACOS), _through_slope(lambda a: ca.sqrt(2 / (1 - ca.fabs(a))), _HALF_WAY)),
    ca.OP_ATANH: _through_slope(lambda a: 2 / (1 - ca.fabs(a)), _HALF_WAY),
}
