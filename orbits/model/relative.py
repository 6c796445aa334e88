"""Machines of two coordinates that are launched by one law: their lift-off, their relative motion, their search.

Under constant gravity the extension r moves alone, r'' = -rate (phi(r) + load), where phi is the law and phi + load = 1
at lift-off. A sum of the coordinates is thrown up with it, w'' = -1, and at lift-off r' = alpha and w' = alpha/rate:
only then is the gap's second derivative 0. So half the flight takes the time alpha/rate, and an orbit is a root of r'
there: a problem in two states. For the hopper and the juggler in their own units the rate is 1 (section 8 of the paper,
for a linear spring).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..laws import (
    NO_FEATURES,
    WRONG_SIGN,
    Algebraic,
    Key,
    Parameters,
    features,
    features_of_many,
    from_key,
    number,
    unit_of_length,
    units_of_length,
)
from .liftoff import Liftoff
from .modes import Modes, single_mode
from .phase import Arc, Phase, Pieces, Statement


class RelativeOptions(NamedTuple):
    """The bounds of machines with one extension, and of the searches for their orbits."""

    # Beyond these one of the two masses is lost in rounding, or the lengths of lift-off overflow or vanish.
    stiffnesses: tuple[float, float] = (1e-12, 1e12)
    # Bounds of the spacing of launch speeds where a search for orbits begins, in multiples of their scale. It follows
    # the finer of the lengths over which the spring and, passed `at_speed` times as fast, gravity vary.
    spacings: tuple[float, float] = (0.02, 0.1)
    at_speed: float = 0.2
    # The fastest launch speed of a search, per family and in multiples of the machine's own scale of speed: a hop is
    # then 5e7 lengths high and more, which is not a machine.
    fastest: float = 1e4
    fastest_in_detail: float = 30.0  # where gravity or many bends make fast flights long to integrate
    # A spring that bends the other way more often may have several orbits in a family; a hardening spring that softens
    # first does it three times. So may one that bends there and back within a length below `unbent` of the unit.
    bends: int = 3
    unbent: float = 0.4


RELATIVE = RelativeOptions()


class Search(NamedTuple):
    """How to search for all orbits of a family.

    scale : of launch speeds: for a hopper the inverse root of the spring's slope at rest
    spacing, fastest : of the launch speeds where the search begins, and the last of them for family 1, in multiples of
        the scale
    single : whether the laws bend so seldom that the orbit to which the guess leads is taken for the lowest
    pace : the scale of times over that of launch speeds
    by_speed : whether the extension at lift-off depends on the launch speed
    turning : (fastest, most) -> the launch speeds that resolve the turning points of the extension, at most this number
        for each of two sides, and the speed up to which they do; None where these do not depend on the speed alone
    """

    scale: float
    spacing: float
    fastest: float
    single: bool
    pace: float = 1.0
    by_speed: bool = False
    turning: Callable[[float, int], tuple[np.ndarray, float]] | None = None


@dataclass(frozen=True, eq=False)
class Reduction:
    """A smaller statement of the same orbit, in coordinates in which fewer states are integrated.

    statement : with the unknowns "liftoff" and "alpha", which are also its two states at lift-off, and one arc, the
        first half of the flight
    reversor : sign of each of its states under time reversal
    complete : (times (N,), coefficients (N, n, K + 1), u, p) -> Taylor coefficients of all flight states; `u` and `p`
        hold one value for each of the N steps
    gap_slope : (times (m,), dz (n, m), p) -> derivatives (m,) of the gap by alpha, from those of the reduced states, dz
    exact : (family, p) -> (u, error of alpha) where the solution is known in closed form, else None
    """

    statement: Statement
    reversor: tuple[int, ...]
    complete: Callable
    gap_slope: Callable
    exact: Callable | None = None


@dataclass(frozen=True, eq=False)
class Relative:
    """The data of a launch by one law.

    law : key of the law phi of the extension, which in contact is the coordinate that is launched
    gravity : key of the law of gravity where that varies
    liftoff : the constant load and the name of the force that lift-off waits for
    rate : p -> the rate, None where it is 1
    damping : p -> the amount that a launch speed of 1 adds to phi at lift-off
    by_speed : the name of the parameter of the law that is the launch speed; None where it does not depend on that
    rest : p -> the value of the launched coordinate where the extension is 0
    own : p -> the parameters of all of these functions, for a model with other parameters
    """

    law: Key
    gravity: Key | None
    liftoff: Liftoff
    rate: Callable | None = None
    damping: Callable = lambda p: 0.0
    by_speed: str | None = None
    rest: Callable = lambda p: 0.0
    own: Callable = lambda p: p

    @property
    def phase(self) -> Phase:
        """The relative motion."""
        return relative_phase(self.law, self.liftoff.load, self.rate)

    def time(self, p: Parameters) -> Algebraic:
        """Half the time of a flight per launch speed, under constant gravity."""
        return 1 / self.rate(p) if self.rate else 1.0

    def release(self, alpha: ArrayLike, p: Parameters) -> np.ndarray:
        """Extensions (m,) at lift-off with launch speeds (m,)."""
        if self.by_speed is None:
            return self.rest(p) + self.liftoff.extensions_at(from_key(self.law, p), self.damping(p), alpha)
        alpha = np.asarray(alpha, dtype=float)
        columns = {name: np.full(alpha.size, value) for name, value in p.items()} | {self.by_speed: alpha.ravel()}
        found = self.liftoff.extensions(self.law, columns)
        for i in np.flatnonzero(np.isnan(found)).tolist():
            found[i] = self.liftoff.extension(from_key(self.law, {**p, self.by_speed: float(alpha.ravel()[i])}))
        return self.rest(p) + found.reshape(alpha.shape)

    def scale(self, slope: Algebraic, p: Parameters) -> Algebraic:
        """The launch speed that a spring of this slope turns in a radian of its oscillation."""
        return np.sqrt(self.rate(p) / slope) if self.rate else 1 / np.sqrt(slope)

    def search(self, p: Parameters) -> Search:
        """How to search for all orbits of a family."""
        if self.by_speed is not None:
            p = {**p, self.by_speed: 0.0}
        gravity, unit = self.gravity, unit_of_length(self.law, p)
        in_spring, around = features(self.law, unit, p), features(gravity, unit, p) if gravity else NO_FEATURES
        finest = min(in_spring.length, RELATIVE.at_speed * around.length) / unit
        wavy = in_spring.bends > RELATIVE.bends or around.bends > 1
        bump = in_spring.bends > 1 and in_spring.length < RELATIVE.unbent * unit
        single = not (wavy or bump)
        # Where gravity varies or a law bends often, the fastest flights would take most of the search's time.
        fastest = RELATIVE.fastest if single and not gravity else RELATIVE.fastest_in_detail
        spacing = float(np.clip(finest, *RELATIVE.spacings))
        scale = number("the scale of launch speeds", float(self.scale(1 / unit, p)), low=0)
        turning = None if self.by_speed else lambda fastest, most: self.turning_speeds(p, fastest, most)
        return Search(scale, spacing, fastest, single, float(self.time(p)), self.by_speed is not None, turning)

    def turning_speeds(self, p: Parameters, fastest: float, most: int) -> tuple[np.ndarray, float]:
        """The launch speeds (k,) that resolve the turning points of the extension under constant gravity, and the speed
        up to which they do, as in `turning_speeds`."""
        from .turning_speeds import turning_speeds

        law = from_key(self.law, p)
        unit, pace = unit_of_length(self.law, p), float(np.sqrt(self.rate(p))) if self.rate else 1.0

        def force(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes = law.with_slope(x)
            return values + self.liftoff.load, slopes

        sought = fastest / pace
        speeds, last = turning_speeds(force, self.liftoff.extension(law), law.range(), unit, sought, most)
        return pace * speeds, fastest if last == sought else pace * last  # rounded, it might be slower

    def single(self, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Which of many machines (m,) have no feature for which `search` looks for several orbits."""
        units = units_of_length(self.law, p)
        lengths, bends = features_of_many(self.law, self.law, p)
        single = (bends <= RELATIVE.bends) & ((bends <= 1) | (lengths >= RELATIVE.unbent * units))
        if self.gravity:
            single &= features_of_many(self.gravity, self.law, p)[1] <= 1
        return single

    def reduction(self, complete: Callable, gap_slope: Callable) -> Reduction:
        """The smaller statement of an orbit under constant gravity; `complete` and `gap_slope` as in `Reduction`."""
        phase, force, load = self.phase, self.law.expression, self.liftoff.load

        def exact(family: int, p: Mapping[str, float]) -> tuple[dict[str, float], float]:
            """Eq. (12): b = tan b, b the angle by which the extension swings in half the flight."""
            k, zero = straight_line(self.law, p)
            b, scale = half_angle(family), float(self.scale(k, p))
            alpha = b * scale
            # The error is the residual of sin b = b cos b through its slope b sin b, and one rounding.
            error = abs((np.sin(b) - b * np.cos(b)) / (b * np.sin(b))) * scale + np.spacing(alpha)
            return {"liftoff": zero + (1 - load) / k, "alpha": alpha}, float(error)

        arc = Arc(
            phase,
            start=lambda u, before, p: [u["liftoff"], u["alpha"]],
            duration=lambda u, p: self.time(p) * u["alpha"],
            conditions=lambda u, x, p: [x[1]],
            guard=lambda u, x, p, q: [force(x[0], p, q) + load - 1],
        )
        statement = Statement("relative", ("liftoff", "alpha"), (arc,), ("alpha",))
        return Reduction(statement, (1, -1), complete, gap_slope, exact if phase.closed_form else None)


@lru_cache(maxsize=64)
def relative_phase(law: Key, load: float, rate: Callable | None) -> Phase:
    """The motion r'' = -rate (phi(r) + load) of a law's key, in closed form where the law is a straight line."""

    def oscillator(p: Mapping[str, float]) -> Modes:
        k, zero = straight_line(law, p)
        pace = float(rate(p)) if rate else 1.0
        return single_mode(pace * k, pace * (k * zero - load))

    def rates(x: Algebraic, p: Parameters, q: Algebraic) -> list[Algebraic]:
        force = law.expression(x[0], p, q) + load
        return [x[1], -rate(p) * force if rate else -force]

    pieces, closed = pieces_along(law, (1.0, 0.0)), oscillator if law.degree() == 1 else None
    return Phase("flight", ("r", "r'"), rates, pieces=pieces, closed_form=closed)


def pieces_along(key: Key, coordinate: tuple[float, ...], offset: Callable | None = None) -> Pieces | None:
    """The smooth pieces of a spring law's key, for a phase whose state gives the extension by these weights and an
    offset, a function of the parameters."""
    if (pieces := key.pieces) is None:
        return None
    origin = (lambda p: pieces.origins(p) - offset(p) * pieces.units(p)) if offset else pieces.origins
    noise, jumps, exact = pieces[4:]
    return Pieces(coordinate, *pieces[:2], "extension", pieces.units, origin, noise, jumps, exact)


def straight_line(key: Key, p: Mapping[str, float]) -> tuple[float, float]:
    """Stiffness k and zero r0 of a straight-line law k (r - r0) at parameter values `p`."""
    law = from_key(key, p)
    value, slope = law.with_slope(0.0)
    if not RELATIVE.stiffnesses[0] < slope < RELATIVE.stiffnesses[1]:
        if slope < 0:
            raise InputError(f"spring '{law.text}' has stiffness {slope:g}: {WRONG_SIGN}")
        bounds = f"stiffness lies between {RELATIVE.stiffnesses[0]:g} and {RELATIVE.stiffnesses[1]:g}"
        never = "it never reaches a lift-off that can be computed"
        raise InputError(f"spring '{law.text}' has stiffness {slope:g}: {never}; {bounds}")
    return float(slope), -float(value) / float(slope)


def half_angle(family: int) -> float:
    """The root of b = tan b for a family n; the iteration b = n pi + atan(b) contracts to it."""
    b = (family + 0.5) * np.pi
    for _ in range(60):
        b, before = family * np.pi + np.arctan(b), b
        if b == before:
            break
    return float(b)
