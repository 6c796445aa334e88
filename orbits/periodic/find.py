"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..model.machine import Machine, check_machine
from ..model.model import Model
from ..symbolic import interrupts
from .evaluation import Evaluation
from .formulations import equations_of
from .homotopy import solve_by_homotopy
from .interpretation import certified_orbit
from .orbit import Orbit
from .solution import vector

METHODS = ("closed form", "relative", "half orbit", "shooting")
LARGEST_FAMILY = 10_000
# Orbits whose launch speeds, times and states agree to this share are the same.
SAME_ORBIT = 1e-9
# A start with a longer time than this describes no machine in its own units, and would take long to integrate.
LONGEST_START = 1e4
# A start may state these unknowns although not every statement asks for them.
OPTIONAL_UNKNOWNS = ("contact_duration", "unfolding")


class Root(NamedTuple):
    """A solution of a method's equations.

    u : the unknowns (n,)
    evaluation : the equations there, at this one point
    error : bound on the error of alpha where it is known, else None
    """

    u: np.ndarray
    evaluation: Evaluation
    error: float | None = None


def find(
    machine: Machine,
    family: int | None = None,
    *,
    start: Orbit | Mapping[str, float] | None = None,
    method: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Orbit:
    """Find the lossless orbit of a family, with its certificate.

    machine : a `problems.Hopper`, a `problems.Juggler`, or anything with their `model`, `values`, `describe`, `units`
    family : from 1, which is what None means; family n has n + 1 stationary points of the extension from lift-off to
        mid-flight
    start : an orbit nearby, or the unknowns of a half orbit by name, to start from instead of the model's guess; an
        orbit of any family is then returned, unless `family` is given too
    method : one of `METHODS`, None for the simplest that the machine allows; "shooting" is the general one, multiple
        shooting by Ipopt
    progress : called with the share of the homotopy that is done, where there is one

    Where a family has several orbits, this is the one of least launch speed under constant gravity, or what that
    becomes as gravity's variation is brought in. It may be inadmissible: see its `violations`. Raises `NoOrbit` with
    the reason when there is none or a solve ends on another family, and `InputError` for a family or a method that
    cannot be.
    """
    check_machine(machine)
    with interrupts.deferred():
        if start is None:
            return _find_family(machine, 1 if family is None else family, method, progress)
        return _find_near(machine, start, family, method)


def find_all(
    machine: Machine, starts: Iterable[Orbit | Mapping[str, float]], *, method: str | None = None
) -> tuple[Orbit, ...]:
    """The different orbits that `find` comes to from several starts, by their launch speeds ascending.

    Starts that lead to none are left out; raises `NoOrbit` with the last reason when they all are.
    """
    if isinstance(starts, Mapping | Orbit):
        raise InputError("starts is a list of starts: for one of them there is find(machine, start=...)")
    found: list[Orbit] = []
    reason = None
    for start in starts:
        try:
            orbit = find(machine, start=start, method=method)
        except NoOrbit as error:
            reason = error
            continue
        if not any(_same(orbit, other) for other in found):
            found.append(orbit)
    if not found and reason:
        raise NoOrbit(f"none of the starts leads to an orbit; the last: {reason}")
    return tuple(sorted(found, key=lambda orbit: orbit.alpha))


def solve_family(
    machine: Machine, family: int, method: str | None, progress: Callable[[float], None] | None = None
) -> tuple[str, Root]:
    """The method, and the solution that it finds for a family, as in `find`; not certified to be of that family."""
    model, p = machine.model, dict(machine.values)
    family, method = _family_number(family), _possible_method(model, method)
    equations = equations_of(model, method, tuple(p))
    if method == "closed form" and model.reduction and model.reduction.exact:
        unknowns, error = model.reduction.exact(family, p)
        u = vector(unknowns)
        return method, Root(u, equations.evaluate_all(u[None], vector(p)[None]), error)
    if method == "relative":
        start = model.guess(family, p)
        return method, Root(*equations.newton([start["liftoff"], start["alpha"]], vector(p)))
    correct = equations.multiple_shooting if method == "shooting" else equations.newton
    return method, Root(*solve_by_homotopy(model, equations, correct, family, p, progress))


def solve_near(machine: Machine, start: Orbit | Mapping[str, float], method: str | None) -> tuple[str, Root]:
    """The method, and the solution that it finds from a start, as in `find`."""
    model, p = machine.model, machine.values
    method = _possible_method(model, method)
    method = "relative" if method == "closed form" else method
    equations = equations_of(model, method, tuple(p))
    stated = _stated_unknowns(model, start)
    names = equations.statement.unknowns
    if missing := [name for name in names if name not in stated]:
        raise InputError(f"start has no '{missing[0]}'; the unknowns are {', '.join(names)}")
    u = np.array([stated[name] for name in names])
    correct = equations.multiple_shooting if method == "shooting" else equations.newton
    try:
        return method, Root(*correct(u, vector(p)))
    except FlowError as error:
        raise NoOrbit(f"the start cannot be followed: {error}") from None


def another_family(wanted: int, found: int) -> str:
    """The message about a solve for one family that ends on another."""
    return f"the solve for family {wanted} ended on an orbit of family {found}; try another method"


def _find_family(machine: Machine, family: int, method: str | None, progress: Callable | None) -> Orbit:
    began = time.perf_counter()
    method, root = solve_family(machine, family, method, progress)
    orbit = certified_orbit(machine, method, *root, began=began)
    if orbit.family != family:
        raise NoOrbit(another_family(family, orbit.family))
    return orbit


def _find_near(machine: Machine, start: Orbit | Mapping[str, float], family: int | None, method: str | None) -> Orbit:
    began = time.perf_counter()
    method, root = solve_near(machine, start, method)
    orbit = certified_orbit(machine, method, *root, began=began)
    if family is not None and orbit.family != _family_number(family):
        raise NoOrbit(f"the start leads to an orbit of family {orbit.family}, not {family}")
    return orbit


def _same(a: Orbit, b: Orbit) -> bool:
    x, y = ([orbit.alpha, orbit.flight_time, *orbit.flight(0.0)] for orbit in (a, b))
    return np.allclose(x, y, rtol=SAME_ORBIT, atol=SAME_ORBIT * max(map(abs, x)))


def _stated_unknowns(model: Model, start: Orbit | Mapping[str, float]) -> dict[str, float]:
    """The unknowns that a start states, by name; raises `InputError` for a start that is none."""
    if isinstance(start, Orbit):
        if start.flight.names[: len(model.flight.states)] != model.flight.states:
            raise InputError(f"start is an orbit of another machine, with the states {', '.join(start.flight.names)}")
        return _unknowns_of(start)
    if not isinstance(start, Mapping):
        raise InputError(f"start = {start!r}; it is an orbit, or a mapping of unknowns to numbers")
    if unknown := [name for name in start if name not in {*model.half_unknowns, *OPTIONAL_UNKNOWNS}]:
        raise InputError(f"start has '{unknown[0]}'; the unknowns are {', '.join(model.half_unknowns)}")
    stated = {"unfolding": 0.0, **{name: finite_number(f"start '{name}'", value) for name, value in start.items()}}
    for name in ("duration", "contact_duration"):
        if not 0 < stated.get(name, 1.0) < LONGEST_START:
            raise InputError(f"start '{name}' = {stated[name]:g}; it lies between 0 and {LONGEST_START:g}")
    return stated


def _unknowns_of(orbit: Orbit) -> dict[str, float]:
    """The unknowns, by name, of every statement that an orbit solves."""
    states = orbit.flight.coefficients[0, :, 0].tolist()
    unknowns = dict(zip(orbit.flight.names, states, strict=False))
    unknowns |= {
        "liftoff": orbit.liftoff_extension,
        "alpha": orbit.alpha,
        "duration": orbit.flight_time / (2 if orbit.shape.reversor else 1),
        "unfolding": orbit.certificate.unfolding or 0.0,
    }
    if orbit.contact_time is not None:
        unknowns["contact_duration"] = orbit.contact_time / 2
    return unknowns


def _family_number(family: int) -> int:
    if isinstance(family, bool) or not isinstance(family, int | np.integer) or not 1 <= family <= LARGEST_FAMILY:
        raise InputError(f"family = {family!r}; a family is a whole number from 1 to {LARGEST_FAMILY}")
    return int(family)


def _possible_method(model: Model, method: str | None) -> str:
    """The method asked for, or the simplest that the model allows; raises `InputError` for one that it does not."""
    possible = {
        "closed form": model.reduction is not None and model.reduction.exact is not None,
        "relative": model.reduction is not None,
        "half orbit": model.reversor is not None,
        "shooting": True,
    }
    if method is None:
        return next(name for name in METHODS if possible[name])
    if method not in METHODS:
        raise InputError(f"unknown method '{method}'; known: {', '.join(METHODS)}")
    if not possible[method]:
        needs = {
            "closed form": "a straight-line spring and constant gravity",
            "relative": "two masses and constant gravity",
            "half orbit": "a reversor",
        }
        raise InputError(f"method '{method}' needs {needs[method]}; leave it out for the simplest way")
    return method
