"""Proofs: of an orbit, of a fold of a family, and of the absence of orbits or of a lift-off.

All of them need python-flint, of the extra `proof`, which is imported when it is used.
"""

import decimal
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Protocol, TypeAlias

from ..errors import InputError, whole_number
from ..exact import Claim, claim_of, exact_values
from ..model import Machine, check_machine, check_parameters, refuse_hysteresis
from ..periodic import Orbit
from ..running import exclusive, time_limit
from .branch_claim import BranchClaim
from .theorem import Proof

# An exact decimal, as text or a `Decimal`, or as the shortest decimal of a float; two of them are an interval.
Decimal: TypeAlias = str | float | decimal.Decimal
Exact: TypeAlias = Mapping[str, Decimal | tuple[Decimal, Decimal]] | None


@exclusive
def prove(
    orbit: Orbit,
    digits: int | None = None,
    *,
    machine: Machine | None = None,
    parameters: Exact = None,
    motion: bool = True,
    loss: bool = False,
    attraction: bool = False,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, Decimal] | None = None,
    limit: float | None = None,
) -> Proof:
    """Prove by interval arithmetic that an orbit exists, that no other is nearby, that the error of its alpha is at
    most twice its bound, that the number of its family is correct, and that it is a motion.

    orbit : as `find` returns it
    digits : number of decimal digits of the unknowns to enclose; None for about 18. Where enclosures are too wide to
        decide a condition, the digits are doubled once or twice, to at least 30; the result's `digits` states the
        number
    machine : the machine of the orbit; None for the one for which it was found
    parameters : exact decimals, such as {"beta": "0.3"}, or intervals, such as {"beta": ("0.299", "0.301")}, instead of
        the machine's floats; by default a float stands for the shortest decimal that rounds to it. A theorem with
        intervals is true for each value in them.
    motion : whether to prove the conditions of a motion too
    loss : whether to enclose the loss coefficient too
    attraction : whether to prove too that each launch above alpha, up to some distance, converges to the orbit, hop
        after hop. The proof determines this distance, and encloses the loss coefficient and the losses of these
        launches
    tune : names of parameters that are unknowns of the theorem, which encloses them; None for the parameters that
        `find` tuned, if all prescribed quantities have equations. For a machine that sticks to the ground the step is
        an unknown too
    at : exact decimals of quantities by name, such as {"speed": "0.4"}; None for the values to which the orbit was
        tuned
    limit : time limit in seconds, as in `find`; a statement not proved by then is reported as not proved

    The package `orbits.proof` describes the theorems, their lemmas and the trusted software. If something is not
    proved, the result says what and why; no error is raised. The theorem about a machine in SI is in SI. Raises
    `InputError` without python-flint, for invalid parameters and digits, and for an orbit whose machine is not known.
    Source: R. Krawczyk, Computing 4 (1969), and the references of `orbits.proof`.

    >>> from orbits import find, prove
    >>> from problems import Hopper
    >>> proof = prove(find(Hopper("r + 0.3*r**3", rest_length=8.0)))
    >>> proof.proved, proof.family, "2.9364591884941964779777" in proof.alpha
    (True, 1, True)
    """
    need_flint()
    claim = claim_of(orbit, machine, list(exact_values(parameters)), tune, at)
    check_machine(claim.machine)
    refuse_hysteresis(claim.machine.model)
    from .digits import checked_digits
    from .intervals import proof_of

    return proof_of(claim, checked_digits(digits), exact_values(parameters), motion, loss, limit, attraction)


def prove_claims(
    claims: Sequence[Claim], digits: int | None = None, motion: bool = True, workers: int = 1,
    limit: float | None = None,
) -> tuple[Proof, ...]:  # fmt: skip
    """The proofs of claims about several orbits, on `workers` processes, in their order; see `prove`."""
    need_flint()
    workers = whole_number("workers", workers, most=1000)
    if workers == 1 or len(claims) < 2:
        return tuple(_prove_claim(claim, digits, motion, limit) for claim in claims)
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    context = get_context("spawn")  # a fork of a process with threads may hang
    with ProcessPoolExecutor(min(workers, len(claims)), context) as pool:
        return tuple(pool.map(partial(_prove_claim, digits=digits, motion=motion, limit=limit), claims))


@exclusive
def prove_branch(claim: BranchClaim, digits: int | None, motion: bool, limit: float | None) -> Proof:
    """The proof that a family is one continuous curve of orbits; see `Family.prove`."""
    need_flint()
    from .branch import proof_of_branch
    from .digits import checked_digits

    return proof_of_branch(claim, checked_digits(digits), motion, limit)


@exclusive
def _prove_claim(claim: Claim, digits: int | None, motion: bool, limit: float | None) -> Proof:
    from .digits import checked_digits
    from .intervals import proof_of

    return proof_of(claim, checked_digits(digits), {}, motion, False, limit)


class Turning(Protocol):
    """A point of a family where it folds, such as that of a "fold" event."""

    @property
    def value(self) -> float:
        """The value of the parameter."""

    @property
    def u(self) -> tuple[float, ...]:
        """The unknowns of the equations."""

    @property
    def tangent(self) -> tuple[float, ...]:
        """The direction of the curve in the unknowns and the parameter."""


@exclusive
def prove_fold(
    machine: Machine, fold: Turning, along: str, *, digits: int | None = None, parameters: Exact = None,
    limit: float | None = None,
) -> Proof:  # fmt: skip
    """Prove that a family folds near a point, with an enclosure of the parameter there, and that the fold is
    nondegenerate.

    machine : the machine with which the family was followed, by the simplest method
    fold : the point of a "fold" event of that family
    along : the name of the parameter that folds
    digits, parameters, limit : as in `prove`

    Raises the errors of `prove`, and `InputError` for a machine without this parameter.

    >>> from orbits import follow, prove_fold
    >>> from problems import Hopper
    >>> machine = Hopper("cubic", rest_length=30.0)
    >>> family = follow(machine, "beta", -0.02, start=0.0)
    >>> fold = next(event.point for event in family.events if event.kind == "fold")
    >>> prove_fold(machine, fold, "beta").proved
    True
    """
    need_flint()
    check_parameters(machine, along)
    refuse_hysteresis(machine.model)
    if not all(hasattr(fold, name) for name in ("u", "tangent", "value")):
        raise InputError('the fold must be the `point` of a "fold" event of a family')
    if along in exact_values(parameters):
        raise InputError(f"'{along}' is the parameter that folds: it cannot have a value")
    if machine.units is not None:
        raise InputError(
            "a fold can be proved only for a dimensionless machine: follow and prove machine.dimensionless()"
        )
    from .digits import checked_digits
    from .proved_fold import proof_of_fold

    names = machine.model.reduction.statement.unknowns if machine.model.reduction else machine.model.half_unknowns
    if len(fold.u) != len(names) or not fold.tangent[names.index("alpha")]:
        raise InputError("this point is not a fold of the machine's simplest equations")
    alpha = fold.tangent[names.index("alpha")]
    directions = {name: each / alpha for name, each in zip(names, fold.tangent[:-1], strict=True)}
    unknowns = dict(zip(names, fold.u, strict=True))
    values = exact_values(parameters)
    with time_limit(limit):
        return proof_of_fold(machine, unknowns, directions, along, fold.value, values, checked_digits(digits))


@exclusive
def prove_absence(machine: Machine, family: int | None = None, *, parameters: Exact = None) -> Proof:
    """Prove that a machine has no lossless orbit of a family, or, for None, no lossless orbit at all.

    machine : its extension must move independently of the other coordinates, as in a hopper under constant gravity
    family : number of the family, from 1, or None
    parameters : as in `prove`

    For one family, this can be proved for springs whose force is odd, increases everywhere and is bounded, such as
    tanh; for all families, for springs that are too weak. The theorems are in `orbits.proof.absence`. Raises the errors
    of `prove`.

    >>> from orbits import prove_absence
    >>> from problems import Hopper
    >>> prove_absence(Hopper("tanh", parameters={"b": 0.4}), 1).proved
    True
    """
    need_flint()
    check_machine(machine)
    refuse_hysteresis(machine.model)
    if family is not None and (isinstance(family, bool) or not (isinstance(family, int) and family >= 1)):
        raise InputError(f"family = {family!r}; it must be a number from 1")
    from .absence import proof_of_absence

    return proof_of_absence(machine, family, exact_values(parameters))


def need_flint() -> None:
    """Raise `InputError` where python-flint is missing."""
    if find_spec("flint") is None:
        raise InputError("proofs need python-flint: pip install 'persistent-orbits[proof]'")
