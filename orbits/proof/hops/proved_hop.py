"""A proved zero of the equations of hops that come back, its derivatives, and the conditions of their motion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice

from flint import arb, ctx

from ...balls import (
    COARSE,
    FINE,
    FIRST_BITS,
    Equations,
    Motion,
    ProvedRoot,
    ball_of_fraction,
    evaluated_on,
    polished,
    prove_root,
)
from ...exact import Enclosure, ExactStatement, Unproved, enclosure_of, lower_decimal
from ...symbolic import ExactExpression, depends_on, substitute
from ..digits import bits_of_digits
from ..proved_motion import Verdicts, verdicts_of
from ..theorem import Part
from .exact_hops import HopStatement
from .hop_jets import Jet, levels_of, next_jet, pace_of, statement_of_jets


@dataclass(frozen=True)
class ProvedHop:
    """A proved zero.

    base : the statement of hops that come back
    further : unknowns by name that are constant along the jets of hops
    equations, root : of the base, or of its doubling
    """

    base: HopStatement
    further: Mapping[str, ExactExpression]
    equations: Equations
    root: ProvedRoot
    digits: int | None

    @property
    def balls(self) -> dict[str, arb]:
        """Enclosures of the unknowns by name, in the units of the equations."""
        return dict(zip(self.equations.unknowns, self.root.box, strict=True))

    @property
    def jets(self) -> dict[str, arb]:
        """Enclosures of the unknowns, with the derivatives among them by alpha itself, not at its pace."""
        levels, pace = levels_of(self.base.statement, 1), ball_of_fraction(self.base.pace)
        return {name: value / pace ** levels.get(name, 0) for name, value in self.balls.items()}

    @property
    def hops(self) -> list[list[Motion]]:
        """The flights and the contact of each hop."""
        pairs = zip(self.equations.legs, self.root.evaluated.passages, strict=True)
        motions = (Motion(leg, passage) for leg, passage in pairs)
        return [[*islice(motions, len(own) + 1)] for own in self.base.word.flights]

    def ball(self, name: str) -> arb:
        """An enclosure of an unknown, in the units of the machine."""
        return self.balls[name] * ball_of_fraction(self.base.unit_of(name))

    def part(self, parameters: Mapping[str, Enclosure]) -> Part:
        """The enclosures of all unknowns, in the units of the machine."""
        with ctx.workprec(bits_of_digits(self.digits) + FIRST_BITS):
            units = [ball_of_fraction(self.base.unit_of(name)) for name in self.equations.unknowns]
            enclosed = {name: enclosure_of(self.ball(name), self.digits) for name in self.equations.unknowns}
            return Part(parameters, enclosed, lower_decimal(self.root.unique_within(units)))

    def jet(self, order: int, values: Mapping[str, arb]) -> Jet:
        """The derivatives after this order by alpha, from enclosures of the jet up to it by name. Of the third
        ones only a sign is required."""
        base = self.base.statement
        levels, pace = levels_of(base, order), pace_of(values, base)
        size = ball_of_fraction(pace)
        paced = {name: value * size ** levels.get(name, 0) for name, value in values.items()}
        jets = statement_of_jets(base, order, pace)
        equations = Equations(ExactStatement({**jets.unknowns, **self.further}, jets.arcs), self.equations.intervals)
        box = [paced[name] for name in equations.unknowns]
        centre, radii = [value.mid() for value in box], [value.rad() for value in box]
        evaluated = evaluated_on(equations, centre, radii, fineness=FINE if order < 2 else COARSE)
        found = next_jet(base, order, evaluated.slopes, paced, pace)
        back = size ** (order + 1)
        return Jet({name: value / back for name, value in found.unknowns.items()}, found.last / back)


def proved_hop(
    base: HopStatement, further: Mapping[str, ExactExpression], equations: Equations, guess: Mapping[str, float],
    digits: int | None,
) -> ProvedHop:  # fmt: skip
    """The zero of equations near a guess of its unknowns, in the units of the machine, along which all formulas have
    values; raises `Unproved`."""
    if depends_on(base.half.mechanics.contact_force, base.half.mechanics.w):
        raise Unproved("the contact force depends on speeds, so an injection would move the place of the lift-off")
    centre = [arb(guess[name] / float(base.unit_of(name))) for name in equations.unknowns]
    if not base.half.mechanics.pieces:  # a single motion approaches a breakpoint in ever shorter steps
        centre = polished(equations, centre)
    root = prove_root(equations, [float(value) for value in centre], bits_of_digits(digits))
    equations.check_domains(root.evaluated.passages)
    if any(len(passage.pieces[0].laws) > 1 for passage in root.evaluated.passages):
        raise Unproved(
            "a flight or the contact begins at a breakpoint of the spring's law, where the map may not be smooth"
        )
    found = ProvedHop(base, further, equations, root, digits)
    for name in base.word.times:
        if not found.balls[name] > 0:
            raise Unproved(f"the {name.replace('_', ' ')} is not proved to be positive")
    return found


def conditions_of_hop(found: ProvedHop, inject: arb) -> Verdicts:
    """The verdicts on the conditions of theorem 1 of `hop_theorems`, for an injection."""
    checks: dict[str, Callable[[], None]] = {"clearance": lambda: _check_flights_of_hop(found)}
    if found.base.word.bounces:
        checks["bounces"] = lambda: _check_bounces(found)
    checks |= {"contact_force": lambda: _check_contact(found), "liftoff": lambda: _check_liftoff(found, inject)}
    if found.base.word.period > 1:
        checks["least_period"] = lambda: _check_least_period(found)
    if found.base.half.mechanics.separation is not None:
        checks["separation"] = lambda: _check_separation_of_hop(found)
    return verdicts_of(checks)


def _check_flights_of_hop(found: ProvedHop) -> None:
    """The gap and its speed are 0 as a flight begins, at a launch its acceleration too; it is 0 as the flight ends."""
    for order, flight in ((2 if i else 3, each) for hop in found.hops for i, each in enumerate(hop[:-1])):
        gap = flight.chain([found.base.half.gap] * len(flight.leg.rates), order)
        if not flight.first(gap, order - 1).contains(0):
            raise Unproved("the gap does not open as it is proved to")
        flight.check_positive(gap, zero_at_start=order, zero_at_end=True)


def _check_bounces(found: ProvedHop) -> None:
    for flight in (each for hop in found.hops for each in hop[1:-1]):
        gap = flight.chain([found.base.half.gap] * len(flight.leg.rates), 2)
        if not flight.first(gap, 2) > 0:
            raise Unproved("the machine is not proved to leave at once after an impact")


def _check_contact(found: ProvedHop) -> None:
    """The force at the end is that at the launch, where it vanishes, as it depends on the place alone."""
    for *_, contact in found.hops:
        contact.check_positive(contact.chain(found.base.half.mechanics.contact_force, 1), zero_at_end=True)


def _check_liftoff(found: ProvedHop, inject: arb) -> None:
    if not all(found.ball(name) - inject > 0 for name in found.base.word.launches):
        raise Unproved("the speed at the lift-off, before the injection, is not proved to be positive")


def _check_least_period(found: ProvedHop) -> None:
    """The least period divides the number of hops, so that a launch speed comes back after a proper divisor of it, if
    after fewer hops at all."""
    first, *others = (found.ball(name) for name in found.base.word.launches)
    for hops, after in enumerate(others, 1):
        if (len(others) + 1) % hops == 0 and first.overlaps(after):
            raise Unproved(
                f"the launch speed after {hops} hop{'s' * (hops > 1)} is not proved to differ from the first"
            )


def _check_separation_of_hop(found: ProvedHop) -> None:
    mechanics = found.base.half.mechanics
    assert mechanics.separation is not None
    closed = dict(zip(mechanics.y, mechanics.embedded(mechanics.s), strict=True))
    (inside,) = substitute([mechanics.separation], closed)
    for *flights, contact in found.hops:
        for flight in flights:
            flight.check_positive(flight.chain([mechanics.separation] * len(flight.leg.rates), 1))
        contact.check_positive(contact.chain([inside] * len(contact.leg.rates), 1))
