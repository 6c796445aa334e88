"""Proofs about return maps: hops that come back with their multiplier, and the loss of stability by period doubling.

The theorems are in `orbits.proof.hops.hop_theorems`. Here are the floats from which their proofs start.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from ..errors import InputError, NoOrbit, finite_number
from ..exact import exact_values
from ..hops import simulate
from ..model import Machine, check_machine, refuse_steps
from ..proof import Decimal, Exact, Proof, need_flint
from ..running import exclusive, time_limit
from .bifurcation import Bifurcation
from .return_map import ReturnMap
from .returning_hops import ReturningHops

if TYPE_CHECKING:
    from ..proof import HopGuess


@exclusive
def prove_fixed_point(
    machine: Machine, point: ReturningHops | float, inject: Decimal | tuple[Decimal, Decimal], *,
    digits: int | None = None, parameters: Exact = None, limit: float | None = None,
) -> Proof:  # fmt: skip
    """Prove that the return map with an injection has a fixed point, that no other is nearby, and whether it is stable;
    or the same for hops of a longer period, and that this period is their least one.

    machine : of two coordinates, with plastic landings; stated as in `prove`
    point : a fixed point of the `ReturnMap`, or hops of a period, whose numbers are compared with the theorem; or a
        launch speed near a fixed point
    inject : added to the launch speed at every lift-off: an exact decimal, or a pair of them for an interval
    digits, parameters, limit : as in `prove`

    The result encloses alpha, for hops of a longer period also "alpha_2" and so on, the times, and the multiplier. The
    module `orbits.proof.hops.hop_theorems` describes the theorem and its proof. If something is not proved, the result
    says what and why. Raises `InputError` without python-flint, for a machine with restitution or friction, for one
    whose launch has several numbers, and for a lossless hop, for which there is `prove`; and `NoOrbit` if a guess leads
    to no fixed point.

    >>> from orbits import ReturnMap, prove_fixed_point
    >>> from problems import Hopper
    >>> point = ReturnMap(Hopper(), inject=0.03).fixed_points(4.5, 5)[0]
    >>> proof = prove_fixed_point(Hopper(), point, "0.03")
    >>> proof.proved, proof.enclosures["multiplier"].high[:10], "4.518828859478097796831733" in proof.alpha
    (True, '-0.5976197', True)
    """
    _check_plastic(machine)
    from ..exact import exact_bounds
    from ..proof import ClaimedHops, checked_digits, proof_of_fixed_point

    digits, values = checked_digits(digits), exact_values(parameters)
    low, high = exact_bounds("inject", inject)
    if not low > 0:
        raise InputError(
            f"inject = {inject!r}; it must be above 0, since without it fixed points are lossless: prove(orbit)"
        )
    middle, said = float((low + high) / 2), None
    if isinstance(point, ReturningHops):
        if point.kind == "lossless":
            raise InputError("this fixed point is a lossless orbit: prove(orbit)")
        launches = tuple(point.alphas.tolist())
        said = ClaimedHops(launches, point.multiplier, point.impacts or None, point.error or 0.0)
    with time_limit(limit):
        if said is None or len(said.launches) == 1:
            guess = guessed_hop(machine, finite_number("point", said.launches[0] if said else point), middle)
        else:
            guess = guess_at(machine, said.launches, middle)
        return proof_of_fixed_point(machine, guess, inject, said, values, digits)


@exclusive
def prove_doubling(
    machine: Machine, flip: Bifurcation, *, digits: int | None = None, parameters: Exact = None,
    limit: float | None = None,
) -> Proof:  # fmt: skip
    """Prove that a fixed point of the return map loses its stability by period doubling as the injection grows, and
    enclose the injection there.

    machine : as in `prove_fixed_point`, with a smooth law
    flip : a "flip" event of a fixed point, from `bifurcations(machine, "inject", ...)`
    digits, parameters, limit : as in `prove`

    The result encloses inject, alpha, the rate at which the multiplier passes through -1, and the coefficient whose
    sign decides whether the hops of period two are stable. Raises the errors of `prove_fixed_point`.

    >>> from orbits import bifurcations, prove_doubling
    >>> from problems import Hopper
    >>> diagram = bifurcations(Hopper(), "inject", (0.0, 0.1), (4.4, 4.7), sections=2, attractor=0)
    >>> flip = next(event for event in diagram.events if event.kind == "flip")
    >>> prove_doubling(Hopper(), flip).proved
    True
    """
    _check_plastic(machine)
    if not (isinstance(flip, Bifurcation) and flip.kind == "flip" and len(flip.alphas) == 1):
        raise InputError('a doubling must be a "flip" event of fixed points along "inject", see `bifurcations`')
    from ..proof import checked_digits, proof_of_doubling

    digits, values = checked_digits(digits), exact_values(parameters)
    with time_limit(limit):
        guess = guessed_hop(machine, flip.alpha, flip.value)
        return proof_of_doubling(machine, guess, (flip.value, flip.alpha), values, digits)


def _check_plastic(machine: Machine) -> None:
    """Raise `InputError` for a machine whose map has other impacts, or no map of speeds."""
    need_flint()
    check_machine(machine, "restitution")
    refuse_steps(machine.model, "a theorem about a return map")
    if machine.restitution != 0:
        raise InputError(f"restitution = {machine.restitution:g}: a theorem needs plastic landings, restitution 0")
    if not machine.model.conservative:
        raise InputError(f"this {machine.model.name} loses energy by friction: nothing can be proved of its map")
    if not machine.model.one_speed:
        raise InputError(f"a launch of a {machine.model.name} has several numbers, so there is no map of speeds")


def guessed_hop(machine: Machine, alpha: float, inject: float) -> "HopGuess":
    """The hop of the fixed point near a launch speed, in floats; raises `NoOrbit` where none is found."""
    try:
        alpha = ReturnMap(machine, inject).periodic_hop(alpha).alpha
    except NoOrbit as error:
        raise NoOrbit(f"no fixed point near: {error}") from None
    return guess_at(machine, (alpha,), inject)


def guess_at(machine: Machine, launches: Sequence[float], inject: float) -> "HopGuess":
    """The hops from launch speeds, in floats; raises `NoOrbit` for a launch without a next one."""
    from ..proof import HopGuess

    durations = list[list[float]]()
    for alpha in launches:
        run = simulate(machine, alpha, hops=1, inject=inject)
        if run.status != "done":
            raise NoOrbit(f"the hop from alpha = {alpha:g} ends with '{run.status}': it does not come back")
        durations.append([after - before for before, after in pairwise([0.0, *(event.time for event in run.events)])])
    flights, contacts = tuple(tuple(own[:-1]) for own in durations), tuple(own[-1] for own in durations)
    return HopGuess(machine.model.launch_at(run(0.0))["liftoff"], tuple(launches), flights, contacts, inject)
