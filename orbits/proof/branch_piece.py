"""Pieces of a curve of orbits along a parameter: proved tubes, their solutions, and the turns of the parameter."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_poly

from ..balls import (
    BallLeg,
    BallProgram,
    TaylorModel,
    Tube,
    ball_of_fraction,
    coefficients_through,
    passage_on,
    places,
    prove_tube,
)
from ..exact import CONTACT_DURATION, FLIGHT_DURATION, ExactMechanics, HalfOrbit, Scale, StatedMachine, Unproved
from ..symbolic import symbol
from .branch_claim import Solver


class BranchOptions(NamedTuple):
    """The pieces of a proved curve: where they begin and end, what is decided on their parts, and folds on them."""

    # Largest size of the last coefficients of a piece's polynomials, relative to the first; else it is too long.
    last_coefficients: float = 1e-9
    parts: int = 4  # of a piece on which signs are decided
    halvings: int = 40  # of a part on which a sign is undecided, at most
    undecided: int = 12  # parts to halve, at most
    halvings_of_contact: int = 4  # of a part of a piece whose contact is not proved
    halvings_of_signs: int = 7  # of a part of a piece on which a sign is undecided
    # Share of the parameter in the motion along the curve from which on it is the coordinate of a piece, else the
    # launch speed.
    share_of_parameter: float = 0.5
    share_to_stay: float = 0.25  # share of the parameter down to which it remains the coordinate
    # Share of its length by which a piece begins and ends farther out where the coordinate changes.
    margin_at_joints: float = 0.02
    first_reach: int = 64  # points of the family that the first piece tries to cover
    longer: int = 4  # factor by which the next piece tries to cover more
    inserted: int = 400  # points between those of the family, at most
    closest: float = 1e-7  # points, relative to the coordinate
    about_fold: float = 0.05  # least length of the shorter piece about a fold, as a share of its piece
    about_undecided: float = 2.0  # least length of the shorter piece as a multiple of the undecided part at the fold
    margin_of_undecided: float = 1e-6  # on either side of the undecided part, for roundings
    # Size of the box that is to hold no other fold, relative to the enclosure of the folds on the curve.
    room_at_fold: int = 4


BRANCHES = BranchOptions()


class CurveEquations:
    """The equations of half an orbit and the parameter as a further unknown, the last of the coordinates.

    names, units : of the coordinates, and those in which they are solved for
    """

    def __init__(self, stated: StatedMachine, along: str, scale: Scale):
        self.stated, self.along = stated, along
        self.mechanics = ExactMechanics(stated, scale, along)
        self.half = HalfOrbit(self.mechanics)
        if self.mechanics.pieces:
            raise Unproved("the spring's law is in pieces, but a curve can be proved only for smooth laws")
        self.statement = self.half.statement(with_contact=False)
        self.names = [*self.statement.unknowns, along]
        self.units = [*map(self.half.unit_of, self.statement.unknowns), Fraction(1)]
        self.inputs = [*self.statement.unknowns.values()]
        self.legs = [BallLeg(arc, self.inputs, [symbol(along)]) for arc in self.statement.arcs]
        self._half_flight = BallProgram([*self.inputs, symbol(along)], [self.half.half_flight])
        self.parameter, self.speed = len(self.names) - 1, self.names.index("alpha")

    def balls(self, values: dict[str, arb]) -> list[arb]:
        """Coordinates by name, in units of the machine, in those of the equations."""
        return [values[name] / ball_of_fraction(unit) for name, unit in zip(self.names, self.units, strict=True)]

    def in_machine(self, values: Sequence[arb]) -> dict[str, arb]:
        """Coordinates in units of the equations, by name in those of the machine."""
        return {name: value * ball_of_fraction(unit)
                for name, value, unit in zip(self.names, values, self.units, strict=True)}  # fmt: skip

    def check_positive(self, values: Sequence[arb]) -> None:
        """Raise `Unproved` where alpha or a time is not above 0."""
        known = dict(zip(self.names, values, strict=True))
        needed = [known[name] for name in ("alpha", FLIGHT_DURATION, CONTACT_DURATION) if name in known]
        if not all(value > 0 for value in (*needed, *self._half_flight(values))):
            raise Unproved("alpha and the times are not proved to be positive along the curve")


@dataclass(frozen=True)
class CurvePiece:
    """A proved piece, on which one coordinate runs from one value to another, and the others lie in a tube.

    coordinate : the index of that one
    start, stop : its exact values, in the units of the machine
    coefficients : (coordinates, degrees) decimals of the polynomials in s, in the units of the machine
    """

    equations: CurveEquations
    coordinate: int
    start: Fraction
    stop: Fraction
    coefficients: list[list[Fraction]]
    tube: Tube

    @property
    def direction(self) -> int:
        """1 if the coordinate grows from start to stop, else -1."""
        return 1 if self.stop > self.start else -1

    def place(self, value: arb) -> arb:
        """The place s of a value of the coordinate in the units of the equations."""
        unit = ball_of_fraction(self.equations.units[self.coordinate])
        middle, half = ball_of_fraction((self.start + self.stop) / 2), ball_of_fraction((self.stop - self.start) / 2)
        return (value * unit - middle) / half

    def value(self, s: float) -> arb:
        """The value of the coordinate at a place, in the units of the equations."""
        middle, half = ball_of_fraction((self.start + self.stop) / 2), ball_of_fraction((self.stop - self.start) / 2)
        return (middle + half * arb(s)) / ball_of_fraction(self.equations.units[self.coordinate])

    def at(self, s: arb) -> list[arb]:
        """Enclosures of all coordinates at the places of a ball."""
        return [self.tube.at(i, s) for i in range(len(self.equations.names))]

    def numerical(self, values: np.ndarray) -> np.ndarray:
        """Approximate coordinates (m, n + 1) where that of the piece has values (m,), in the units of the machine."""
        middle, half = float(self.start + self.stop) / 2, float(self.stop - self.start) / 2
        places_of = (values - middle) / half
        columns = [np.polyval([float(each) for each in row[::-1]], places_of) for row in self.coefficients]
        columns[self.coordinate] = values
        return np.array(columns).T

    def holds(self, values: Sequence[arb], s: arb | None = None) -> arb | None:
        """The place of a solution whose coordinates are enclosed, which is s where it is known exactly; None where the
        solution is not proved to be on the piece."""
        place = self.place(values[self.coordinate]) if s is None else s
        return place if _within(place) and self.tube.holds(values, place) else None

    def turning(self, s: arb) -> int:
        """The sign of the parameter's derivative by s at the places of a ball, 0 where it is not decided."""
        slope = self.tube.slope_at(self.equations.parameter, s)
        return int(slope > 0) - int(slope < 0)


def _within(s: arb) -> bool:
    """Whether places are on a piece, whose end is exactly 1 where they are a single number."""
    return bool(s >= -1) and bool(s <= 1)


# Guesses (m, n + 1) of the points of the curve where the coordinate of a piece has values (m,).
NumericalCurve: TypeAlias = Callable[[np.ndarray], np.ndarray]


def numerical_piece(
    equations: CurveEquations, solve: Solver, guess: NumericalCurve, coordinate: int, start: Fraction, stop: Fraction
) -> tuple[list[list[Fraction]], list[TaylorModel], float]:
    """The polynomials of a piece through the numerical curve, as decimals and as models in the units of the equations,
    and the size of their last coefficients relative to the first."""
    middle, half = (start + stop) / 2, (stop - start) / 2
    values = float(middle) + float(half) * np.array(places())
    rows, _ = solve(coordinate, values, guess(values))
    found = coefficients_through(arb_mat([[arb(float(each)) for each in row] for row in rows])).tolist()
    columns = [[Fraction(Decimal(repr(float(each)))) for each in column] for column in zip(*found, strict=True)]
    columns[coordinate] = [middle, half]
    sizes = [max(abs(each) for each in column) or Fraction(1) for column in columns]
    last = max(float(max(map(abs, column[-2:])) / size)
               for i, (column, size) in enumerate(zip(columns, sizes, strict=True)) if i != coordinate)  # fmt: skip
    models = [TaylorModel.of_curve([ball_of_fraction(each / unit) for each in column])
              for column, unit in zip(columns, equations.units, strict=True)]  # fmt: skip
    return columns, models, last


def prove_piece(
    equations: CurveEquations, solve: Solver, guess: NumericalCurve, coordinate: int, start: Fraction, stop: Fraction
) -> CurvePiece:
    """The piece on which a coordinate runs from one value to another. Raises `Unproved`, and an `OrbitsError` where the
    numerical curve is lost."""
    columns, models, last = numerical_piece(equations, solve, guess, coordinate, start, stop)
    if not last <= BRANCHES.last_coefficients:
        raise Unproved("a piece of the curve is too long for its polynomials")
    others = [i for i in range(len(models)) if i != coordinate]
    tube = prove_tube(equations.legs, models, others, [arb(0)] * len(models))
    piece = CurvePiece(equations, coordinate, start, stop, columns, tube)
    _check_whole(piece)
    return piece


def _check_whole(piece: CurvePiece) -> None:
    """Prove that alpha and the times are positive, and formulas have values, on the whole piece."""
    waiting = [(part, BRANCHES.halvings // 4) for part in parts_between(-1.0, 1.0)]
    legs = [*zip(piece.equations.legs, piece.tube.values.steps, strict=True)]
    while waiting:
        (low, high), left = waiting.pop()
        s = arb((low + high) / 2, (high - low) / 2)
        try:
            piece.equations.check_positive(piece.at(s))
            for leg, steps in legs:
                if leg.arc.domains[0]:
                    leg.check_domains(passage_on(steps, s))
        except Unproved:
            if left == 0:
                raise
            middle = (low + high) / 2
            waiting += [((low, middle), left - 1), ((middle, high), left - 1)]


def parts_between(low: float, high: float) -> list[tuple[float, float]]:
    """Parts of the places between two floats, in order."""
    ends = [low + (high - low) * k / BRANCHES.parts for k in range(BRANCHES.parts)] + [high]
    return [*itertools.pairwise(ends)]


def floats_about(begin: arb, end: arb) -> tuple[float, float]:
    """Floats from -1 to 1 between which all places from one enclosed place to another lie."""
    low, high = np.nextafter([float(begin.lower()), float(end.upper())], [-np.inf, np.inf]).tolist()
    return max(low, -1.0), min(high, 1.0)


def signs_along(piece: CurvePiece, low: float, high: float) -> list[tuple[float, float, int]]:
    """The signs of the parameter's derivative between two places, in order: runs (low, high, sign) of parts with the
    same sign, 0 where it is undecided even on short parts."""
    parts = [(*each, piece.turning(arb(each[0]).union(arb(each[1])))) for each in parts_between(low, high)]
    for _ in range(BRANCHES.halvings):
        if not 0 < sum(sign == 0 for _, _, sign in parts) <= BRANCHES.undecided:
            break
        finer = list[tuple[float, float, int]]()
        for first, last, sign in parts:
            middle = (first + last) / 2
            halves = [(first, middle), (middle, last)] if sign == 0 else [(first, last)]
            finer += [(*each, sign or piece.turning(arb(each[0]).union(arb(each[1])))) for each in halves]
        parts = finer
    runs = list[tuple[float, float, int]]()
    for first, last, sign in parts:
        if runs and runs[-1][2] == sign:
            runs[-1] = runs[-1][0], last, sign
        else:
            runs.append((first, last, sign))
    return runs


def inside(inner: CurvePiece, outer: CurvePiece) -> bool:
    """Whether all solutions of a piece lie in the tube of another one along the same coordinate, so that they are
    its solutions too."""
    unit = ball_of_fraction(inner.equations.units[inner.coordinate])
    ends = [outer.place(ball_of_fraction(end) / unit) for end in (inner.start, inner.stop)]
    if not all(map(_within, ends)):
        return False
    moved = arb_poly([(ends[0] + ends[1]) / 2, (ends[1] - ends[0]) / 2])
    for i in inner.tube.solved:
        mine, other = (_polynomial(each.tube.polynomials[i]) for each in (inner, outer))
        off = sum((each.abs_upper() for each in (mine - other(moved)).coeffs()), inner.tube.radii[i])
        if not off < outer.tube.widths[i]:
            return False
    return True


def _polynomial(model: TaylorModel) -> arb_poly:
    """The polynomial in s of a model that does not depend on time."""
    return arb_poly([sum(part.coeffs(), arb(0)) for part in model.parts])
