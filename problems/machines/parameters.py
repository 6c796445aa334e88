"""The parameters of a machine's formulas, without the names of the machine itself."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from orbits.errors import InputError
from orbits.laws import number
from orbits.units import STANDARD_GRAVITY


def gravity_in_si(stated: float | None) -> float:
    """The acceleration of gravity that is stated, in m/s^2, or the standard one."""
    return STANDARD_GRAVITY if stated is None else number("surface_gravity", stated)


def checked_numbers(parameters: object) -> dict[str, float]:
    """The values of parameters by name; raises `InputError` unless it is a mapping of names to numbers."""
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters = {parameters!r}; they are a mapping of names to numbers")
    return {name: number(name, value) for name, value in parameters.items()}


def stated_numbers(parameters: object) -> dict[str, float]:
    """`checked_numbers` of parameters that may be left out, as None."""
    return checked_numbers({} if parameters is None else parameters)


def refuse_taken(taken: Collection[str], names: Iterable[str], what: str) -> None:
    """Raise `InputError` for a parameter of a formula whose name is taken, by `what` in words."""
    if found := sorted({*names} & {*taken}):
        raise InputError(f"'{found[0]}' is {what}; call the formula's parameter something else")


def with_parameters(
    own: Mapping[str, object], parameters: object, what: str = "an argument of its own"
) -> dict[str, Any]:
    """A machine's own parameters and those of its formulas; raises `InputError` for a name in both."""
    values = stated_numbers(parameters)
    refuse_taken(own, values, what)
    return {**own, **values}


def own_numbers(kind: str, stated: Mapping[str, float | None], usual: Mapping[str, float]) -> dict[str, float]:
    """The numbers of a kind of machine, with the usual ones in place of None; raises `InputError` unless all are
    above 0."""
    own = {name: number(name, usual[name] if value is None else value) for name, value in stated.items()}
    for name, value in own.items():
        if not value > 0:
            raise InputError(f"{name} = {value:g}; for {kind} it must lie above 0")
    return own


def refuse_missing(
    kind: str, stated: Mapping[str, float | None], units: Mapping[str, str], used: Collection[str]
) -> None:
    """Raise `InputError` for a machine in SI that does not state a number it uses."""
    if missing := [name for name in units if name in used and stated.get(name) is None]:
        needed = ", ".join(f"{name} ({units[name]})" for name in missing)
        raise InputError(f"{kind} in SI needs {needed}: only {kind} without units has default values")
