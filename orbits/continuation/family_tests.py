"""The tests of events along a family: of its certified orbits, of the multipliers of the map of launches, and of the
user's functions."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..curves import BRANCH, FOLD, Points, Test
from ..errors import InputError, OrbitsError, finite_number
from ..hops import CROSSINGS, is_crossing
from ..numerics import Array
from ..periodic import Orbit
from ..records import NONE
from ..units import LIFTOFF_SPEED
from .curve import Curve, TestFunction
from .step_control import Options

# The test functions that are 1 or -1, where a secant does not help, and the places of their evaluation.
SIGNS_ALONE, PLACES_TOGETHER = ("collapse", "law ends"), 31
Values = Callable[[Any, Points], Array]


def tests_of_family(curve: Curve, options: Options) -> list[Test]:
    """The tests of the events along a curve of orbits."""
    tests = [FOLD, BRANCH, Test("family", _families, places=PLACES_TOGETHER)]
    tests += [
        Test(kind, _of_orbits(function), places=PLACES_TOGETHER if kind in SIGNS_ALONE else 1)
        for kind, function in curve.tests.items()
    ]
    tests += [Test(name, _of_user(name, function)) for name, function in options.watch.items()]
    return tests + ([Test("multipliers", _crossings, confirmed=_crossing)] if options.multipliers else [])


def _families(problem: Any, points: Points) -> Array:
    """The numbers (m,) of the families."""
    return np.asarray(points.own.column("family"), float)


def _of_orbits(function: TestFunction) -> Values:
    """A test function of certified orbits, NaN where it is not defined."""

    def values(problem: Any, points: Points) -> Array:
        found = np.asarray(function(problem.curve, points), float)
        return np.where(found == NONE, np.nan, found)

    return values


def _of_user(name: str, function: Callable[[Orbit], float | bool | None]) -> Values:
    """A user's function of the orbits."""

    def values(problem: Any, points: Points) -> Array:
        orbits = (problem.curve.orbit(points[i : i + 1]) for i in range(len(points)))
        found = [watched(name, function, orbit) for orbit in orbits]
        return np.array([np.nan if value is None else value for value in found])

    return values


def _crossings(problem: Any, points: Points) -> Array:
    """The test functions (m, k) of the multipliers, which vanish where some are on the unit circle."""
    others = problem.curve.others(points)
    return np.stack([test(others) for test in CROSSINGS.values()], axis=1)


def _crossing(problem: Any, point: Points, which: int) -> str | None:
    """The kind of the crossing at a point (1); None where none crosses there."""
    kind = [*CROSSINGS][which]
    return kind if is_crossing(kind, problem.curve.others(point)[0]) else None


def watched(name: str, function: Callable[[Orbit], float | bool | None], orbit: Orbit) -> float | None:
    """A watched quantity of an orbit; None where the function returns None, divides by zero or requests a quantity that
    the orbit does not have. A truth value counts as 1 or -1. Raises `InputError` when it is not a number."""
    try:
        value = function(orbit)
    except (OrbitsError, ZeroDivisionError):
        return None
    if isinstance(value, bool | np.bool_):
        return 1.0 if value else -1.0
    try:
        return None if value is None else finite_number(name, value)
    except InputError:
        place = f"at alpha = {orbit.alpha:.6g}{f' {orbit.scales.text(LIFTOFF_SPEED)}' if orbit.scales else ''}"
        raise InputError(f"watch '{name}' returns {value!r} {place}; it must return a finite number") from None
