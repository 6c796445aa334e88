"""The parameters that a machine's formulas are given, beside what the machine itself has names for."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from orbits.errors import InputError
from orbits.laws.law import number


def given_numbers(parameters: Any) -> dict[str, float]:
    """The values of parameters by name; raises `InputError` for what is no mapping of names to numbers."""
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters = {parameters!r}; they are a mapping of names to numbers")
    return {name: number(name, value) for name, value in parameters.items()}


def refuse_taken(taken: Collection[str], names: Iterable[str], what: str) -> None:
    """Raise `InputError` for a parameter of a formula whose name is taken, by `what` in words."""
    if found := sorted({*names} & {*taken}):
        raise InputError(f"'{found[0]}' is {what}; call the formula's parameter something else")


def with_given(own: Mapping[str, Any], parameters: Any, what: str = "an argument of its own") -> dict[str, Any]:
    """A machine's own parameters and those that its formulas are given; raises `InputError` for a name in both."""
    given = given_numbers({} if parameters is None else parameters)
    refuse_taken(own, given, what)
    return {**own, **given}
