"""The elements of a mechanism: inertias, and forces along an extension or a height.

Extensions and heights are formulas of the coordinates and the parameters, numbers, or Python functions (y, p) of both
by name, written with operators and NumPy or CasADi functions. Masses, inertances and coefficients are formulas, numbers
or functions of the parameters alone: a formula that names a coordinate is refused, whereas a Python function that uses
one is not detected, and the machine is then wrong. An inertia that varies is stated by `Mechanism(inertia=...)`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ..laws import Algebraic, Key, LawLike, Parameters
from ..symbolic import Formula, parse

Scalar: TypeAlias = str | float | Callable[[Parameters, Parameters], Algebraic]


@dataclass(frozen=True)
class Mass:
    """A point mass at a height: it has inertia and weight.

    height : its height, a formula of the coordinates and parameters, a number, or a Python function (y, p)
    mass : its mass, an expression of the parameters alone; in kg for a mechanism in SI
    across : its horizontal place, an expression like the height; None for a mass that moves only vertically
    """

    height: Scalar
    mass: Scalar
    across: Scalar | None = None


@dataclass(frozen=True)
class Weight:
    """The weight of a mass at a height, without its inertia.

    height, mass : as in `Mass`
    """

    height: Scalar
    mass: Scalar


@dataclass(frozen=True)
class Inerter:
    """A force against the second derivative of an extension, like that of a mass that moves along it (Smith 2002).

    extension : a formula of the coordinates and parameters, a number, or a Python function (y, p)
    inertance : force over the second derivative, an expression of the parameters alone; in kg for a length in SI
    """

    extension: Scalar
    inertance: Scalar


@dataclass(frozen=True)
class Spring:
    """A force against an extension.

    extension : a formula of the coordinates and parameters, a number, or a Python function (y, p)
    force : a law, for example of `problems.springs`, or a formula of the extension r; tension is positive; in N of m
        for a length in SI
    """

    extension: Scalar
    force: Any = "r"

    if TYPE_CHECKING:  # a mechanism stores the key of the law

        def __init__(self, extension: Scalar, force: LawLike | Key = "r"): ...


@dataclass(frozen=True)
class Damper:
    """A force against the rate of an extension: coefficient times rate.

    A machine with a damper loses energy in every hop, so `find` refuses it; `simulate` and `ReturnMap` accept it.

    extension : a formula of the coordinates and parameters, a number, or a Python function (y, p)
    coefficient : at least 0, an expression of the parameters alone; in N s/m for a length in SI
    """

    extension: Scalar
    coefficient: Scalar


@dataclass(frozen=True)
class Potential:
    """Any other conservative forces, stated by their potential energy as a function of the coordinates.

    `find` accepts a machine with a potential; its energy is part of the machine's energy.

    energy : a formula of the coordinates and parameters, or a Python function (y, p); in J for a mechanism in SI
    """

    energy: Scalar


@dataclass(frozen=True)
class Force:
    """A generalised force along a function of the coordinates, which may depend on speeds and need not conserve energy.

    As with a `Damper`, `find` refuses a machine with such a force, even where the force does no work; `simulate` and
    `ReturnMap` accept it. A force that conserves energy is stated by its `Potential`.

    along : the function, a formula of the coordinates and parameters, or a Python function (y, p); its rate times the
        force is the power
    force : a Python function (y, v, p) of coordinates, their rates and parameters by name
    """

    along: Scalar
    force: Callable


Element: TypeAlias = Mass | Weight | Inerter | Spring | Damper | Potential | Force


@lru_cache(maxsize=1024)
def parsed(text: str) -> Formula:
    """A formula, parsed once."""
    return parse(text)


def names_in(expression: object) -> frozenset[str]:
    """The names in an expression; the names that a Python function uses are not known."""
    return parsed(expression).names if isinstance(expression, str) else frozenset()


def value_of(expression: Scalar, y: Parameters, p: Parameters) -> Algebraic:
    """The value of an expression at coordinates and parameters by name."""
    if isinstance(expression, str):
        formula = parsed(expression)
        return formula(**{name: y[name] if name in y else p[name] for name in formula.names})
    return expression(y, p) if callable(expression) else float(expression)


def paths_of(mass: Mass) -> list[Scalar]:
    """The functions of the coordinates along which a mass moves."""
    return [mass.height] if mass.across is None else [mass.height, mass.across]


def fields_of(element: Element) -> list[Any]:
    """The expressions that define an element, without its law."""
    found = {name: getattr(element, name) for name in element.__match_args__ if name != "force"}
    return [each for name, each in found.items() if each is not None or name != "across"]


def expressions_of(stated: Any) -> list[Any]:
    """The expressions of a `Mechanism`, or of its structure, that may contain parameters, without the laws."""
    elements = [value for element in stated.elements for value in fields_of(element)]
    forces = [element.force for element in stated.elements if isinstance(element, Force)]
    whole = [stated.surface_gravity, stated.energy_unit]
    optional = [each for each in (stated.gap, stated.counts, stated.separation, stated.friction) if each is not None]
    by_name = [*dict(stated.heights or {}).values(), *dict(stated.rest).values()]
    rows = [value for row in stated.inertia for value in row]
    lengths = [length for *_, length in stated.knees]
    maps = [stated.reversor or {}, stated.symmetry, stated.gaps, stated.sticks]
    return [
        *elements,
        *forces,
        *whole,
        *optional,
        *by_name,
        *rows,
        *lengths,
        *(value for each in maps for value in dict(each).values()),
    ]
