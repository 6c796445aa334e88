"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..model.machine import check_machine
from ..model.model import Model
from ..numerics.linear import solve
from ..symbolic import interrupts
from .admissibility import count_families
from .evaluation import Evaluation
from .formulations import equations_of
from .interpretation import certified_orbit, halved
from .orbit import Orbit
from .single_shooting import Shooting
from .solution import vector

# Below this the homotopy is stuck at a fold or an end of the family.
MIN_STEP = 1e-4
# A corrector that moves launch speed or time by a larger share may have jumped to another orbit.
MAX_CORRECTION = 0.1
# Orbits that agree to this share are the same.
SAME_ORBIT = 1e-9
# Times of a start beyond this take long to integrate, and are no machine.
LONGEST_START = 1e4
# What a start may say although not every statement asks for it.
EXTRAS = ("contact_duration", "unfolding")
METHODS = ("closed form", "relative", "half orbit", "shooting")
LARGEST_FAMILY = 10_000


class Root(NamedTuple):
    """A solution of a method's equations.

    u : the unknowns (n,)
    here : the equations there, stacked
    error : of alpha, where it is known
    """

    u: np.ndarray
    here: Evaluation
    error: float | None = None


def find(
    machine,
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
    start : an orbit nearby, or the unknowns of a half orbit by name, to start from instead of the model's guess; the
        family is then whatever it is, if it is not given
    method : one of `METHODS`, None for the simplest that the machine allows; "shooting" is the general way, multiple
        shooting by Ipopt
    progress : called with the share of the way done, for what takes long

    Where a family has several orbits, this is the one of least launch speed under constant gravity, or what that
    becomes as gravity's variation is brought in. It may be inadmissible: see its `violations`. Raises `NoOrbit` with
    the reason when there is none or a solve ends on another family, and `InputError` for a family or a method that
    cannot be.
    """
    check_machine(machine)
    with interrupts.deferred():
        if start is None:
            return _find(machine, 1 if family is None else family, method, progress)
        return _find_near(machine, start, family, method)


def find_all(machine, starts: Iterable[Orbit | Mapping[str, float]], *, method: str | None = None) -> tuple[Orbit, ...]:
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


def _same(a: Orbit, b: Orbit) -> bool:
    x, y = ([orbit.alpha, orbit.flight_time, *orbit.flight(0.0)] for orbit in (a, b))
    return np.allclose(x, y, rtol=SAME_ORBIT, atol=SAME_ORBIT * max(map(abs, x)))


def _find_near(machine, start, family, method) -> Orbit:
    began = time.perf_counter()
    method, root = solve_near(machine, start, method)
    orbit = certified_orbit(machine, method, *root, began=began)
    if family is not None and orbit.family != _whole(family):
        raise NoOrbit(f"the start leads to an orbit of family {orbit.family}, not {family}")
    return orbit


def solve_near(machine, start, method: str | None) -> tuple[str, Root]:
    """The method, and what it comes to from a start, as in `find`."""
    model, p = machine.model, machine.values
    method = _allowed(model, method)
    method = "relative" if method == "closed form" else method
    equations = equations_of(model, method, tuple(p))
    known = _known(model, start)
    names = equations.statement.unknowns
    if missing := [name for name in names if name not in known]:
        raise InputError(f"start has no '{missing[0]}'; the unknowns are {', '.join(names)}")
    u = np.array([known[name] for name in names])
    solve_from = equations.multiple_shooting if method == "shooting" else equations.newton
    try:
        return method, Root(*solve_from(u, vector(p)))
    except FlowError as error:
        raise NoOrbit(f"the start cannot be followed: {error}") from None


def _known(model: Model, start) -> dict[str, float]:
    """The unknowns of a start by name; raises `InputError` for what is none."""
    if isinstance(start, Orbit):
        if start.flight.names[: len(model.flight.states)] != model.flight.states:
            raise InputError(f"start is an orbit of another machine, with the states {', '.join(start.flight.names)}")
        return unknowns_of(start)
    if not isinstance(start, Mapping):
        raise InputError(f"start = {start!r}; it is an orbit, or a mapping of unknowns to numbers")
    if unknown := [name for name in start if name not in {*model.half_unknowns, *EXTRAS}]:
        raise InputError(f"start has '{unknown[0]}'; the unknowns are {', '.join(model.half_unknowns)}")
    known = {"unfolding": 0.0, **{name: finite_number(f"start '{name}'", value) for name, value in start.items()}}
    for name in ("duration", "contact_duration"):
        if not 0 < known.get(name, 1.0) < LONGEST_START:
            raise InputError(f"start '{name}' = {known[name]:g}; it lies between 0 and {LONGEST_START:g}")
    return known


def unknowns_of(orbit: Orbit) -> dict[str, float]:
    """The unknowns of every statement whose solution an orbit is, by name."""
    states = orbit.flight.coefficients[0, :, 0].tolist()
    known = {**dict(zip(orbit.flight.names, states, strict=False)), "liftoff": orbit.liftoff_extension}
    known |= {"alpha": orbit.alpha, "duration": orbit.flight_time / (2 if orbit.shape.reversor else 1)}
    if orbit.contact_time is not None:
        known["contact_duration"] = orbit.contact_time / 2
    return known | {"unfolding": orbit.certificate.unfolding or 0.0}


def _find(machine, family, method, progress) -> Orbit:
    began = time.perf_counter()
    method, root = solve_family(machine, family, method, progress)
    orbit = certified_orbit(machine, method, *root, began=began)
    if orbit.family != family:
        raise NoOrbit(another_family(family, orbit.family))
    return orbit


def solve_family(machine, family: int, method: str | None, progress: Callable | None = None) -> tuple[str, Root]:
    """The method, and what it finds for a family, as in `find`; not certified to be that."""
    model, p = machine.model, dict(machine.values)
    family, method = _whole(family), _allowed(model, method)
    way = {"closed form": _exact, "relative": _relative, "half orbit": _half_orbit, "shooting": _shooting}[method]
    return method, way(model, equations_of(model, method, tuple(p)), family, p, progress)


def another_family(wanted: int, found: int) -> str:
    """What to say of a solve for one family that came to another."""
    return f"the solve for family {wanted} ended on an orbit of family {found}; try another method"


# The four ways, simplest first: (model, equations, family, parameters, progress) -> root.


def _exact(model: Model, equations: Shooting, family: int, p: Mapping, progress) -> Root:
    named, error = model.reduction.exact(family, p)
    u = np.array(list(named.values()))
    return Root(u, equations.evaluate_all(u[None], vector(p)[None]), error)


def _relative(model: Model, equations: Shooting, family: int, p: Mapping, progress) -> Root:
    start = model.guess(family, p)
    return Root(*equations.newton([start["liftoff"], start["alpha"]], vector(p)))


def _half_orbit(model: Model, equations: Shooting, family: int, p: Mapping, progress) -> Root:
    return Root(*_along(model, equations, equations.newton, family, p, progress))


def _shooting(model: Model, equations: Shooting, family: int, p: Mapping, progress) -> Root:
    return Root(*_along(model, equations, equations.multiple_shooting, family, p, progress))


def _along(model: Model, equations: Shooting, correct: Callable, family: int, p: Mapping, progress):
    """Solve the model's equations from its guess, led there along the homotopy parameter with step control.

    A step is taken when the corrector ends near where the tangent pointed and the family is still the same.
    """
    start = model.guess(family, {**p, model.homotopy: 0.0} if model.homotopy else p)
    whole = "unfolding" in equations.statement.unknowns
    start = {**start, "duration": start["duration"] * (2 if whole else 1), "unfolding": 0.0}
    u = np.array([start[name] for name in equations.statement.unknowns])
    if model.homotopy is None:
        return correct(u, vector(p))
    share, step = 0.0, 1.0
    u, here = correct(u, vector({**p, model.homotopy: 0.0}))
    while share < 1:
        # differenced: a predictor needs no more digits, and its own derivative would take longer to build
        there = equations.evaluate(u, vector({**p, model.homotopy: share + 1e-6}))
        tangent = solve(here.jacobian[0], (here.residual[0] - there.residual) / 1e-6)
        step = min(step, 1 - share)
        while True:
            ahead = {**p, model.homotopy: 1.0 if step == 1 - share else share + step}
            try:
                u, here = _corrected(model, equations, correct, u + step * tangent, family, ahead)
                break
            except NoOrbit as error:
                step /= 2
                if step < MIN_STEP:
                    raise NoOrbit(
                        f"no lossless orbit of family {family}: with {100 * share:.3g}% of gravity's variation it is "
                        f"at alpha = {u[1]:.6g}, and it cannot be followed further ({error})"
                    ) from None
        share = ahead[model.homotopy]
        step *= 2
        if progress:
            progress(share)
    return u, here


def _corrected(model, equations, correct, predicted, family, p):
    if not (predicted[1:3] > 0).all():  # nor if they are not numbers
        raise NoOrbit("the step leads to a negative time or speed")
    new, here = correct(predicted, vector(p))
    if np.max(np.abs(new - predicted)[1:3] / np.abs(new[1:3])) > MAX_CORRECTION:
        raise NoOrbit("the corrector ends far from the predicted orbit")
    flight = here.trajectories[0].only(model.flight.states)
    parts = halved(flight) if "unfolding" in equations.statement.unknowns else flight
    if count_families(model, parts, len(parts)) != [family]:
        raise NoOrbit("the family changes")
    return new, here


def _whole(family) -> int:
    if isinstance(family, bool) or not isinstance(family, int | np.integer) or not 1 <= family <= LARGEST_FAMILY:
        raise InputError(f"family = {family!r}; a family is a whole number from 1 to {LARGEST_FAMILY}")
    return int(family)


def _allowed(model: Model, method: str | None) -> str:
    """The method asked for, if the model allows it, or the simplest that it does."""
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
