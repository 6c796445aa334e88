"""The statement of hops of the return map that come back.

A hop of a machine of two coordinates starts at a lift-off: the gap is closed, and the contact force vanishes, which
determines the place s of the launch; its rate there is alpha. It flies until the gap closes, lands plastically, and
leaves immediately where the contact would have to pull: a bounce. At last it stays in contact until the contact force
vanishes at s again. The next launch speed is the rate there, and an injection added to it. The unknowns

    s, alpha, the times T of the flights, the time C of the contact

obey as many equations: the contact force at s is 0; the gap is 0 after each flight; after C the place is s; and

    w + inject - alpha = 0,    w the rate after C.

Of n hops each has its launch speed, its times and these equations, and w_i + inject - alpha_(i+1) = 0 leads to the next
one; the last of all, w_n + inject - alpha = 0, back to the first.

Where the others, F(z, alpha) = 0 with z = (s, T, C), and of n hops alpha_2 ... alpha_n, are regular in z, they
determine z as a function of alpha near the hops, and with it w. So the map alpha -> w + inject, of n hops its n-th
iterate, is as smooth there as the flows are, and its derivative is

    dw/dalpha - dw/dz F_z**-1 F_alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from ...exact import Column, ExactArc, ExactMechanics, ExactStatement, HalfOrbit, unknown
from ...symbolic import ExactExpression, inner_product, substitute, symbols
from .hop_word import HopWord

INJECTION = "inject"


@dataclass(frozen=True)
class HopStatement:
    """The statement of hops that come back.

    half : the launch and the arcs of the machine
    word : the number of impacts of each hop
    statement : its arcs are the flights and the contact of each hop
    pace : of alpha, where derivatives along a jet of hops are unknowns
    """

    half: HalfOrbit
    word: HopWord
    statement: ExactStatement
    pace: Fraction = Fraction(1)

    def unit_of(self, name: str) -> Fraction:
        """The unit in which an unknown is solved for."""
        if name in self.word.times:
            return self.half.mechanics.scale.time
        if name in (*self.word.launches, INJECTION):
            return self.half.mechanics.scale.speed
        if name in self.statement.unknowns:
            return self.half.unit_of(name)
        return self.unit_of(name[1:]) / self.half.mechanics.scale.speed / self.pace  # the derivative of an unknown


def hop_statement(mechanics: ExactMechanics, word: HopWord, inject: ExactExpression) -> HopStatement:
    """The statement of the hops of a word that come back, of a machine of two coordinates, with an injection in the
    units of rates."""
    half = HalfOrbit(mechanics)
    (free,), contact_arc = half.flight().arcs, half.statement(with_contact=True).arcs[-1]
    still = list[Column]([] for _ in free.guards)
    before = symbols("before", len(free.states))
    landed = landed_in_contact(mechanics, before)
    again = substitute(half.launch, dict(zip([*half.places, *half.rates], landed, strict=True)))
    (place,), (rate,) = mechanics.s, mechanics.w
    liftoff, arcs, unknowns = half.launch_unknowns["liftoff"], list[ExactArc](), dict(half.launch_unknowns)
    for i, (launch, names, contact) in enumerate(zip(word.launches, word.flights, word.contacts, strict=True)):
        named = {name: unknown(name) for name in (launch, *names, contact)}
        unknowns |= named
        speed, *times, stay = named.values()
        # The contact force at the launch depends on the place alone, which all hops have in common.
        guards = still if i else [[each] for each in half.lifted]
        start, earlier = (
            substitute(half.launch, {half.launch_unknowns["alpha"]: speed}),
            symbols("before", 2 if i else 0),
        )
        for time in times:
            arcs.append(
                replace(free, start=start, before=tuple(earlier), duration=time, guards=guards, conditions=[half.gap])
            )
            start, earlier, guards = again, before, still
        ends = [place - liftoff, rate + inject - unknown(word.following(i))]
        arcs.append(replace(contact_arc, start=landed, before=tuple(before), duration=stay, conditions=ends))
    return HopStatement(half, word, ExactStatement(unknowns, tuple(arcs)))


def landed_in_contact(mechanics: ExactMechanics, before: Sequence[ExactExpression]) -> Column:
    """Place and rate of the contact after a plastic landing in a flight state, coordinates and rates alternating:
    the only impulse is the contact's, so that the momentum along the contact is conserved."""
    m = mechanics
    momentum = m.closed.along([inner_product(row, m.v) for row in m.inertia])
    closed = dict(zip(m.y, m.embedded(m.s), strict=True))
    rates = m.closed.own.accelerations(substitute(momentum, closed))
    at = dict(zip([*m.y, *m.v], [*before[::2], *before[1::2]], strict=True))
    places = [at[each] for each in m.s]
    return [*places, *substitute(rates, at)]
