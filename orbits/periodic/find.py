"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..model import Machine, check_machine, refuse_hysteresis
from ..result import Progress
from ..running import exclusive, interrupts, time_limit
from ..shooting import ENERGY_OF_CYCLE, method_of
from .along_energy import find_oscillation
from .family_orbits import family_number, orbits_of_family, same_orbit
from .linear_hops import LinearSearch
from .orbit import Orbit, start_in_file
from .orbit_found import found_from
from .oscillations import Oscillation
from .start import StartLike, check_start
from .swing import Swing
from .swings import find_swings, grip_of


@overload
def find(  # type: ignore[overload-overlap]
    machine: Machine, family: int | None = None, *, at: Mapping[Literal["energy"], float],
    start: Oscillation | Mapping[str, float] | None = None, progress: Progress = None, limit: float | None = None,
) -> Oscillation: ...  # fmt: skip


@overload
def find(machine: Machine, *, start: Swing, limit: float | None = None) -> Swing: ...


@overload
def find(
    machine: Machine, family: int | None = None, *, start: StartLike | None = None, method: str | None = None,
    tune: str | Iterable[str] | None = None, at: Mapping[str, float] | None = None, progress: Progress = None,
    limit: float | None = None,
) -> Orbit: ...  # fmt: skip


@exclusive
def find(
    machine: Machine,
    family: int | None = None,
    *,
    start: StartLike | Oscillation | Swing | None = None,
    method: str | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[Any, float] | None = None,
    progress: Progress = None,
    limit: float | None = None,
) -> Orbit | Oscillation | Swing:
    """Find the lossless orbit of a family, with its certificate; of a machine with a `Grip` the fastest `Swing`.

    machine : a `problems.Hopper`, a `problems.Juggler`, a `Mechanism`, or another `Machine` with `model`, `values`,
        `describe` and `units`
    family : its number, from 1; None means 1. In family n the extension has n + 1 stationary points from lift-off to
        mid-flight
    start : the initial guess, instead of the model's own: a nearby orbit, the name of its file, or the unknowns of a
        half orbit by name. The result may belong to any family, unless `family` is stated too. A file is only a guess,
        and may have been edited
    method : "closed form", "relative", "half orbit", or "shooting", which is multiple shooting by Ipopt; None for the
        simplest that the machine allows
    tune : names of parameters that become unknowns, one for each quantity in `at`; the search begins with their values
        in the machine and continues from the machine's own orbit
    at : values of quantities of the orbit by name, in the machine's units, such as "period", "frequency", "alpha",
        "clearance" or the rise of a height. With "energy" and no `tune` it is an `Oscillation` of this energy that is
        found, see `follow`: of the normal mode of the number `family`, near the equilibrium at places in `start`, or in
        the family through the motion that `start` states, an `Oscillation` or its `start`
    progress : called with the completed share of the homotopy, where there is one
    limit : time limit in seconds; None means 30 s of processor time, or the limit of a `time_limit` around it

    If a family has several orbits, the one of least launch speed is returned. All orbits are searched as by `find_all`
    where the laws of the machine have many or narrow bends, and where no orbit is found otherwise. A linear machine
    that steps and whose launch has several numbers is searched by its modes of vibration, with the times that `starts`
    searches; the orbit is the admissible one of least launch speed, or if there is none the first. For other machines
    the result is the first orbit under constant gravity, or its continuation to varying gravity; then `known_in_family`
    is None, since others are not searched. The orbit may be inadmissible: see its `violations`. Raises `NoOrbit` when
    there is no orbit, when a solution belongs to another family, or when the limit is reached, and `InputError` for an
    invalid family, method or limit. Source: eqs. (9) to (12) of the paper, and its section 9 for the symmetry.

    >>> from orbits import find
    >>> from problems import Hopper
    >>> orbit = find(Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3}))
    >>> round(orbit.alpha, 9), orbit.admissible
    (2.936459188, True)
    """
    if tune is None and isinstance(at, Mapping) and ENERGY_OF_CYCLE in at:
        if others := [str(name) for name in at if name != ENERGY_OF_CYCLE]:
            raise InputError(f"at = {dict(at)!r}: the energy alone determines an oscillation; leave '{others[0]}' out")
        if method is not None or not (start is None or isinstance(start, Mapping | Oscillation)):
            raise InputError("an oscillation is found without a method=, from an oscillation or numbers by name")
        with time_limit(limit):
            return find_oscillation(machine, at[ENERGY_OF_CYCLE], start, family_number(1 if family is None else family))
    if grip_of(machine):
        _refuse_of_swings(family=family, method=method, tune=tune, at=at)
        if not (start is None or isinstance(start, Mapping | Swing)):
            raise InputError("a swing is found from another one, or from numbers by name")
        with time_limit(limit):
            return find_swings(machine, start)[0]
    check_machine(machine)
    number = None if family is None else family_number(family)
    if isinstance(start, str | Path):
        start = start_in_file(start)
    if tune is None and at is None and not machine.model.sticks:
        with interrupts.deferred(), time_limit(limit):
            return found_from(machine, number, start, method_of(machine.model, method), progress)
    from .tuned_orbits import tuning_of
    from .tuned_search import tuned_from

    tuning = tuning_of(machine, tune, at)
    with interrupts.deferred(), time_limit(limit):
        return tuned_from(machine, number, start, method_of(machine.model, method), tuning, progress)


def start_or_own(machine: Machine, start: Any, *families: int) -> Any:
    """The start; without one the machine's own orbit, where the orbits of other machines are continued from one, and
    None where each is found alone. Raises `InputError` and `NoOrbit` as `check_start`."""
    check_start(machine, start)
    if start is not None or not LinearSearch.finds_families(machine):
        return start
    if len(families) > 1:
        name = machine.model.name
        raise InputError(f"family = {families}: orbits of a {name} are continued from one: sweep one family at a time")
    return find(machine, *families)


def _refuse_of_swings(**options: object) -> None:
    """Raise `InputError` for options of a search that finds swings without them."""
    if stated := [name for name, value in options.items() if value is not None]:
        raise InputError(
            f"{stated[0]} = {options[stated[0]]!r}: swings from hold to hold need no tuned number and have no families "
            "by number; leave it out, or follow a parameter to the swing that you want"
        )


@exclusive
def find_all(
    machine: Machine,
    starts: int | Iterable[Orbit | Mapping[str, float]] | None = None,
    *,
    family: int | None = None,
    fastest: float | None = None,
    method: str | None = None,
    progress: Progress = None,
    limit: float | None = None,
) -> tuple[Orbit, ...]:
    """All orbits of a family, or the different orbits that `find` reaches from several starts, by launch speed.

    machine, method : as in `find`
    starts : initial guesses as in `find`; or the number of a family
    family : as in `find`, if there are no starts
    fastest : the largest launch speed of the search for a family, in the machine's units. With u the inverse root of
        the spring's slope at rest, None means 1e4 u times the number of the family, or 30 u times it where gravity
        varies or the spring has many bends. The slowest launch is 1e-3 u.
    progress : called with the completed share of the launches near an orbit, or of the starts
    limit : time limit in seconds of the search, or of each start, as in `find`

    The orbits of a family are the zeros of one function of the launch speed (see `family_search`). The samples of this
    function are so close that the turning points of the extension skip no feature of the spring's law. Between samples,
    its curvature is assumed to be at most four times what its second differences show; this is not a proof, but the
    samples are refined where it matters. The search stops after 20,000 launches, or after 1,000 for a machine that
    steps, whose orbits may lie in narrow ranges of launch speeds between falls. If the search may have missed orbits,
    their `known_in_family` is None. If it was stopped, or an orbit could not be certified, a warning is logged too.
    Starts that lead to no orbit are left out. Of a machine with a `Grip` all swings are returned whose unknowns are
    in the ranges that the grip states, admissible ones first and then by falling mean speed. Raises `NoOrbit` if there
    is none, with the searched range or the last reason, and `InputError` for invalid arguments and for a model without
    such a search.

    >>> from orbits import find_all
    >>> from problems import Hopper
    >>> hops = find_all(Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005}), 1)
    >>> [round(hop.alpha, 4) for hop in hops]
    [4.7432, 9.924]
    """
    if grip_of(machine):
        _refuse_of_swings(starts=starts, family=family, fastest=fastest, method=method)
        with time_limit(limit):
            return find_swings(machine)  # type: ignore[return-value]
    if starts is None or isinstance(starts, int | np.integer):
        if None not in (starts, family):
            raise InputError(f"find_all got two families, {starts} and {family}: leave one out")
        check_machine(machine)
        refuse_hysteresis(machine.model)
        if fastest is not None and not finite_number("fastest", fastest) > 0:
            raise InputError(f"fastest = {fastest:g} is not a launch speed; it must lie above 0")
        family, method = (
            family_number(next(each for each in (starts, family, 1) if each is not None)),
            method_of(machine.model, method),
        )
        with interrupts.deferred(), time_limit(limit):
            return orbits_of_family(machine, family, method, fastest, progress)
    if family is not None or fastest is not None:
        raise InputError("find_all takes starts, or a family with the fastest launch speed to search, not both")
    if isinstance(starts, Mapping | Orbit):
        raise InputError("starts must be a list of starts: for one start use find(machine, start=...); or give family=")
    found, reason, starts = list[Orbit](), None, list(starts)
    for i, start in enumerate(starts):
        if progress:
            progress(i / len(starts))
        try:
            orbit = find(machine, start=start, method=method, limit=limit)
            if not any(same_orbit(orbit, other) for other in found):
                found.append(orbit)
        except NoOrbit as error:
            reason = error
    if reason and not found:
        raise NoOrbit(f"none of the starts leads to an orbit; the last: {reason}")
    return tuple(sorted(found, key=lambda orbit: orbit.alpha))
