"""Boundary value problems on expressions: arcs of motions with the conditions under which they are an orbit.

Half an orbit is enough, as the motions are their own mirror images in time. A flight from a launch to where all speeds
vanish is half of one that lands as it was launched, with all speeds turned; a contact that starts from there and comes
to where all its speeds vanish is half of one that ends in the launch. Where maps are stated, these are states that the
reversors of the two leave as they are, see `exact_symmetry`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from ..model import STEP_LENGTH
from ..symbolic import ExactExpression, depends_on, expression, inner_product, substitute, symbol, symbols, vanishes
from .claim import CONTACT_DURATION, FLIGHT_DURATION
from .exact_mechanics import Column, ExactMechanics, LoneExtension, unknown
from .exact_symmetry import ExactReversor
from .formulas import Domain, Domains
from .refusal import Unproved
from .stated import AT_LANDING


@dataclass(frozen=True)
class ExactArc:
    """A phase travelled once, in `duration` units of time.

    states : symbols of the m states
    rates : (laws, m), functions of the states
    weights, breaks : of the states in the coordinate along which the laws change, and the breakpoints of the laws
    before : symbols of the last states of the arc before
    start : (m,), functions of the unknowns and `before`
    duration : a function of the unknowns
    guards : (laws, g), functions of unknowns and states that vanish at the start
    conditions : functions of unknowns and states that vanish at the end
    domains : for each law, the conditions of its formulas along the motion
    constants : symbols of unknowns that the rates, the domains, or what is asked of the motion depend on
    """

    states: Column
    rates: list[Column]
    start: Column
    duration: ExactExpression
    guards: list[Column]
    conditions: Column
    domains: list[list[Domain]]
    before: tuple[ExactExpression, ...] = ()
    weights: tuple[Fraction, ...] = ()
    breaks: tuple[ExactExpression, ...] = ()
    constants: tuple[ExactExpression, ...] = ()


@dataclass(frozen=True)
class ExactStatement:
    """A square boundary value problem.

    unknowns : their symbols by name
    arcs : in the order in which they are travelled
    """

    unknowns: dict[str, ExactExpression]
    arcs: tuple[ExactArc, ...]


class HalfOrbit:
    """The statements of half an orbit of a machine.

    launch_unknowns : symbols by name of the place and the rates of the contact's coordinates at lift-off
    """

    def __init__(self, mechanics: ExactMechanics):
        self.mechanics, names = mechanics, list[str]()
        for i, coordinate in enumerate(mechanics.independent):
            name = mechanics.stated.coordinates[coordinate]
            names += ["liftoff", "alpha"] if i == mechanics.launched else [name, f"{name}'"]
        self.names, still = names, [mechanics.stated.coordinates[i] for i in mechanics.places]
        first = ["liftoff", "alpha"]
        own = (*first, *(n for n in names if n not in first), *still)
        self.launch_unknowns = {name: unknown(name) for name in own}
        self.places = [self.launch_unknowns[name] for name in names[::2]]
        self.rates = [self.launch_unknowns[name] for name in names[1::2]]
        self.lone = mechanics.lone_extension()
        if any(depends_on([each.place], mechanics.y) for each in mechanics.domains):
            self.lone = None  # whether formulas have values is checked along the motion of all coordinates
        if mechanics.stated.steps:
            self.lone = None  # what moves with the extension alone decides neither where a step lands nor what it meets
        if mechanics.tuned:
            self.lone = None
        places = (each.place for own in (mechanics.domains, *mechanics.law_domains) for each in own)
        used = [*mechanics.functions, *places, *(mechanics.pieces.breaks if mechanics.pieces else ())]
        self.constants = tuple(each for each in mechanics.tuned.values() if depends_on(used, [each]))

    def unit_of(self, name: str) -> Fraction:
        """The unit in which an unknown of this name is solved for."""
        scale = self.mechanics.scale
        if name in (FLIGHT_DURATION, CONTACT_DURATION):
            return scale.time
        if name in self.mechanics.tuned:
            return self.mechanics.tuned_units[name]
        return scale.speed if name == "alpha" or name.endswith("'") else scale.length

    @property
    def gap(self) -> ExactExpression:
        """The gap, a function of the flight state."""
        if self.mechanics.height is not None:
            return self.mechanics.height / self.mechanics.scale.length
        return inner_product([expression(weight) for weight in self.mechanics.gap], self.mechanics.y)

    @property
    def landing_gap(self) -> ExactExpression | None:
        """The gap that closes at landing, a function of the flight state; None where it is the one that opens."""
        m = self.mechanics
        (image,) = m.reversor.turned([self.gap], m.y, m.v)
        return None if vanishes(image - self.gap) else image

    @property
    def launch(self) -> Column:
        """The flight state at lift-off: coordinates and rates, alternating."""
        m = self.mechanics
        return _by_turns(m.embedded(self.places), m.embedded(self.rates, rates=True))

    @property
    def lifted(self) -> list[ExactExpression]:
        """The contact force at lift-off, for each law."""
        return [each[0] for each in self.released]

    @property
    def released(self) -> list[Column]:
        """The contact force and those on what sticks at lift-off, for each law."""
        m = self.mechanics
        at = dict(zip([*m.s, *m.w], [*self.places, *self.rates], strict=True))
        return [substitute([force, *held], at) for force, held in zip(m.contact_force, m.holding_forces, strict=True)]

    @property
    def half_flight(self) -> ExactExpression:
        """Half the flight time: an unknown, or where an extension moves alone the time that the combination in free
        fall takes to the top of its parabola."""
        if self.lone is None:
            return unknown(FLIGHT_DURATION)
        return -inner_product(self.lone.thrown, self.mechanics.embedded(self.rates, rates=True)) / self.lone.fall

    def statement(self, with_contact: bool) -> ExactStatement:
        """The smallest statement of half an orbit, with half of the contact or, for machines of two coordinates without
        tuned parameters, without. Raises `Unproved` where it has more or fewer equations than unknowns."""
        with_contact = with_contact or self.mechanics.size > 2 or bool(self.mechanics.tuned)
        unknowns = dict(self.launch_unknowns)
        if self.lone is None:
            unknowns[FLIGHT_DURATION] = self.half_flight
        first = self._whole_flight() if self.lone is None else self._lone_flight(self.lone)
        if not with_contact:
            return ExactStatement(unknowns, (first,))
        unknowns[CONTACT_DURATION] = unknown(CONTACT_DURATION)
        unknowns |= self.mechanics.tuned
        arcs = first, self._contact(len(first.states))
        equations = sum(len(arc.guards[0]) + len(arc.conditions) for arc in arcs)
        if equations != len(unknowns):
            raise Unproved(
                f"half an orbit has {equations} equations for {len(unknowns)} unknowns: tune one parameter "
                "for each equation in excess"
            )
        return ExactStatement(unknowns, arcs)

    def _off(self) -> Column:
        """What vanishes where the quantities have their prescribed values, in the machine's units."""
        return [self._quantity(name) - value for name, value in self.mechanics.stated.prescribed]

    def _quantity(self, name: str) -> ExactExpression:
        """A quantity of the orbit as a function of the unknowns; raises `Unproved` for a name that is not a
        quantity."""
        m, pace, time = self.mechanics, self.mechanics.scale.speed, self.mechanics.scale.time
        flight, contact = (2 * time * unknown(each) for each in (FLIGHT_DURATION, CONTACT_DURATION))
        if name == "alpha":
            return pace * self.launch_unknowns["alpha"]
        if name == "liftoff_extension":
            return substitute([m.counts], dict(zip(_by_turns(m.y, m.v), self.launch, strict=True)))[0]
        times = {"flight_time": flight, "contact_time": contact, "period": flight + contact}
        if name in times:
            return times[name]
        if name == "frequency":
            return 1 / (flight + contact)
        for i in m.places:
            if name == f"{m.stated.coordinates[i]}{AT_LANDING}":
                return m.scale.length * m.reversor.places(m.embedded(self.places))[i]
        if name in (STEP_LENGTH, "mean_speed") and STEP_LENGTH in m.parameters:
            step = m.parameters[STEP_LENGTH]
            return step if name == STEP_LENGTH else step / (flight + contact)
        if name == "speed" and m.stated.centre:
            rate = inner_product(m.gradient(m.formula(m.stated.centre)), m.v) / time
            return substitute([rate], dict(zip(_by_turns(m.y, m.v), self.launch, strict=True)))[0]
        raise Unproved(
            f"no equation of half an orbit contains '{name}': prescribe another quantity, or tune fewer parameters"
        )

    def flight(self) -> ExactStatement:
        """The half flight in all of its states, without conditions."""
        arc = self._whole_flight()
        unknowns = self.launch_unknowns | ({FLIGHT_DURATION: self.half_flight} if self.lone is None else {})
        free = ExactArc(
            arc.states, arc.rates, arc.start, arc.duration, [[] for _ in arc.guards], [], arc.domains, (), arc.weights,
            arc.breaks,
        )  # fmt: skip
        return ExactStatement(unknowns, (free,))

    def _whole_flight(self) -> ExactArc:
        m = self.mechanics
        states = _by_turns(m.y, m.v)
        rates = [_by_turns(m.v, accelerations) for accelerations in m.accelerations]
        weights, breaks = (
            (_by_turns(m.pieces.weights, [Fraction(0)] * m.size), m.pieces.breaks) if m.pieces else ((), ())
        )
        domains = self._mirrored([[*m.domains, *own] for own in m.law_domains], m.reversor, m.order, (m.y, m.v))
        ends = m.reversor.fixed(m.y, m.v)
        return ExactArc(
            states, rates, self.launch, self.half_flight, self.released, ends, domains, (), tuple(weights), breaks,
            self.constants,
        )  # fmt: skip

    def _lone_flight(self, lone: LoneExtension) -> ExactArc:
        m, r, rate = self.mechanics, lone.place, symbol("rate of the lone extension")
        place, speed = (
            inner_product(lone.weights, m.embedded(self.places)),
            inner_product(lone.weights, m.embedded(self.rates, rates=True)),
        )
        weights: tuple[Fraction, ...] = ()
        breaks: tuple[ExactExpression, ...] = ()
        if m.pieces:
            first = next(i for i in (0, 1) if m.pieces.weights[i])
            weights = (m.pieces.weights[first] / lone.weights[first].value, Fraction(0))
            breaks = m.pieces.breaks
        rates = [[rate, acceleration] for acceleration in lone.accelerations]
        domains = [[*m.domains, *own] for own in lone.domains]
        guards = [[each] for each in self.lifted]
        return ExactArc(
            [r, rate], rates, [place, speed], self.half_flight, guards, [rate], domains, (), weights, breaks
        )

    def _contact(self, before: int) -> ExactArc:
        m = self.mechanics
        states = _by_turns(m.s, m.w)
        rates = [_by_turns(m.w, accelerations) for accelerations in m.contact_accelerations]
        back = m.contact_reversor
        start = _by_turns(back.places(self.places), back.rates(self.rates))
        weights: tuple[Fraction, ...] = ()
        breaks: tuple[ExactExpression, ...] = ()
        if m.pieces:
            along_contact = m.in_contact(m.pieces.weights)
            weights, breaks = tuple(_by_turns(along_contact, [Fraction(0)] * len(m.s))), m.pieces.breaks
        each_law = [self._in_contact([*m.domains, *own]) for own in m.law_domains]
        domains = self._mirrored(each_law, back, m.contact_order, (m.s, m.w))
        ends = [*back.fixed(m.s, m.w), *self._off()]
        return ExactArc(
            states, rates, start, unknown(CONTACT_DURATION), [[] for _ in rates], ends, domains,
            tuple(symbols("before", before)), weights, breaks, (*self.constants, *m.places.values()),
        )  # fmt: skip

    def _mirrored(
        self, domains: list[list[Domain]], back: ExactReversor, order: int, states: tuple[Column, Column]
    ) -> list[list[Domain]]:
        """The conditions of formulas for each law, also in the other half of the motion, where these are other ones."""
        if not self.mechanics.stated.steps:
            return domains
        found = [Domains(own) for own in domains]
        for own, images in zip(found, domains[::order], strict=True):
            for each in images:
                (place,) = back.turned([each.place], *states)
                own.need(each.what, place, each.positive)
        return [list(own) for own in found]

    def _in_contact(self, domains: Sequence[Domain]) -> list[Domain]:
        """The conditions of formulas, in the contact's states."""
        m, found = self.mechanics, Domains()
        for each in domains:
            (place,) = substitute([each.place], m.contact)
            found.need(each.what, place, each.positive)
        return found


def _by_turns(first: Sequence, second: Sequence) -> list:
    return [each for pair in zip(first, second, strict=True) for each in pair]
