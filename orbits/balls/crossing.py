"""Steps of systems that are smooth in pieces, within a piece and across the breakpoint to the next one.

The rates are continuous and change their law where a coordinate of the state passes a breakpoint. Within a piece a step
is that of a smooth system, whose tube stays off the breakpoints. Across one, for the short time that a set of states
needs, x' lies in the hull of both laws' rates F over a tube that holds the motion: where x0 + [0, h] F is inside the
tube, x(t) is in x0 + t F. The difference of two motions obeys d' = A(t) d with A in the hull of both laws' Jacobians,
as the rates are continuous, so that the variational equations are crossed in the same way. The speed of the coordinate
must not vanish (a transversal crossing): else the set does not reach the other side, and nothing is proved.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flint import arb, arb_poly, ctx

from ..exact import Unproved
from .programs import EachLaw
from .rigorous_step import Step, System, between, take_step


class CrossingOptions(NamedTuple):
    """The windows in time in which motions pass breakpoints."""

    windows: int = 12  # that are tried about a breakpoint
    windows_at_end: int = 4  # that are tried where it may be the beginning that is not clear of the breakpoint
    wider: int = 4  # each window is this times as wide as the one before
    parts: int = 400  # of a step that are compared with the breakpoints, at most
    halvings: int = 60  # of a part of a step, at the least precision
    clear_of: int = 8  # distance, as a multiple of its own width, to which a set is followed beyond a breakpoint


CROSSING = CrossingOptions()


@dataclass(frozen=True)
class Breakpoints:
    """The breakpoints of a coordinate at which a system changes its law.

    weights : of the first states in the coordinate
    values : enclosures of the breakpoints, ascending; law k holds between number k - 1 and number k
    """

    weights: tuple[arb, ...]
    values: list[arb]

    def coordinate(self, states: Sequence[arb]) -> arb:
        """The coordinate at states."""
        parts = zip(self.weights, states, strict=False)
        return sum((weight * state for weight, state in parts if not weight.is_zero()), arb(0))

    def holds(self, law: int, states: Sequence[arb], last: int | None = None) -> bool:
        """Whether states are strictly between the breakpoints of a law, or of it and the next ones up to the last."""
        place, last = self.coordinate(states), law if last is None else last
        above = law == 0 or self.values[law - 1] < place
        return above and (last == len(self.values) or place < self.values[last])

    def leaves(self, law: int, states: Sequence[arb], system: System) -> bool:
        """Whether the coordinate is monotone, and away from the end of the piece towards which it goes, over states
        that hold motions since a time when they were strictly within the piece."""
        place, pace = self.coordinate(states), self.coordinate(system.rates([*states]))
        if pace > 0:
            return law == len(self.values) or bool(place < self.values[law])
        return bool(pace < 0) and (law == 0 or bool(self.values[law - 1] < place))

    def beyond(self, law: int, states: Sequence[arb]) -> int:
        """The law on the other side of that breakpoint of a law which is nearest to states."""
        place = self.coordinate(states).mid()
        numbers = [number for number in (law - 1, law) if 0 <= number < len(self.values)]
        nearest = min(numbers, key=lambda number: float(abs(place - self.values[number].mid())))
        return law - 1 if nearest == law - 1 else law + 1

    def laws_of(self, states: Sequence[arb]) -> tuple[int, ...]:
        """The law of states, or the two laws where they are not all strictly within one piece; raises `Unproved` where
        they are not strictly within two."""
        for count in (1, 2):
            for law in range(len(self.values) + 2 - count):
                if self.holds(law, states, law + count - 1):
                    return tuple(range(law, law + count))
        raise Unproved("the motions spread over several pieces of the spring's law")


NO_BREAKPOINTS = Breakpoints((), [])


@dataclass(frozen=True)
class Advance:
    """A step with the laws that hold in it, and the law at its end."""

    step: Step
    laws: tuple[int, ...]
    law: int


def advance_step(
    systems: EachLaw[System], breakpoints: Breakpoints, law: int, centre: Sequence[arb],
    spread: Sequence[arb], longest: arb, order: int, accuracy: float,
) -> Advance:  # fmt: skip
    """A step from the states within a spread of a centre, expected in the piece of a law: up to a breakpoint where one
    is in the way, and from there across it. The arguments are as in `take_step`."""
    if not breakpoints.values:
        return Advance(take_step(systems[law], centre, spread, longest, order, accuracy), (law,), law)
    states = [value + arb(0, radius) for value, radius in zip(centre, spread, strict=True)]
    if not breakpoints.holds(law, states):
        law, last = (laws := breakpoints.laws_of(states))[0], laws[-1]
        if law < last:  # they begin on both sides of a breakpoint
            rises = bool(breakpoints.coordinate(systems[law].rates([*states])) > 0)
            law, last = (law, last) if rises else (last, law)
            return _across(systems, breakpoints, law, last, states, longest)
    step = take_step(systems[law], centre, spread, longest, order, accuracy)
    if _stays(breakpoints, law, step, systems[law]):
        return Advance(step, (law,), law)
    meeting, room = _meeting(breakpoints, law, step), arb(0)
    if meeting is not None:
        speed = abs(breakpoints.coordinate([p.derivative()(meeting) for p in step.polynomials]))
        room = 2 * breakpoints.coordinate([arb(0, radius) for radius in step.tube]).abs_upper() / speed.mid()
    until = step.h
    for window in range(CROSSING.windows):
        if window == CROSSING.windows_at_end:  # it may be the beginning that is not clear of a breakpoint
            meeting, room = None, room / CROSSING.wider**window
        until = until / 2 if meeting is None else meeting - room
        if not until > 4 * room + arb(2) ** (12 - ctx.prec):  # a shorter step would be rounded to none
            break
        short = take_step(systems[law], centre, spread, _rounded_down(until), order, accuracy)
        if _stays(breakpoints, law, short, systems[law]):
            return Advance(short, (law,), law)
        room = CROSSING.wider * room + (arb(0) if meeting is None else arb(2) ** (8 - ctx.prec))
    return _across(systems, breakpoints, law, breakpoints.beyond(law, centre), states, longest)


def _stays(breakpoints: Breakpoints, law: int, step: Step, system: System) -> bool:
    """Whether all motions of a step, which begin strictly within the piece of a law, are proved to stay there."""
    waiting = [(arb(0), step.h, max(CROSSING.halvings, ctx.prec))]
    for _ in range(CROSSING.parts):
        if not waiting:
            return True
        low, high, left = waiting.pop()
        states = step.at(between(low, high))
        if breakpoints.holds(law, states) or (low.is_zero() and breakpoints.leaves(law, states, system)):
            continue
        if left == 0:
            return False
        middle = ((low + high) / 2).mid()
        waiting += [(middle, high, left - 1), (low, middle, left - 1)]
    return not waiting


def _meeting(breakpoints: Breakpoints, law: int, step: Step) -> arb | None:
    """A guess of the time at which the centre of a step reaches a breakpoint of its law; None where it reaches none."""
    parts = zip(breakpoints.weights, step.polynomials, strict=False)
    coordinate = sum((weight * p for weight, p in parts if not weight.is_zero()), arb_poly([]))
    samples = [step.h * i / 32 for i in range(33)]
    for upper, number in ((False, law - 1), (True, law)):
        if not 0 <= number < len(breakpoints.values):
            continue
        goal = breakpoints.values[number].mid()
        past = [((coordinate(t).mid() > goal) == upper) for t in samples]
        if True not in past[1:]:
            continue
        first = past.index(True, 1)
        low, high = samples[first - 1], samples[first]
        for _ in range(ctx.prec):
            middle = ((low + high) / 2).mid()
            if (coordinate(middle).mid() > goal) == upper:
                high = middle
            else:
                low = middle
        return low.mid()
    return None


def _rounded_down(time: arb) -> arb:
    """A time a little shorter, with few enough digits that its sums are exact."""
    unit = arb(2) ** (ctx.prec - 8)
    return (time.lower() * unit).floor().mid() / unit


def _across(
    systems: EachLaw[System], breakpoints: Breakpoints, law: int, beyond: int,
    states: Sequence[arb], longest: arb,
) -> Advance:  # fmt: skip
    """A step across a breakpoint, for as long as all states need to be on the other side."""
    both = (law, beyond)
    if not breakpoints.holds(min(both), states, max(both)):  # from there the coordinate is monotone
        raise Unproved("the motions spread over several pieces of the spring's law")
    goal = breakpoints.values[max(both) - 1]
    speed = breakpoints.coordinate(systems[law].rates([*states]))
    if not (speed > 0 or speed < 0):
        raise Unproved("a breakpoint of the spring's law is not crossed transversally")
    h = 2 * (goal - breakpoints.coordinate(states)).abs_upper() / speed.abs_lower() + arb(2) ** (16 - ctx.prec)
    for _ in range(CROSSING.windows):
        h = h.abs_upper().mid()
        whole = not h < longest
        h = longest if whole else _rounded_down(h)
        rates = _rates_across([systems[k] for k in both], states, h)
        lines = [arb_poly([x, rate]) for x, rate in zip(states, rates, strict=True)]
        step = Step(h, lines, [arb(0)] * len(states))
        pace = breakpoints.coordinate(rates)
        if not (pace > 0 or pace < 0):
            break  # a longer time would only widen it
        place = breakpoints.coordinate(step.end())
        clear = abs(place.mid() - goal) > CROSSING.clear_of * (place.rad() + goal.rad())
        if clear and breakpoints.holds(beyond, step.end()):
            return Advance(step, both, beyond)
        if whole:
            raise Unproved("the motion ends at a breakpoint of the spring's law")
        h = 2 * h
    raise Unproved("a breakpoint of the spring's law is not crossed transversally")


def _wider(value: arb) -> arb:
    """A ball of twice the radius and a little more."""
    return value + (value - value.mid()) + arb(0, (1 + abs(value)).abs_upper() * arb(2) ** -ctx.prec)


def _rates_across(systems: Sequence[System], states: Sequence[arb], h: arb) -> list[arb]:
    """The hull of the rates of two laws over a tube that is proved to hold the motions from states for a time."""
    times, tube = between(arb(0), h), list(states)
    for _ in range(CROSSING.windows):
        rates = [a.union(b) for a, b in zip(*(system.rates([*tube]) for system in systems), strict=True)]
        moved = [x + times * rate for x, rate in zip(states, rates, strict=True)]
        if not all(value.is_finite() for value in moved):
            break
        if all(x.contains(value) for x, value in zip(tube, moved, strict=True)):
            return rates
        tube = [_wider(value) for value in moved]
    raise Unproved("the motion near a breakpoint of the spring's law is not enclosed")
