"""Launches of machines of two coordinates: the law that holds the contact closed, and the extension that moves
independently.

Where all springs act along one extension r, and gravity is constant, that extension moves alone, and the momentum
across it is thrown up. With (r, w) = apart y, w'' = -1 and y = mix (r, w), the gap's second derivative vanishes at
lift-off, where r'' = -rate: so rate = -(gap mix_w)/(gap mix_r).
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import InputError
from ..laws import Algebraic, Key, LawPieces, Parameters, Scalars
from ..model import Liftoff, Modes, Reduction, Relative, data_at, is_used, single_mode, straight_line
from ..symbolic import (
    ONE,
    ZERO,
    Column,
    ExactExpression,
    exact_number,
    inner_product,
    substitute,
    symbols,
    total,
    vanishes,
)
from .coefficients import Coefficients
from .coordinates import all_vanish
from .elements import Force, Potential, Scalar, Spring, value_of
from .lagrange import InFlight, Mechanics

# The launch speed, as a parameter of the law by which a machine lifts off whose contact force depends on its speed.
SPEED_OF_LAUNCH = "_launch_speed"


class Launch(NamedTuple):
    """The launches of a machine, as they follow from its mechanics.

    relative : the law that is reached at lift-off, and the motion of its extension
    reduction : the smaller statement under constant gravity; None where no extension moves alone
    liftoff_slope : as in `Model`
    """

    relative: Relative
    reduction: Reduction | None = None
    liftoff_slope: Callable | None = None


def launch_of(mechanics: Mechanics, alone: "Alone | None", level: str, rest: Scalar) -> Launch | None:
    """The launches of a machine, None where its contact has several coordinates, or it has no gap.

    alone : the extension that moves alone, None where none does
    level : the value of the springs' force at lift-off, in words
    rest : where the coordinate that is launched rests
    """
    if mechanics.size != 2 or not mechanics.gap.eliminated:
        return None
    return alone.launch(mechanics, level) if alone and rest == 0.0 else _held(mechanics, rest)


class Alone:
    """The extension that moves alone, whatever the laws are.

    springs : the springs, each with the factor and the offset by which its own extension follows from that one
    """

    def __init__(
        self, mechanics: Mechanics, springs: Sequence[tuple[Spring, Fraction, ExactExpression]], along: Column
    ):
        self.mechanics, self.springs = mechanics, springs
        c, gap, flight, contact = mechanics.coordinates, mechanics.gap, mechanics.in_flight, mechanics.in_contact
        weight, embed = weight_of(flight), [exact_number(row[0]) for row in gap.exact_embed[:2]]
        across, columns = across_line(along), list(zip(*flight.kinetics.matrix, strict=True))
        # The rows are scaled so that the thrown coordinate falls with acceleration 1.
        fall = inner_product(across, weight)
        (a, b), (d, e) = apart = along, [inner_product(across, column) / fall for column in columns]
        determinant = a * e - b * d
        mix = [[e / determinant, -b / determinant], [-d / determinant, a / determinant]]
        by_extension, by_throw = (inner_product(gap.held[0], column) for column in zip(*mix, strict=True))
        rate = -by_throw / by_extension
        self.rate, self.gap_slope_of = self._number(rate), self._number(by_extension)
        self.lifted = self._number(inner_product(apart[1], embed))
        self.mix, self.apart = c.coefficients(mix), c.coefficients(apart)
        pulls = [-inner_product(along, column) / rate for column in zip(*flight.accelerations, strict=True)]
        acting = [next(i for i, term in enumerate(flight.terms) if term.element is spring) for spring, *_ in springs]
        self.shares = [self._number(pulls[i]) for i in acting]
        load = total(pulls[i] for i, term in enumerate(flight.terms) if term.is_weight)
        self.load, self.offsets = self._number(load), [self._number(offset) for *_, offset in springs]
        # The contact force is this multiple of phi + load - 1, and each damper adds to it.
        multiple = by_extension * rate * flight.impact_mass[0][0]
        dampers = [
            (row, term) for row, term in zip(contact.row[0], contact.terms, strict=True) if term.what == "damper"
        ]
        damping = total(row * inner_product(c.gradient(term.place)[:2], embed) for row, term in dampers)
        self.damping = self._number(damping / multiple)
        # In contact the same phi pulls at the one remaining coordinate s: s'' = fall - pull (phi + load).
        inertia = contact.inertia[0][0]
        pull = springs[0][1] / (pulls[acting[0]] * inertia)
        self.held = c.coefficients([[pull, pull * load - inner_product(weight, embed) / inertia, multiple]])

    @classmethod
    def of(cls, mechanics: Mechanics) -> "Alone | None":
        """The extension of a machine that moves alone; None where there is none."""
        springs = [element for element in mechanics.elements if isinstance(element, Spring)]
        unusual = any(isinstance(element, Potential | Force) for element in mechanics.elements)
        if (
            mechanics.size != 2
            or not mechanics.gap.eliminated
            or not springs
            or unusual
            or mechanics.in_flight.coefficients.by_coordinates
            or mechanics.in_flight.quadratic
            or not _is_level(mechanics)
        ):
            return None
        c, found, along = mechanics.coordinates, list[tuple[Spring, Fraction, ExactExpression]](), list[Fraction]()
        for spring in springs:
            weights = c.weights(spring.extension)
            if weights is None or not (factor := mechanics.gap.weights_inside(weights)[0]):
                return None
            direction = [weight / factor for weight in weights[:2]]
            along = along or direction
            if direction != along:
                return None
            found.append((spring, factor, c.at_zero(spring.extension)))
        line = list(map(exact_number, along))
        falls = not vanishes(inner_product(across_line(line), weight_of(mechanics.in_flight)))
        alone = cls(mechanics, found, line) if falls else None
        # Where the gap does not depend on the extension, a ball lands whatever the spring does.
        return alone if alone and alone.gap_slope_of.constant != 0.0 else None

    def _number(self, expression: ExactExpression) -> "_Number":
        """p -> the value of an expression."""
        return _Number(self.mechanics.coordinates.coefficients([[expression]]))

    def launch(self, mechanics: Mechanics, level: str) -> Launch:
        """The launches with the laws of the mechanics."""
        law, load = self._law(mechanics)
        rate = None if self.rate.constant == 1.0 else self.rate
        gravity = mechanics.gravity.key if mechanics.gravity.varies else None

        def scale(
            p: Parameters,
        ) -> tuple[Algebraic, Algebraic, float]:  # the first spring's force, without the load in the law
            return 1 / self.shares[0](p), self.load(p) - load, 0.0

        relative = Relative(law, gravity, Liftoff(load, level, scale), rate, self.damping)
        return Launch(relative, relative.reduction(self.complete, self.gap_slope))

    def flight(self, relative: Relative, p: Parameters) -> Modes:
        """The exact flow of the flight where the laws are straight lines: one mode is thrown, the extension swings."""
        assert relative.phase.closed_form is not None
        swing = relative.phase.closed_form(p)
        mix, apart = np.array(self.mix(p), dtype=float), np.array(self.apart(p), dtype=float)
        return Modes(np.append(0.0, swing.squares), mix[:, ::-1], apart[::-1], np.append(-1.0, swing.loads))

    def contact(self, relative: Relative, p: Parameters) -> Modes:
        """The exact flow of the contact where the laws are straight lines, with the contact force."""
        (pull, fall, multiple), (k, zero) = self.held(p)[0], straight_line(relative.law, p)
        load = relative.liftoff.load - k * zero  # phi + load where the coordinate is 0
        force = (multiple * k, 0.0), multiple * (load - 1)
        return single_mode(pull * k, fall - pull * load, {"contact force": force})

    def _law(self, mechanics: Mechanics) -> tuple[Key, float]:
        """The law phi and the load of the extension's motion r'' = -rate (phi + load)."""
        laws, load = [mechanics.law_of(spring) for spring, *_ in self.springs], self.load.constant
        (_, factor, _), law = self.springs[0], laws[0]
        plain = len(self.springs) == 1 and factor == 1 and self.offsets[0].constant == 0.0
        if plain and self.shares[0].constant == 1.0 and load == load:
            return law, load
        if (piecewise := [law.text for law in laws if law.pieces]) and not plain:
            one = "state all springs along it as one law, springs.function(force, breakpoints=...), or fit a formula"
            raise InputError(
                f"spring '{piecewise[0]}' is in pieces: it must act alone, along the launched coordinate; {one}"
            )
        each = zip(laws, self.springs, self.shares, self.offsets, strict=True)
        parts = [(law.expression, float(factor), share, offset) for law, (_, factor, _), share, offset in each]

        def expression(r: Algebraic, p: Parameters, q: Scalars) -> Algebraic:
            forces = [share(p) * law(factor * r + offset(p), p, q) for law, factor, share, offset in parts]
            return sum(forces, self.load(p))

        texts, names = [law.text for law in laws], tuple(mechanics.coordinates.p)
        return Key(" + ".join(texts), "r", expression, names, law.pieces), 0.0

    def complete(self, times: np.ndarray, coefficients: np.ndarray, u: Parameters, p: Parameters) -> np.ndarray:
        """The Taylor coefficients of all flight states, see `Reduction`."""
        lifted, swung = self.lifted(p), coefficients[:, :2]
        height, speed = lifted * u["liftoff"] + times * (lifted * u["alpha"] - times / 2), lifted * u["alpha"] - times
        thrown = (0, 0, height), (0, 1, speed), (0, 2, -0.5), (1, 0, speed), (1, 1, -1.0)
        rows = np.zeros((len(times), 4, coefficients.shape[2]))
        for i, (by_extension, by_throw) in enumerate(self.mix(p)):
            target = rows[:, 2 * i : 2 * i + 2]
            if is_used(by_extension):
                np.multiply(_for_steps(by_extension), swung, out=target)
            for row, order, value in thrown if is_used(by_throw) else ():
                target[:, row, order] += by_throw * value
        return rows

    def gap_slope(self, times: np.ndarray, dz: np.ndarray, p: Parameters) -> np.ndarray:
        """The derivative of the gap by the launch speed, see `Reduction`."""
        return self.gap_slope_of(p) * (dz[0] - times)


def across_line(along: Column) -> Column:
    """A row (2,) across a direction (2,)."""
    return [-along[1], along[0]]


def weight_of(flight: InFlight) -> Column:
    """The gradient (n,) of the weights."""
    columns = [term.gradient for term in flight.terms if term.is_weight]
    return [total(each[i] for each in columns) for i in range(flight.kinetics.size)]


class _Number:
    """p -> a number; `constant` is the number where it is the same for all p, else NaN."""

    def __init__(self, coefficients: Coefficients):
        self.coefficients, self.constant = coefficients, coefficients.constants[0]

    def __call__(self, p: Parameters) -> Algebraic:
        return self.coefficients(p)[0][0]


def _for_steps(value: Algebraic) -> Algebraic:
    """A number for all of N steps, or (N,) numbers as (N, 1, 1); products with one number are several times faster."""
    if isinstance(value, float) or (value == value.flat[0]).all():
        return value if isinstance(value, float) else float(value.flat[0])
    return np.reshape(value, (-1, 1, 1))


def _is_level(mechanics: Mechanics) -> bool:
    """Whether gravity enters the contact force by its value on the ground alone, even where it varies."""
    c, contact = mechanics.coordinates, mechanics.in_contact
    pulls = zip(contact.terms, contact.row[0], strict=True)
    heights = [c.scalar(term.place) for term, pull in pulls if term.what == "gravity" and not vanishes(pull)]
    return all_vanish(mechanics.gap.inside(heights))


def _scales_at(mechanics: Mechanics, start: ca.SX) -> list[ca.SX]:
    """A unit of the contact force, and the rate of a launch: both follow at lift-off from the slopes at rest.

    With the acceleration F of the launched coordinate in flight, the contact force lambda vanishes at the extension
    r = -lambda/lambda', and there the contact and the flight have one acceleration, the rate = -(F + F' r). In the unit
    lambda' rate/F' the contact force has the slope of the extension's own motion.
    """
    m, c, s = mechanics, mechanics.coordinates, ca.SX.sym("s")
    ends, still = [0.0] * len(c.actuators), {**c.p, **{rate: ca.SX(0) for _, rate in c.actuators}}
    force, place = ca.SX(m.contact_force([s, ca.SX(0), *ends], still, [])), m.embedded([s, *ends])
    launched = m.gap.left[0]
    state = [part for y in place[: m.size] for part in (y, ca.SX(0))]
    motion = ca.SX(m.flight([*state, *ends], still, [])[2 * launched + 1])
    at_start = [
        ca.substitute(part, s, start) for part in (force, ca.gradient(force, s), motion, ca.gradient(motion, s))
    ]
    level, slope, fall, stiffness = at_start
    rate = -(fall - stiffness * level / slope)
    # Without a slope at rest there is no scale; the stated numbers are then taken to be of order 1.
    regular = ca.logic_and(ca.fabs(slope) > 1e-12, ca.logic_and(stiffness < -1e-12, rate > 1e-12))
    return [ca.if_else(regular, slope * rate / stiffness, 1.0), ca.if_else(regular, rate, 1.0)]


def _has_rates(mechanics: Mechanics) -> bool:
    """Whether the contact force depends on the rate of the coordinate that is launched, the actuators at rest."""
    contact, gap, found = mechanics.in_contact, mechanics.gap, mechanics.in_contact.bent_row[0]
    for force, term in zip(contact.row[0], contact.terms, strict=True):
        if term.by_rates is not None:
            found = found + force * gap.inside([term.by_rates])[0]
    still = dict.fromkeys(gap.w, ZERO)
    (moving,) = substitute([found], dict.fromkeys(gap.w[1:], ZERO))
    return not vanishes(moving - substitute([found], still)[0])


def _pieces_of_launch(m: Mechanics, start: Scalar) -> LawPieces | None:
    """The pieces of the law whose extension in contact is the launched coordinate, counted from where it rests; raises
    `InputError` for a law in pieces along anything else."""
    c, gap, pieces = m.coordinates, m.gap, None
    first, *others = gap.s
    (r,) = symbols("launched", 1)
    place = {first: c.scalar(start) + r, **dict.fromkeys(others, ZERO)}
    for spring in (element for element in m.elements if isinstance(element, Spring)):
        if (law := m.law_of(spring)).pieces:
            (extension,) = substitute(gap.inside([c.scalar(spring.extension)]), place)
            if pieces or not vanishes(extension - r):
                where = "its extension must be the launched coordinate, counted from its rest"
                why = "elsewhere lift-off has no formula; state a formula instead"
                raise InputError(f"spring '{law.text}' is in pieces: {where}, since {why}")
            pieces = law.pieces
    return pieces


def _held(mechanics: Mechanics, rest: Scalar) -> Launch:
    """The launch of a machine whose contact force is a function of the coordinate that is launched and of its rate."""
    m, c = mechanics, mechanics.coordinates
    pieces = _pieces_of_launch(m, rest)
    # The slopes of a law in pieces at rest are those of one piece: there the stated numbers are taken to be of order 1.
    start = ca.SX(value_of(rest, {}, c.p))
    scales = [ONE, ONE] if pieces else c.lifted(_scales_at(mechanics, start))
    numbers = c.coefficients([[*scales, c.scalar(rest)]])

    def expression(r: Algebraic, p: Parameters, q: Scalars) -> Algebraic:
        unit, _, start = numbers(p)[0]
        state = [start + r, p[SPEED_OF_LAUNCH], *(0.0 for _ in c.actuators)]
        return 1 - m.contact_force(state, {**p, **{rate: 0.0 for _, rate in c.actuators}}, q) / unit

    law = Key("the contact force", "r", expression, (*c.p, SPEED_OF_LAUNCH), pieces)
    still = not _has_rates(m)
    if still:  # A speed that makes no difference is not a parameter.
        law = law._replace(expression=lambda r, p, q: expression(r, {**p, SPEED_OF_LAUNCH: 0.0}, q), names=tuple(c.p))
    gravity, by_speed = m.gravity.key if m.gravity.varies else None, None if still else SPEED_OF_LAUNCH
    rate, offset = (lambda p: numbers(p)[0][1]), (lambda p: numbers(p)[0][2])
    liftoff = Liftoff(0.0, "0", lambda p: (-numbers(p)[0][0], 1.0, offset(p)), "{law}")
    relative = Relative(law, gravity, liftoff, rate, by_speed=by_speed, rest=offset)
    if still:
        return Launch(relative)
    own = ca.SX.sym("r"), ca.SX.sym("speed")
    q = data_at(own[0] * pieces.units(c.p) - pieces.origins(c.p), *pieces.table(c.p)) if pieces else []
    force = ca.SX(expression(own[0], {**c.p, SPEED_OF_LAUNCH: own[1]}, q))
    by_extension, by_rate = (ca.jacobian(force, each) for each in own)
    place = symbols("launched", 2)
    slope = c.coefficients([c.lifted([-by_rate / by_extension], dict(zip(own, place, strict=True)))], place)
    return Launch(relative, None, lambda u, p: slope(p, [u["liftoff"] - offset(p), u["alpha"]])[0][0])
