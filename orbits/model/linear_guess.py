"""Guesses of orbits of machines of two coordinates that step, with forces along the tangents to their own.

With such forces the half flight of a time S from a launch with the speed alpha ends in a state whose places that the
reversor turns over are c0(S) + alpha c1(S) away from their centres, or the speeds are that: two equations, so that the
determinant of c0 and c1 vanishes. The mode of the highest frequency q swings once between two families: in family n of
a machine whose extension keeps its sign under the reversor, n pi < q S < (n + 1/2) pi, and half an oscillation less
where the extension changes it.
"""

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from math import inf
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from .model import Model
from .modes import MODES, Modes
from .relative import RELATIVE, Search


class LinearGuessOptions(NamedTuple):
    """How the time of a flight with straight springs is enclosed, and how fast launches are searched."""

    finer_grids: int = 4  # refinements of a grid; the time is interpolated in the last
    points: int = 65  # of a grid
    # Without gravity the determinant vanishes at an end of the range of times, which is a little longer.
    beyond_range: float = 1e-3
    # The fastest launch of a search, per family and in multiples of that of the first family with straight lines:
    # springs whose force is bounded oscillate often in faster flights, which take long and do not come back.
    fastest_step: float = 5.0


LINEAR_GUESS = LinearGuessOptions()


def linear_guess(model: Model, family: int, p: Mapping[str, float]) -> dict[str, float]:
    """The launch and the "duration" of the half flight with straight lines in place of the forces, with the lift-off
    of the forces themselves; raises `NoOrbit` where no orbit of the family is found with these."""
    found = _guess(model, family, tuple(p.items()))
    if isinstance(found, str):
        raise NoOrbit(found)
    return dict(zip(("liftoff", "alpha", "duration"), found, strict=True))


@lru_cache(maxsize=4096)  # a sweep's searches use the guesses of its members again
def _guess(model: Model, family: int, numbers: tuple[tuple[str, float], ...]) -> tuple[float, float, float] | str:
    """The values of a guess, or the reason for which there is none, with parameters and their values."""
    p = dict(numbers)
    try:
        modes, back, liftoff = _tangent_modes(model, p), model.reversal, float(model.release(np.ones(1), p)[0])
        lifting = _tangent_liftoff(model, modes, p)
    except NoOrbit as error:
        return error.args[0]  # whose quantities have units
    starts = [np.array(model.launch({"liftoff": lifting, "alpha": alpha}, p), float) for alpha in (0.0, 1.0)]
    turned = np.array(back.signs) < 0
    centres = 0.5 * np.array(back.shifts(p), dtype=float)[turned, None]

    def apart(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rest, moved = (modes.state(start, times)[turned] - centres for start in starts)
        return rest, moved - rest

    begin = family if model.turns_midway else family - 0.5
    halves = np.array([begin - LINEAR_GUESS.beyond_range, begin + 0.5 + LINEAR_GUESS.beyond_range])
    low, high = halves * np.pi / np.sqrt(modes.squares[-1])
    for _ in range(LINEAR_GUESS.finer_grids):
        times = np.linspace(low, high, LINEAR_GUESS.points)
        (a, b), (c, d) = apart(times)
        late = a * d - b * c
        changes = np.flatnonzero(np.diff(late > 0))
        if not len(changes):
            return f"with its forces replaced by straight lines, it has no orbit of family {family}"
        (low, high), ends = times[changes[0] : changes[0] + 2], late[changes[0] : changes[0] + 2]
    half = low - (high - low) * ends[0] / (ends[1] - ends[0])
    rest, change = (each[:, 0] for each in apart(np.array([half])))
    alpha = -float(rest @ change / (change @ change))
    if not 0 < alpha < inf:
        return f"with its forces replaced by straight lines, family {family} has the launch speed {alpha:.3g}"
    return liftoff, alpha, float(half)


def search_of_steps(model: Model, search: Search, p: Mapping[str, float]) -> Search:
    """A search with a range for machines that step, which nothing throws up. With straight springs too, a family has
    several orbits where gravity bends."""
    search = search._replace(single=search.single and model.flight.closed_form is not None)
    with suppress(NoOrbit):
        return search._replace(fastest=LINEAR_GUESS.fastest_step * linear_guess(model, 1, p)["alpha"] / search.scale)
    return search._replace(fastest=RELATIVE.fastest_in_detail)


def _tangent_liftoff(model: Model, modes: Modes, p: Mapping[str, float]) -> float:
    """The extension at which the gap opens without an acceleration in the motion by the modes. At that of the machine
    itself it would have one there, which modes that are pushed away let grow."""
    weights = np.array(model.gap(p).weights, dtype=float)[::2]
    places = (np.array(model.launch({"liftoff": at, "alpha": 0.0}, p), dtype=float)[::2] for at in (0.0, 1.0))
    none, one = (float(weights @ modes.shapes @ (modes.loads - modes.squares * (modes.apart @ y))) for y in places)
    if none == one:
        raise NoOrbit(f"with its forces replaced by straight lines, a {model.name} never lifts off")
    return none / (none - one)


def _tangent_modes(model: Model, p: Mapping[str, float]) -> Modes:
    """The modes of the flight with the forces tangent to its own at the centre of the reversor, or where the machine is
    unloaded along what the reversor leaves as it is."""
    if model.flight.closed_form:
        return model.flight.closed_form(p)
    centre = 0.5 * np.array(model.reversal.shifts(p), dtype=float)
    at = _tangent_field(model, tuple(p))
    field, slopes = (np.array(each, dtype=float) for each in at(centre, list(p.values())))
    if not (np.isfinite(field).all() and np.isfinite(slopes).all()):
        where = "at the place from which its motions are guessed"
        raise NoOrbit(f"the forces of a {model.name}, or their slopes, are not finite {where}")
    springs = -slopes[1::2, ::2]
    squares, shapes = (np.real(each) for each in np.linalg.eig(springs))
    squares = np.where(np.abs(squares) > MODES.slowest_square * np.abs(squares).max(), squares, 0.0)
    order = np.lexsort([squares, squares != 0.0])
    squares, shapes = squares[order], shapes[:, order]
    apart = np.linalg.inv(shapes)
    if not squares[-1] > 0:
        raise NoOrbit(f"no mode of a {model.name} oscillates in flight")
    return Modes(squares, shapes, apart, apart @ (field[1::2, 0] + springs @ centre[::2]))


@lru_cache(maxsize=64)
def _tangent_field(model: Model, names: tuple[str, ...]) -> ca.Function:
    """(state, parameters) -> the field of the flight and its derivative by the state."""
    x, p = ca.SX.sym("x", len(model.flight.states)), ca.SX.sym("p", len(names))
    states, known = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True))
    rates = ca.vertcat(*model.flight.field(states, known, model.flight.data(states, known)))
    return ca.Function("tangent", [x, p], [rates, ca.jacobian(rates, x)])
