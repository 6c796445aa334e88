"""The toolkit's exceptions, all derived from `OrbitsError`, and the checks of numbers and names that a user gives."""

import re
from collections.abc import Iterable, Mapping, Sequence
from inspect import signature
from numbers import Real
from typing import Any, NamedTuple, TypeGuard

import numpy as np


class MessageOptions(NamedTuple):
    """The lengths of messages in characters."""

    longest: int = 300  # some lines of a terminal: the middle of a longer message, which quotes its input, is left out
    head: int = 180  # of the beginning that stays
    tail: int = 110  # of the end that stays, where the remedy stands


MESSAGES = MessageOptions()
LARGEST_NUMBER = 10**9  # of things that are counted
LARGEST_SEED = 2**64 - 1  # of random numbers


def shortened(message: str) -> str:
    """A message of at most 300 characters, without the middle of a longer one."""
    return message if len(message) <= MESSAGES.longest else cut_in_the_middle(message, MESSAGES.head, MESSAGES.tail)


def cut_in_the_middle(text: str, longest_head: int, longest_tail: int) -> str:
    """A text's beginning and end, of at most these numbers of characters. A word that the cut goes through is left out,
    unless it is most of what there is."""
    head, tail = text[:longest_head], text[-longest_tail:]
    whole_head, whole_tail = head.rpartition(" ")[0], tail.partition(" ")[2]
    head = whole_head if 2 * len(whole_head) > len(head) else head
    tail = whole_tail if 2 * len(whole_tail) > len(tail) else tail
    return f"{head} ... {tail}"


class OrbitsError(Exception):
    """Base class of all errors that the toolkit raises; the message says what is wrong, where, and what to do."""

    def __str__(self) -> str:
        return shortened(super().__str__())


class InputError(OrbitsError, ValueError):
    """A number, formula, file or option from the user is invalid. It is a `ValueError` too."""


class InconsistentModel(InputError):
    """A machine does not move as its statement says.

    relations : the relations of `check` that do not hold
    """

    def __init__(self, message: str, relations: tuple[Any, ...] = ()):
        super().__init__(message)
        self.relations = relations

    def __str__(self) -> str:  # every relation that does not hold is named
        return Exception.__str__(self)


class NoMachineCode(OrbitsError, RuntimeError):
    """The machine code that integrates motions by Taylor series cannot be made here; the message says why."""


class NoOrbit(OrbitsError):
    """The machine has no such orbit, or none could be certified; the message gives the reason."""


class NoStep(NoOrbit):
    """No step along a curve of orbits leads on from an orbit."""


class FlowError(NoOrbit):
    """A trajectory cannot be integrated further: it grows without bound, or its state is no longer finite."""


class OutOfRange(FlowError):
    """A trajectory needs a law where it is not defined, for example outside a measured table."""


class RunsAway(FlowError):
    """A trajectory grows beyond all bounds."""


class BreaksDown(FlowError):
    """A trajectory comes to a singularity: its step size goes to zero or is not a number."""


def refuse_machine(machine: object, wrong: Mapping[str, str]) -> None:
    """Raise `InputError` where parts of a machine are wrong, in words by name; no words say that a part is missing."""
    if wrong:
        parts = "; ".join(f"{name}: {text}" if text else f"it has no '{name}'" for name, text in wrong.items())
        raise InputError(f"'{type(machine).__name__}' is not a machine such as problems.Hopper(): {parts}")


NUMBER_WITH_UNIT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?![eE][-+]?\d)[^\W\d_][^\s,;*+()]*)\s*"
)
# Units that are written after a number, in SI.
UNITS_IN_SI = {
    **{"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": 0.0254, "kg": 1.0, "g": 1e-3},
    **{"N": 1.0, "kN": 1e3, "mN": 1e-3, "s": 1.0, "ms": 1e-3, "m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "m/s^2": 1.0},
    **{"N/m": 1.0, "N/mm": 1e3, "N/cm": 1e2, "kN/m": 1e3, "N/m^3": 1.0, "Hz": 1.0, "deg": np.pi / 180},
}


def unit_stated(value: object) -> str:
    """What to do about the unit in a text that is a number with one, as "620mm"; empty for anything else."""
    found = NUMBER_WITH_UNIT.fullmatch(value) if isinstance(value, str) and len(value) < 40 else None
    if found is None:
        return ""
    factor = UNITS_IN_SI.get(found[2])
    own = "" if factor is None else f", {float(found[1]) * factor:g} for a machine in SI"
    return f": leave the unit '{found[2]}' out and state the number alone{own}"


def finite_number(name: str, value: object) -> float:
    """`value` as a finite float; raises `InputError` that names it."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else np.nan
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        raise InputError(f"{name} = {value!r} is not a finite number{unit_stated(value)}")
    return number


def range_of(name: str, ends: Any) -> tuple[float, float]:
    """The two ends of a range; raises `InputError` for anything but a pair of numbers that ascend."""
    try:
        low, high = ends if is_list(ends) else ()
    except ValueError:
        raise InputError(f"{name} = {ends!r}; it must be a pair (low, high)") from None
    low, high = finite_number(name, low), finite_number(name, high)
    if not low < high:
        raise InputError(f"{name} = ({low:g}, {high:g}); low must be below high")
    return low, high


def as_array_or_nan(values: Any) -> np.ndarray:
    """Numbers (...) as an array, which is one NaN for anything else."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)


def finite_times(t: object) -> np.ndarray:
    """Times (...) as an array; raises `InputError` for anything but finite numbers."""
    times = as_array_or_nan(t)
    if not np.isfinite(times).all():
        raise InputError("times must be finite numbers")
    return times


def whole_number(name: str, value: object, what: str = "", least: int = 1, most: int | None = None) -> int:
    """`value` as a whole number (of `what`) from `least` to `most`, by default to a `LARGEST_NUMBER`, more than fits
    into memory; raises `InputError` with the bounds."""
    number = least - 1
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        number = int(value)
    largest = LARGEST_NUMBER if most is None else most
    if not least <= number <= largest:
        kind = f"number of {what}," if what else "whole number"
        bounds = f"from {least} to {largest}"
        if most is None and number < least:
            kind, bounds = kind.removesuffix(",") + ",", f"at least {least}"
        raise InputError(f"{name} = {value!r}; it must be a {kind} {bounds}")
    return number


def true_or_false(name: str, value: object) -> bool:
    """`value` as a truth value; raises `InputError` for anything else, as a number, text or an array."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} = {value!r}; it must be True or False")
    return bool(value)


def one_of(name: str, value: object, known: Sequence[str]) -> str:
    """`value` as one of the known words; raises `InputError` with them."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} = {value!r}; it must be one of {', '.join(known)}")
    return value


def is_list(value: object) -> TypeGuard[Iterable[Any]]:
    """Whether a value has entries: no text, and no array of one number without an axis."""
    return isinstance(value, Iterable) and not isinstance(value, str | bytes) and getattr(value, "ndim", 1) > 0


def takes(function: object, count: int) -> bool:
    """Whether something can be called with a number of arguments, as far as its signature says."""
    if not callable(function):
        return False
    try:
        signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # a builtin function without a signature
        return True
    return True


def list_of_names(what: str, names: object) -> list[str]:
    """`names` in a list, where a single one may be text; raises `InputError` that says `what` they are."""
    names = names.tolist() if isinstance(names, np.ndarray) else names
    found = [names] if isinstance(names, str) else list(names) if is_list(names) else [None]
    if not all(isinstance(name, str) for name in found):
        raise InputError(f"{what} = {names!r}; it must be a name, or a list of names")
    return [str(name) for name in found]
