"""Gravity laws: the ratio gamma(z) of gravity at height z to that at the ground, gamma(0) = 1.

Heights and the laws' lengths R and H are in the machine's unit of length (in m for a machine stated in SI), kappa in
its inverse.
"""

from collections.abc import Callable, Mapping
from numbers import Real

import numpy as np

from orbits.errors import InputError
from orbits.laws import Law, LawLike, law_statement as laws, positive


def formula(text: str, /, **parameters: float) -> Law:
    """Gravity from a formula of the height z: ``formula("1/(1 + z/R)**2", R=50)``.

    >>> float(formula("1/(1 + z/R)**2", R=50.0)(50.0))
    0.25
    """
    return _checked(laws.from_formula(text, "z", parameters))


def function(ratio: Callable, /, **parameters: float) -> Law:
    """Gravity from a Python function ratio(z, **parameters).

    >>> float(function(lambda z, R: 1 / (1 + z / R) ** 3, R=90.0)(90.0))
    0.125
    """
    return _checked(laws.from_function(ratio, "z", parameters))


def constant() -> Law:
    """Constant gravity."""
    return formula("1")


def inverse_square(*, R: float = 1000.0) -> Law:
    """Newton's gravity 1/(1 + z/R)**2 above a sphere of radius R (Principia, book 1, proposition 71)."""
    return formula("1/(1 + z/R)**2", **positive(R=R))


def linear(*, kappa: float = 0.001) -> Law:
    """First-order gradient 1 - kappa z; kappa = 2/R is the sphere's to first order (the free-air gradient)."""
    return formula("1 - kappa*z", kappa=kappa)


def exponential(*, H: float = 1000.0) -> Law:
    """Gravity that decays as exp(-z/H), as a screened (Yukawa) force does at distances much smaller than the body."""
    return formula("exp(-z/H)", **positive(H=H))


NAMED = {law.__name__: law for law in (constant, inverse_square, linear, exponential)}


def __dir__() -> list[str]:
    """What states gravity, for completion."""
    return [*NAMED, "NAMED", "as_gravity", "formula", "function"]


def as_gravity(law: LawLike, parameters: Mapping[str, float] | None = None, shared: bool = False) -> Law:
    """A gravity law from a law, a formula, a law's name or a Python function, with parameters by name; `shared` is
    as in `springs.as_spring`. Raises `InputError` for anything else."""
    if isinstance(law, Real):
        raise InputError(_no_ratio(f"gravity = {law:g}", float(law)))
    if isinstance(law, str) and law.startswith(("table:", "potential:")):
        raise InputError(f"gravity '{law}': gravity is a formula of z or a law's name; only springs are tables")
    return _checked(laws.from_any(law, "z", parameters, NAMED, "gravity", shared))


def _checked(law: Law) -> Law:
    """A law of gravity; raises `InputError` where it is piecewise or is not 1 at the ground."""
    if law.pieces is not None:
        raise InputError(f"gravity '{law.text}' is piecewise; write it as one smooth formula of z")
    with np.errstate(all="ignore"):
        values = {name: np.float64(value) for name, value in law.parameters.items()}
        ground = float(law.expression(np.float64(0.0), values, []))
    if not abs(ground - 1) <= 1e-9:
        raise InputError(_no_ratio(f"gravity '{law.text}' is {ground:g} at the ground", ground))
    return law


def _no_ratio(stated: str, ground: float) -> str:
    """The message about a law that has this value at the ground."""
    in_si = f"for {ground:g} m/s^2" if ground > 0 else "for an acceleration above 0 in m/s^2"
    value = f"{ground:g}" if ground > 0 else "..."
    return f"{stated}; it is a ratio and must be 1 at z = 0: {in_si} use hopper_in_si(..., surface_gravity={value})"
