"""The parameters of a machine's formulas, without the names of the machine itself."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from orbits.errors import InputError
from orbits.laws import Law, LawLike, number
from orbits.units import STANDARD_GRAVITY

from ..laws import as_spring


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


def numbers_and_laws(
    kind: str, stated: Mapping[str, float | None], usual: Mapping[str, float], units: Mapping[str, str],
    laws: Sequence[LawLike], parameters: object, in_si: bool,
) -> tuple[dict[str, float], list[Law]]:  # fmt: skip
    """The numbers that a machine uses, those of its springs' laws included, and these laws.

    stated : its own numbers; None stands for the usual value, of "surface_gravity" for 1 or the standard one in SI
    units : of the numbers that must be stated in SI, where the machine or its laws use them

    Raises `InputError` for a number that is not above 0, and for a missing one in SI.
    """
    usual = {**usual, "surface_gravity": STANDARD_GRAVITY if in_si else 1.0}
    own = {name: number(name, usual[name] if value is None else value) for name, value in stated.items()}
    for name, value in own.items():
        if not value > 0:
            raise InputError(f"{name} = {value:g}; for {kind} it must lie above 0")
    known = with_parameters(own, parameters)
    springs = [as_spring(law, known, shared=True) for law in laws]
    in_laws = {name for spring in springs for name in spring.key.names}
    unused = {name for name in own if name.endswith("stiffness")} - in_laws
    used = {name: value for name, value in known.items() if name not in unused}
    if in_si and (missing := [name for name in units if name in used and stated[name] is None]):
        needed = ", ".join(f"{name} ({units[name]})" for name in missing)
        raise InputError(f"{kind} in SI needs {needed}: only {kind} without units has default values")
    return used, springs
