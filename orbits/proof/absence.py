"""What cannot be: orbits of a family of a spring whose force is bounded, and a lift-off that the force never reaches.

The extension moves alone, r'' = -rate phi(r), from phi = 1 at lift-off, for half the flight T = alpha/rate; there
r' = 0 (`model.relative`). So the integral of phi over half the flight is T: phi is 1 on average.

Theorem. Let phi be odd and increase strictly, and |phi| <= B. Then an orbit of family n needs B > 2 n + 1.
Proof. Since phi increases strictly, |phi| < B. Since phi = 1 > 0 at lift-off, r > 0
there. The motion rises to its top at a time t1, then swings between the two sides with half periods H: the potential is
even and rises away from 0, so the motion is symmetric. In family n the half flight ends n half periods after the
top, T = t1 + n H. The integral of phi over a half period vanishes, as r' is 0 at both of its ends. So T is the integral
of phi up to t1, and T < B t1. From r > 0 to the top takes at most a quarter of a period, so H >= 2 t1 and
T >= (2 n + 1) t1. Hence 2 n + 1 < B.

For phi = tanh(b r)/b the bound is 1/b: no orbit of family n for b >= 1/(2 n + 1).
"""

import operator
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias

import casadi as ca
from flint import arb, ctx

from ..errors import InputError
from ..model.machine import Machine, machine_in_words
from ..model.relative import Relative
from ..symbolic.formula import CONSTANTS, symbolic_numerals
from .case import exact_numbers, parameter_bounds
from .exact import Decimals, ExactExpressions, Numbers, exact_fraction
from .programs import BallProgram
from .refusal import Unproved
from .step import between
from .theorem import Proof
from .wording import machine_sentence, parameter_texts

BITS = 80
# Derivatives of a law that are looked at, the extensions beyond which its tails are told, and halvings of intervals.
MOST_DERIVATIVES, TAILS, MOST_HALVES = 8, tuple(2.0**k for k in range(8)), 24
# What a number lies between.
Bounds: TypeAlias = tuple[Fraction, Fraction]
# Functions that are odd, increase strictly on all of the real line, and are bounded; the second by pi/2.
BOUNDED = {ca.OP_TANH: Fraction(1), ca.OP_ATAN: Fraction("1.5707963267948967")}
_BOUNDED_ARITHMETIC: dict[int, Callable] = {
    ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul, ca.OP_DIV: operator.truediv,
}  # fmt: skip


def proof_of_absence(machine: Machine, family: int | None, parameters: dict[str, Decimals]) -> Proof:
    """The proof that there is no orbit of a family, or for None that there is no lift-off; see `prove_absence`."""
    began, model = time.perf_counter(), machine.model
    if model.relative is None or model.homotopy:
        raise InputError(f"the extension of a {model.name} does not move alone: nothing can be proved absent")
    numbers, reasons = exact_numbers(machine, parameters), list[str]()
    try:
        with ctx.workprec(BITS):
            law = _Law(model.relative, numbers)
            told = law.no_liftoff() if family is None else law.no_family(family)
    except Unproved as error:
        told, reasons = "Nothing is proved.", [str(error)]
    words = machine_in_words(machine)
    return Proof(
        proved=not reasons,
        statement=f"{machine_sentence(words, parameter_texts(numbers))} {told}",
        machine=words,
        parameters=parameter_bounds(numbers),
        reasons=tuple(reasons),
        seconds=time.perf_counter() - began,
    )


class _Law:
    """The force of the extension alone, less the level of lift-off, with its derivatives, as programs of balls."""

    def __init__(self, relative: Relative, numbers: Numbers):
        if relative.law.pieces:
            raise Unproved("the spring's law is in pieces")
        expressions, r = ExactExpressions(numbers), ca.SX.sym("r")
        with symbolic_numerals(expressions.numerals):
            phi = ca.SX(relative.law.expression(r, relative.own(expressions.p), []))
        self.load = relative.liftoff.load
        functions = [phi + self.load - 1]
        for _ in range(MOST_DERIVATIVES):
            functions.append(ca.jacobian(functions[-1], r))
        self.programs: list[BallProgram] = [expressions.program([r, *expressions.wide], [each]) for each in functions]
        self.constants = [*numbers.balls(), *expressions.constants()]
        exact: dict[ca.SX, Bounds] = {expressions.p[name]: bounds for name, bounds in numbers.values.items()}
        exact |= {symbol: _bounds_of_numeral(text) for text, symbol in expressions.numerals.items()}
        self.trend = _trend_of(phi, r, list(exact), list(exact.values()))

    def value(self, order: int, at: arb) -> arb:
        """A derivative of the force less the level on a ball of extensions."""
        (found,) = self.programs[order]([at, *self.constants])
        return found

    def no_family(self, family: int) -> str:
        """The theorem of the module's docstring; raises `Unproved` where its conditions are not proved."""
        if self.load != 0 or not (self.trend.odd and self.trend.rises):
            raise Unproved("the spring's formula does not show that its force is odd and rises everywhere")
        bound = self.trend.bound
        if bound is None:
            raise Unproved("the spring's formula does not show that its force is bounded by anything")
        if bound > 2 * family + 1:
            raise Unproved(f"the force is bounded by {float(bound):.6g}, and an orbit needs more than {2 * family + 1}")
        return (
            f"Its spring's force is odd, rises everywhere, and is at most {float(bound):.12g} times the level of "
            f"lift-off: an orbit of family {family} needs more than {2 * family + 1}, so that there is none."
        )

    def no_liftoff(self) -> str:
        """That the level of lift-off is nowhere reached by a force that rises; raises `Unproved` where it may be."""
        for tail in TAILS:
            if self._keeps_sign(tail, 1) and self._keeps_sign(tail, -1):
                break
        else:
            raise Unproved("the force far from rest is not told")
        self._check_between(arb(-tail), arb(tail), MOST_HALVES)
        return (
            "At no extension is the spring's force at the level of lift-off while it does not fall with the extension: "
            "no motion can begin with a lift-off from sustained contact."
        )

    def _keeps_sign(self, tail: float, side: int) -> bool:
        """Whether the force less the level has a sign beyond an extension: one that its first derivatives away from 0
        share there, up to one that has it everywhere."""
        sign = 0
        for order in range(MOST_DERIVATIVES + 1):
            here = side**order * self.value(order, arb(side * tail))
            own = int(here > 0) - int(here < 0)
            if own == 0 or sign not in (0, own):
                return False
            sign = own
            everywhere = side**order * self.value(order, arb(0, "inf"))
            if everywhere * sign > 0:
                return True
        return False

    def _check_between(self, low: arb, high: arb, left: int) -> None:
        """Prove on an interval that the force is off the level, or falls."""
        inside = between(low, high)
        force, slope = self.value(0, inside), self.value(1, inside)
        if force > 0 or force < 0 or slope < 0:
            return
        middle = (low + high) / 2
        at_middle = self.value(0, middle) + slope * (inside - middle)
        if at_middle > 0 or at_middle < 0:
            return
        if left == 0:
            raise Unproved(f"the force may reach the level of lift-off near the extension {float(middle):.6g}")
        self._check_between(low, middle, left - 1)
        self._check_between(middle, high, left - 1)


@dataclass(frozen=True)
class _Trend:
    """What the operations of an expression show of it as a function of a variable, in exact numbers.

    odd, rises : whether it is an odd function, and whether it increases strictly everywhere
    bound : of its absolute value; None where none is shown
    constant : what it lies between, where it does not depend on the variable
    """

    odd: bool = False
    rises: bool = False
    bound: Fraction | None = None
    constant: Bounds | None = None


def _constant(bounds: Bounds | None) -> _Trend:
    return _Trend(bound=bounds and max(map(abs, bounds)), constant=bounds)


def _bounds_of_numeral(text: str) -> Bounds:
    """What a numeral of a formula, or pi, lies between."""
    if text in CONSTANTS:
        digits = Fraction(CONSTANTS[text])
        return digits - Fraction(1, 10**15), digits + Fraction(1, 10**15)
    return exact_fraction("a numeral", text), exact_fraction("a numeral", text)


def _trend_of(expression: ca.SX, variable: ca.SX, others: Sequence[ca.SX], values: Sequence[Bounds]) -> _Trend:
    """The trend of an expression of a variable and of others that lie between these values."""
    function = ca.Function("law", [variable, ca.vertcat(*others)], [expression])
    trends = dict[int, _Trend]()
    for i in range(function.n_instructions()):
        code, ins, outs = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
        if code == ca.OP_OUTPUT:
            return trends[ins[0]]
        if code == ca.OP_INPUT:
            trends[outs[0]] = _Trend(odd=True, rises=True) if ins[0] == 0 else _constant(values[ins[1]])
        elif code == ca.OP_CONST:
            number = Fraction(function.instruction_constant(i))
            trends[outs[0]] = _constant((number, number))
        else:
            trends[outs[0]] = _combined(code, [trends[place] for place in ins])
    return _Trend()


def _combined(code: int, own: list[_Trend]) -> _Trend:
    """The trend of an operation's result from those of what it is of."""
    first, constants = own[0], [each.constant for each in own if each.constant is not None]
    if len(constants) == len(own):
        return _constant(_bounds_of_value(code, constants))
    bounds = [each.bound for each in own if each.bound is not None]
    total = sum(bounds, Fraction(0)) if len(bounds) == len(own) else None
    if code in BOUNDED:
        return replace(first, bound=BOUNDED[code])
    if code in (ca.OP_SINH, ca.OP_ASINH):
        return replace(first, bound=None)
    if code == ca.OP_ASSIGN:
        return first
    if code == ca.OP_TWICE:
        return replace(first, bound=first.bound and 2 * first.bound)
    if code in (ca.OP_EXP, ca.OP_EXPM1):
        return _Trend(rises=first.rises)
    if code == ca.OP_ADD:
        rises = all(each.rises or each.constant is not None for each in own)
        return _Trend(all(each.odd for each in own), rises, total)
    if code == ca.OP_SUB:
        return _Trend(all(each.odd for each in own), first.rises and own[1].constant is not None, total)
    if code in (ca.OP_MUL, ca.OP_DIV) and constants and constants[0][0] > 0:
        low, high = constants[0]
        moving = next(each for each in own if each.constant is None)
        if code == ca.OP_MUL:
            return replace(moving, bound=moving.bound and moving.bound * high)
        return replace(moving, bound=moving.bound and moving.bound / low) if moving is first else _Trend()
    if code in (ca.OP_POW, ca.OP_CONSTPOW) and constants and own[1].constant is not None:
        low, high = constants[0]
        whole = low == high > 0 and low.denominator == 1 and low % 2 == 1
        return _Trend(first.odd and whole, first.rises and whole)
    return _Trend()


def _bounds_of_value(code: int, own: list[Bounds]) -> Bounds | None:
    """What the result of arithmetic on numbers between bounds lies between; None where that is not told."""
    if code in (ca.OP_NEG, ca.OP_TWICE):
        scaled = [(-1 if code == ca.OP_NEG else 2) * end for end in own[0]]
        return min(scaled), max(scaled)
    if code not in _BOUNDED_ARITHMETIC or (code == ca.OP_DIV and own[1][0] <= 0 <= own[1][1]):
        return None
    ends = [_BOUNDED_ARITHMETIC[code](x, y) for x in own[0] for y in own[1]]
    return min(ends), max(ends)
