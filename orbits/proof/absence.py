"""Absence of orbits: of a family for a spring whose force is bounded, and of all for a spring that is too weak.

Where one extension r of two coordinates moves alone (`mechanics.LoneExtension`), r'' = A(r), a sum w of the coordinates
is in free fall, w'' = fall. With the gap g = a r + b w let kappa = (b/a) fall and phi = -A/kappa. A launch is on
the closed gap, with g = g' = 0, and its contact force vanishes, so g'' = 0: hence phi = 1, and r' = kappa T, where T is
half the time of flight, the time in which w comes to rest. In mid-flight r' = 0. So over half the flight

    integral of phi dt = T:    phi is 1 on average.

Theorem 1. Let kappa > 0, phi be odd and increase strictly, and |phi| <= B. Then an orbit of family n needs B > 2 n + 1.
Proof. Since phi increases strictly, |phi| < B. Since phi = 1 > 0 at lift-off, r > 0
there. The motion rises to its top at a time t1, then swings between the two sides with half periods H: the potential is
even and rises away from 0, so the motion is symmetric. In family n the half flight ends n half periods after the
top, T = t1 + n H. The integral of phi over a half period vanishes, as r' is 0 at both of its ends. So T is the integral
of phi up to t1, and T < B t1. From r > 0 to the top takes at most a quarter of a period, so H >= 2 t1 and
T >= (2 n + 1) t1. Hence 2 n + 1 < B.

For phi = tanh(b r)/b the bound is 1/b: no orbit of family n for b >= 1/(2 n + 1).

Both theorems are about restitutions e < 1. A landing with the rate v of the gap takes an energy that is proportional to
(1 - e**2) v**2, so that all landings of a lossless orbit have v = 0, as for e = 0. With e = 1 no landing takes energy.

Theorem 2. Let kappa > 0, and a phi' > 0 wherever phi = 1. Then there is no lossless orbit.
Proof. After a launch g''' = a A'(r) r' = -a phi'(r) kappa^2 T. So g''' < 0 where T > 0: the gap closes immediately.
(A machine may leave the contact there all the same, thrown down with T < 0; but it does not land without loss.)
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias

from flint import arb, ctx

from ..balls import FIRST_BITS, BallProgram, IntervalParameters, between
from ..errors import InputError
from ..exact import (
    Bounds,
    Column,
    Decimals,
    ExactMechanics,
    LoneExtension,
    Scale,
    Unproved,
    bounds_of_fractions,
    stated_machine,
    upper_fraction,
)
from ..model import Machine, machine_in_words
from ..symbolic import ExactExpression, depends_on, derivative_by, expression, in_order
from .orbit_case import check_mirrored, not_stated
from .theorem import Proof

# Order of the highest derivative of a law that is checked.
MOST_DERIVATIVES = 8
# Extensions beyond which the tails of a law are checked.
TAILS = tuple(2.0**k for k in range(8))
# Halvings of the interval between the tails, at most.
MOST_HALVES = 24
# Functions that are odd, increase strictly on all of the real line, and are bounded; the second by pi/2.
BOUNDED = {"tanh": Fraction(1), "atan": Fraction("1.5707963267948967")}
PI_BETWEEN = Fraction("3.14159265358979"), Fraction("3.14159265358980")


def proof_of_absence(machine: Machine, family: int | None, parameters: Mapping[str, Decimals]) -> Proof:
    """The proof that there is no orbit of a family, or for None that there is none at all; see `prove_absence`."""
    began, reasons = time.perf_counter(), list[str]()
    check_mirrored(machine.model)
    try:
        stated = stated_machine(machine, parameters)
    except Unproved as error:
        return not_stated(machine, error)
    try:
        stated.refuse_steps("absence")
        if stated.restitution == 1:
            raise Unproved("with the restitution 1 no landing loses energy: a motion that bounces may be periodic")
        with ctx.workprec(FIRST_BITS):
            mechanics = ExactMechanics(stated, Scale())
            lone = mechanics.lone_extension()
            if mechanics.pieces:
                raise InputError(
                    "absence can be proved only for one formula that holds at all extensions, not for a law in "
                    "pieces or a table"
                )
            if lone is None:
                raise InputError(f"no smooth extension of a {stated.name} moves alone, so no absence can be proved")
            law = _Law(mechanics, lone)
            found = law.no_orbit() if family is None else law.no_family(family)
    except Unproved as error:
        found, reasons = "Nothing is proved.", [str(error)]
    return Proof(
        proved=not reasons,
        statement=f"{stated.words()} {found}",
        machine=machine_in_words(machine),
        kind="absence",
        stated=stated.document(),
        parameters={name: bounds_of_fractions(bounds) for name, bounds in stated.parameters.items()},
        family=family,
        reasons=tuple(reasons),
        seconds=time.perf_counter() - began,
    )


def _cross(a: Column, b: Column) -> ExactExpression:
    return a[0] * b[1] - a[1] * b[0]


class _Law:
    """The function phi of an extension that moves alone, and the sign of -a, the share of the extension in the gap."""

    def __init__(self, mechanics: ExactMechanics, lone: LoneExtension):
        counts = [derivative_by(mechanics.counts, place) for place in mechanics.y]
        if not _cross(counts, lone.weights).is_(0):
            raise Unproved("another extension than the one that moves alone counts the families")
        self.place, self.intervals = lone.place, IntervalParameters(mechanics.stated.parameters)
        gap = [expression(each) for each in mechanics.gap]
        across = _cross(lone.weights, lone.thrown)
        in_gap, thrown_in_gap = _cross(gap, lone.thrown) / across, _cross(lone.weights, gap) / across
        kappa = thrown_in_gap / in_gap * lone.fall
        inputs = [lone.place, *self.intervals.symbols.values()]
        level, share = BallProgram(inputs, [kappa, in_gap])([arb(0), *self.intervals.balls()])
        if not level > 0 or not (share > 0 or share < 0):
            raise Unproved("it is not shown that the extension is driven back at lift-off")
        self.sign = -1 if share > 0 else 1
        self.phi = -lone.accelerations[0] / kappa
        for domain in (
            *lone.domains[0],
            *(each for each in mechanics.domains if not depends_on([each.place], mechanics.y)),
        ):
            (value,) = BallProgram(inputs, [domain.place])([arb(0, "inf"), *self.intervals.balls()])
            if not domain.holds(value):
                raise Unproved(f"{domain.what} may have no value somewhere")
        functions = [self.phi - 1]
        for _ in range(MOST_DERIVATIVES):
            functions.append(derivative_by(functions[-1], lone.place))
        self.programs = [BallProgram(inputs, [each]) for each in functions]

    def value(self, order: int, at: arb) -> arb:
        """A derivative of phi - 1 on a ball of extensions."""
        return self.programs[order]([at, *self.intervals.balls()])[0]

    def no_family(self, family: int) -> str:
        """Theorem 1 of the module; raises `Unproved` where its conditions are not proved."""
        places = dict.fromkeys(self.intervals.symbols.values(), (Fraction(-1), Fraction(1)))
        trend = trend_of(self.phi, self.place, places)
        if not (trend.odd and trend.rises):
            raise Unproved("the spring's formula does not show that its force is odd and rises everywhere")
        if trend.bound is None:
            raise Unproved("the spring's formula does not show that its force is bounded")
        if trend.bound > 2 * family + 1:
            bound = upper_fraction(trend.bound)
            raise Unproved(f"the force is bounded by {bound}, but only a bound up to {2 * family + 1} excludes orbits")
        return (
            f"Its spring's force is odd, rises everywhere, and is at most {upper_fraction(trend.bound)} times that at "
            f"lift-off: an orbit of family {family} needs more than {2 * family + 1}, so that there is none."
        )

    def no_orbit(self) -> str:
        """Theorem 2 of the module; raises `Unproved` where its conditions are not proved."""
        for tail in TAILS:
            if self._keeps_sign(tail, 1) and self._keeps_sign(tail, -1):
                break
        else:
            raise Unproved("the force far from rest is not enclosed")
        self._check_between(arb(-tail), arb(tail), MOST_HALVES)
        return (
            "Wherever the extension is at the level of lift-off, its deceleration changes with it in such a way that "
            "the gap would close at once: there is no lossless orbit of any family."
        )

    def _keeps_sign(self, tail: float, side: int) -> bool:
        """Whether phi - 1 has one sign beyond an extension: phi - 1 and its first derivatives away from 0 share it
        there, up to a derivative that has it everywhere."""
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
        """Prove on an interval that phi is not 1, or that the gap would close."""
        inside = between(low, high)
        force, slope = self.value(0, inside), self.sign * self.value(1, inside)
        if force > 0 or force < 0 or slope < 0:
            return
        middle = (low + high) / 2
        at_middle = self.value(0, middle) + self.sign * slope * (inside - middle)
        if at_middle > 0 or at_middle < 0:
            return
        if left == 0:
            raise Unproved(f"the force may reach the level of lift-off near the extension {float(middle):.6g}")
        self._check_between(low, middle, left - 1)
        self._check_between(middle, high, left - 1)


@dataclass(frozen=True)
class Trend:
    """Properties of an expression as a function of a variable, derived from its operations, in exact numbers.

    odd, rises : whether it is an odd function, and whether it increases strictly everywhere
    bound : of its absolute value; None where none is derived
    constant : bounds of its value, where it is shown not to depend on the variable; else None
    """

    odd: bool = False
    rises: bool = False
    bound: Fraction | None = None
    constant: Bounds | None = None


# The trend of an expression from which nothing is derived.
_UNKNOWN = Trend()
Trends: TypeAlias = Sequence[Trend]


def _constant(low: Fraction, high: Fraction) -> Trend:
    return Trend(bound=max(abs(low), abs(high)), constant=(low, high))


def trend_of(of: ExactExpression, variable: ExactExpression, bounds: Mapping[ExactExpression, Bounds]) -> Trend:
    """The trend of an expression of a variable and of symbols that lie between bounds."""
    trends = dict[ExactExpression, Trend]()
    for each in in_order([of]):
        if each is variable:
            trends[each] = Trend(odd=True, rises=True)
        elif each.kind == "number":
            trends[each] = _constant(each.value, each.value)
        elif each.kind == "pi":
            trends[each] = _constant(*PI_BETWEEN)
        elif each.kind == "symbol":
            trends[each] = _constant(*bounds[each])
        else:
            trends[each] = _combined(each, [trends[part] for part in each.parts])
    return trends[of]


def _combined(each: ExactExpression, own: Trends) -> Trend:
    """The trend of an operation's result from those of its operands."""
    first = own[0]
    if each.kind in BOUNDED and first.constant is None:
        return replace(first, bound=BOUNDED[each.kind])
    if each.kind in ("sinh", "asinh") and first.constant is None:
        return replace(first, bound=None)
    if each.kind in ("exp", "expm1") and first.constant is None:
        return Trend(rises=first.rises)
    if each.kind == "+":
        return _sum(own)
    if each.kind in ("*", "/"):
        return _scaled_trend(each.kind, own)
    if each.kind == "**" and first.constant is None and each.value > 0 and each.value % 2:
        return Trend(first.odd, first.rises)
    return _UNKNOWN


def _sum(own: Trends) -> Trend:
    if all(each.constant for each in own):
        (a, b), (c, d) = (each.constant or (Fraction(0),) * 2 for each in own)
        return _constant(a + c, b + d)
    rises = all(each.rises or each.constant for each in own)
    bounds = [each.bound for each in own if each.bound is not None]
    return Trend(all(each.odd for each in own), rises, sum(bounds, Fraction(0)) if len(bounds) == len(own) else None)


def _scaled_trend(kind: str, own: Trends) -> Trend:
    """A product, or a quotient by a constant."""
    first, second = own
    if kind == "/":
        if second.constant is None or second.constant[0] <= 0 <= second.constant[1]:
            return _UNKNOWN
        low, high = second.constant
        second = _constant(min(1 / low, 1 / high), max(1 / low, 1 / high))
    if first.constant and second.constant:
        ends = [x * y for x in first.constant for y in second.constant]
        return _constant(min(ends), max(ends))
    moving, scale = (first, second) if second.constant else (second, first)
    if scale.constant is None or scale.constant[0] <= 0 <= scale.constant[1]:
        return _UNKNOWN
    positive = scale.constant[0] > 0
    assert scale.bound is not None
    bound = None if moving.bound is None else moving.bound * scale.bound
    return Trend(moving.odd, moving.rises and positive, bound)
