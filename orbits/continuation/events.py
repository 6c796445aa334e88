"""What happens on a curve of orbits between two neighbouring points: located, certified, in order."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError
from ..numerics.roots import bracketed_root
from ..periodic.orbit import Orbit
from .corrector import Curve, CurvePoint, interpolated
from .family import Point

# What an orbit has to spare before something happens; the event is where it changes sign. None: it says nothing.
MARGINS: dict[str, Callable[[Point], float | None]] = {
    "grazing": lambda point: _or(1.0, point.certificate.clearance),
    "masses touch": lambda point: point.certificate.smallest_separation,
    "contact pulls": lambda point: (
        None if point.contact_time is None else _or(1.0, point.certificate.smallest_contact_force)
    ),
    "landing jerk": lambda point: -point.certificate.landing_jerk,
    "collapse": lambda point: -1.0 if point.contact_time is None else 1.0,
}
# An event is located to this share of the way between two points, where rounding begins to show.
WIDTH = 1e-13
# A branch point, where the equations are singular, is interpolated from points this far and twice as far away.
BRANCH_OFFSET = 0.01
# What else changes sign where something happens.
SIGNS = ("fold", "branch point", "family")


class Segment:
    """The curve between two of its neighbouring points, both certified; a place on it is its share of the chord."""

    def __init__(self, curve: Curve, a: CurvePoint, b: CurvePoint):
        self.curve, self.a, self.b = curve, a, b

    @cached_property
    def row(self) -> np.ndarray:
        """Measures the share of the chord, (n + 1,)."""
        size = self.curve.size(self.a.x)
        chord = (self.b.x - self.a.x) / size
        return chord / (chord @ chord) / size

    @property
    def start(self) -> float:
        """The level of the row at the first point."""
        return float(self.row @ self.a.x)

    def __call__(self, share: float) -> CurvePoint:
        """The curve at a share of the chord, not certified between the ends."""
        if share in (0.0, 1.0):
            return (self.a, self.b)[int(share)]
        level = self.start + share
        (guess,) = interpolated((self.a, self.b), self.row, np.array([level]))
        return self.curve.correct(guess, self.row, level, self.a.tangent)

    def sheets(self) -> list["Segment"]:
        """The stretch up to its fold and the one from there on; itself where it has none."""
        if self.fold is None:
            return [self]
        fold = self(self.fold)
        return [Segment(self.curve, self.a, fold), Segment(self.curve, fold, self.b)]

    def reaches(self, value: float) -> bool:
        """Whether the parameter has a value somewhere from end to end."""
        return min(self.a.value, self.b.value) <= value <= max(self.a.value, self.b.value)

    @cached_property
    def fold(self) -> float | None:
        """The share at which the parameter turns round."""
        return self.zero(lambda at: float(at.tangent[-1]))

    def zero(self, quantity: Callable[[CurvePoint], float | None], width: float = WIDTH) -> float | None:
        """The share at which a quantity changes its sign, None where it does not or says nothing; 0 is positive."""
        first, last = quantity(self.a), quantity(self.b)
        if first is None or last is None or (first >= 0) == (last >= 0):
            return None
        share = bracketed_root(lambda share: quantity(self(share)) or 0.0, 0.0, 1.0, first, last, width=width)
        value = quantity(self(share))
        return None if value is None or abs(value) > abs(first) + abs(last) else share  # nothing, or a pole

    def landed(self, value: float) -> CurvePoint:
        """The point where the parameter has exactly a value, certified."""
        a, b = self.a, self.b
        if b.value == value:
            return b
        share = (value - a.value) / (b.value - a.value)
        try:
            near = self(float(np.clip(share, 1e-9, 1 - 1e-9)))
            guess = near.x + near.tangent * (value - near.value) / near.tangent[-1]
            near = self.curve.correct(guess, np.eye(len(a.x))[-1], value, a.tangent)
        except NoOrbit:  # beside a fold the value does not fix the orbit, its place on the curve does
            near = self(self.zero(lambda at: at.value - value))
        return self.curve.onto(near, value)

    def events(
        self, asked: tuple[float, ...], watch: Mapping[str, Callable[[Orbit], float]]
    ) -> list[tuple[str, CurvePoint]]:
        """What happens, by kind, in order along the curve; `asked` are values of the parameter to stop at."""
        found: list[tuple] = []
        if not watch and _signs(self.a) == _signs(self.b) and not self._passed(asked):
            return []
        for name in (*SIGNS, *MARGINS, *watch):
            if name == "branch point":
                share, at = self._crossing()
            else:
                quantity = lambda at, name=name: self._quantity(name, at, watch)  # noqa: E731
                share = self.fold if name == "fold" else self.zero(quantity)
                at = None if share is None else self(share)
            if share is not None:
                found.append((name, share, at if at.point else self.curve.check(at)))
        turns = [0.0, *([] if self.fold is None else [self.fold]), 1.0]
        for low, high in pairwise(turns):
            part = Segment(self.curve, self(low), self(high)) if len(turns) > 2 else self
            first, last = part.a.value, part.b.value
            for value in part._passed(asked):
                share = low + (high - low) * (value - first) / (last - first)
                found.append(("asked", share, part.landed(value)))
        return [(name, at) for name, _, at in sorted(found, key=lambda entry: entry[1])]

    def _crossing(self) -> tuple[float, CurvePoint] | tuple[None, None]:
        """The share of a branch point, and the point, its error to be measured without the direction that is singular;
        None without one."""
        share = self.zero(lambda at: at.branch_test, BRANCH_OFFSET)
        if share is None:
            return None, None
        beside = [self(share + step * BRANCH_OFFSET) for step in (-2, -1, 1, 2)]
        shares = np.array([self.row @ at.x - self.start for at in beside])
        share = float(np.linalg.solve(np.vander([at.branch_test for at in beside], increasing=True), shares)[0])
        (x,) = interpolated(beside, self.row, np.array([self.start + share]))
        here, size = self.curve.evaluate(x[None]), self.curve.size(x)
        u, s, v = np.linalg.svd(here.jacobian[0] * size)
        s[-1] = s[0]
        tangent = beside[1].tangent + beside[2].tangent
        here = replace(here, jacobian=((u * s) @ v[: len(s)] / size)[None])
        tangent /= np.linalg.norm(tangent / size)
        return share, CurvePoint(x, tangent, 0.0, here, 0)

    def _passed(self, asked: tuple[float, ...]) -> list[float]:
        low, high = sorted((self.a.value, self.b.value))
        return [value for value in asked if low < value < high]

    def _quantity(self, name: str, at: CurvePoint, watch) -> float | None:
        at = at if at.point else self.curve.check(at)
        if name == "family":
            return 1.0 if at.point.family == self.a.point.family else -1.0
        if name in MARGINS:
            return MARGINS[name](at.point)
        return watched(name, watch[name], self.curve.orbit(at))


def _or(otherwise: float, value: float | None) -> float:
    return otherwise if value is None else value


def _signs(at: CurvePoint) -> tuple:
    """On which side of every event a certified point is."""
    if at.signs is None:
        margins = (margin(at.point) for margin in MARGINS.values())
        sides = [margin is not None and margin >= 0 for margin in margins]
        at.signs = (at.tangent[-1] >= 0, at.branch_test >= 0, at.point.certificate.family, *sides)
    return at.signs


def watched(name: str, function: Callable[[Orbit], float | bool | None], orbit: Orbit) -> float | None:
    """A watched quantity of an orbit, None where the function gives None, divides by zero or the orbit has not what it
    asks for; a truth counts as 1 or -1. Raises `InputError` when it is not a number."""
    try:
        value = function(orbit)
    except (OrbitsError, ZeroDivisionError):
        return None
    if value is None:
        return None
    if isinstance(value, bool | np.bool_):
        return 1.0 if value else -1.0
    if isinstance(value, complex) or not np.isscalar(value) or isinstance(value, str) or not np.isfinite(value):
        raise InputError(f"watch '{name}' gives {value!r} at alpha = {orbit.alpha:.6g}: it must give a finite number")
    return float(value)
