"""The parts of a proved curve along which the orbits are motions.

On a part of a piece the states along the motion are enclosed for all of its places together, so that Lemmas 5 and 6 of
this package decide the signs for all of its orbits. Where one stays undecided, the part is halved. A contact is added
to the orbits of a piece by a tube for half its time, the other unknowns being known within theirs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, arb_mat, arb_poly

from ..balls import (
    BallLeg,
    CurveStep,
    Motion,
    TaylorModel,
    as_model,
    coefficients_through,
    follow_curve,
    passage_on,
    places,
    prove_tube,
)
from ..errors import OrbitsError
from ..exact import CONTACT_DURATION, TooLong, Unproved, unknown
from ..symbolic import symbol
from .branch_claim import Solver
from .branch_piece import BRANCHES, CurveEquations, CurvePiece, parts_between
from .proved_motion import CONDITIONS, NO_CONTACT, PROVED, UNDECIDED, counted_family, motion_conditions


@dataclass(frozen=True)
class MotionStretch:
    """A part of a piece, between two places, with the verdicts on the motions there.

    conditions : by name "proved", "refuted" or "undecided"
    reasons : for each statement that is not proved, the reason in words
    """

    piece: CurvePiece
    low: float
    high: float
    family: int | None
    conditions: Mapping[str, str]
    reasons: tuple[str, ...]

    @property
    def decided(self) -> bool:
        """Whether all is proved or refuted."""
        return self.family is not None and UNDECIDED not in self.conditions.values()

    @property
    def admissible(self) -> bool:
        """Whether all is proved."""
        return self.family is not None and all(each == PROVED for each in self.conditions.values())

    def like(self, other: "MotionStretch") -> bool:
        """Whether the same is proved as of another stretch."""
        return self.family == other.family and self.conditions == other.conditions


@dataclass(frozen=True)
class _Contact:
    """The contacts of the orbits between two places of a piece."""

    low: float
    high: float
    leg: BallLeg
    steps: list[CurveStep]

    def on(self, low: float, high: float) -> Motion:
        """The contacts between two places of the piece."""
        middle, half = (arb(self.low) + self.high) / 2, (arb(self.high) - self.low) / 2
        return Motion(self.leg, passage_on(self.steps, (arb(low).union(arb(high)) - middle) / half))


class MotionChecks:
    """The checks of whether the orbits of pieces of a curve are motions."""

    def __init__(self, equations: CurveEquations, solve: Solver):
        self.equations, self.solve = equations, solve
        half, parameter = equations.half, [symbol(equations.along)]
        self.names = [each for each in CONDITIONS if each != "separation" or equations.stated.separation is not None]
        self.flight_leg, self.contact_leg = equations.legs[0], equations.legs[-1]
        if half.lone is not None:
            self.flight_leg = BallLeg(half.flight().arcs[0], equations.inputs, parameter)
        if CONTACT_DURATION not in equations.names:
            arc = replace(half.statement(with_contact=True).arcs[-1], before=())
            self.contact_leg = BallLeg(arc, [*equations.inputs, unknown(CONTACT_DURATION)], parameter)

    def along(self, piece: CurvePiece, low: float, high: float) -> list[MotionStretch]:
        """The verdicts on the motions between two places of a piece, in order; raises `Unproved` where the flights
        are not even enclosed."""
        flight, found = self._flight(piece), list[MotionStretch]()
        for first, last, contact in self._contacts(piece, low, high, BRANCHES.halvings_of_contact):
            waiting = [(*part, BRANCHES.halvings_of_signs) for part in parts_between(first, last)[::-1]]
            while waiting:
                begin, end, left = waiting.pop()
                stretch = self._decided(piece, flight, contact, begin, end)
                if not _is_final(stretch) and left:
                    middle = (begin + end) / 2
                    waiting += [(middle, end, left - 1), (begin, middle, left - 1)]
                elif found and found[-1].like(stretch):
                    found[-1] = replace(found[-1], high=end)
                else:
                    found.append(stretch)
        return found

    def _flight(self, piece: CurvePiece) -> list[CurveStep]:
        if self.flight_leg is self.equations.legs[0]:
            return piece.tube.values.steps[0]
        models = [TaylorModel(p.parts, r) for p, r in zip(piece.tube.polynomials, piece.tube.radii, strict=True)]
        start = [*map(as_model, self.flight_leg.start(models))]
        return follow_curve(self.flight_leg.variation, start, [[each.rest for each in start]])

    def _contacts(
        self, piece: CurvePiece, low: float, high: float, left: int
    ) -> list[tuple[float, float, _Contact | None]]:
        """Parts between two places with their contacts, None where none is proved."""
        if self.contact_leg is self.equations.legs[-1]:
            return [(low, high, _Contact(-1.0, 1.0, self.contact_leg, piece.tube.values.steps[-1]))]
        try:
            return [(low, high, self._contact(piece, low, high))]
        except TooLong:
            raise
        except (Unproved, OrbitsError):
            if left == 0:
                return [(low, high, None)]
        middle = (low + high) / 2
        return [*self._contacts(piece, low, middle, left - 1), *self._contacts(piece, middle, high, left - 1)]

    def _contact(self, piece: CurvePiece, low: float, high: float) -> _Contact:
        """The contacts of all orbits between two places, by a tube for half their time."""
        middle, half = (low + high) / 2, (high - low) / 2
        first, last = float(piece.start), float(piece.stop)
        values = (first + last) / 2 + (last - first) / 2 * (middle + half * np.array(places()))
        _, halves = self.solve(piece.coordinate, values, piece.numerical(values))
        if not np.isfinite(halves).all():
            raise Unproved(NO_CONTACT)
        unit = float(self.equations.half.unit_of(CONTACT_DURATION))
        rows = arb_mat([[arb(float(each) / unit)] for each in halves])
        duration = TaylorModel.of_curve([each[0] for each in coefficients_through(rows).tolist()])
        moved = arb_poly([(arb(low) + high) / 2, (arb(high) - low) / 2])
        *own, parameter = (_on_part(p, moved) for p in piece.tube.polynomials)
        *radii, last_radius = piece.tube.radii
        tube = prove_tube([self.contact_leg], [*own, duration, parameter], [len(own)], [*radii, arb(0), last_radius])
        if not tube.at(len(own), arb(0, 1)) > 0:
            raise Unproved("the time of the contact is not proved to be positive")
        return _Contact(low, high, self.contact_leg, tube.values.steps[0])

    def _decided(
        self, piece: CurvePiece, steps: Sequence[CurveStep], contact: _Contact | None, low: float, high: float
    ) -> MotionStretch:
        half = self.equations.half
        undecided = dict.fromkeys(self.names, UNDECIDED)
        try:
            flight = Motion(self.flight_leg, passage_on(steps, arb(low).union(arb(high))))
            contacts = None if contact is None else contact.on(low, high)
            for motion in filter(None, (flight, contacts)):
                motion.leg.check_domains(motion.passage)
            counted = counted_family(half, flight, None)
            verdicts = motion_conditions(half, flight, contacts, self.names)
        except TooLong:
            raise
        except Unproved as error:
            return MotionStretch(piece, low, high, None, undecided, (str(error),))
        reasons = *counted.reasons, *verdicts.reasons
        return MotionStretch(piece, low, high, counted.family, verdicts.conditions, reasons)


def _is_final(stretch: MotionStretch) -> bool:
    """Whether halving a part would decide no more: all is decided that needs no contact."""
    undecided = [name for name, verdict in stretch.conditions.items() if verdict == UNDECIDED]
    return stretch.family is not None and all(f"{name}: {NO_CONTACT}" in stretch.reasons for name in undecided)


def _on_part(model: TaylorModel, place: arb_poly) -> TaylorModel:
    """A polynomial in s with another polynomial in place of s."""
    polynomial = arb_poly([sum(part.coeffs(), arb(0)) for part in model.parts])
    return TaylorModel.of_curve(polynomial(place).coeffs())
