"""Python functions written as formulas, by calling them with names in place of numbers."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .formula import FUNCTIONS, parse

# Places at which a function is compared with its formula, and how far rounding may part them there.
TRACED_AT, TRACED_TO = (-1.7, -0.3, 0.0, 0.45, 2.3), 1e-9

# How tightly the parts of a formula hold together: sums, products, signs and powers, names and calls.
SUM, PRODUCT, SIGN, ATOM = range(4)
# NumPy's functions by name, and NumPy's other operations on numbers.
_CALLS = {numpy: name for name, (numpy, _) in FUNCTIONS.items()}
_OPERATORS_OF_NUMPY: dict[str, Callable] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "power": lambda a, b: a**b,
    "negative": lambda a: -a,
    "positive": lambda a: a,
    "square": lambda a: a**2,
    "reciprocal": lambda a: 1 / a,
}


class Text:
    """A part of a formula; operators and NumPy's functions make longer ones of it."""

    __slots__ = ("level", "text")

    def __init__(self, text: str, level: int = ATOM):
        self.text, self.level = text, level

    def within(self, level: int) -> str:
        """The text, in parentheses where it holds together less tightly than this."""
        return self.text if self.level >= level else f"({self.text})"

    def __add__(self, other: object) -> "Text":
        return Text(f"{self.text} + {_text(other).within(PRODUCT)}", SUM)

    def __radd__(self, other: object) -> "Text":
        return _text(other) + self

    def __sub__(self, other: object) -> "Text":
        return Text(f"{self.text} - {_text(other).within(PRODUCT)}", SUM)

    def __rsub__(self, other: object) -> "Text":
        return _text(other) - self

    def __mul__(self, other: object) -> "Text":
        return Text(f"{self.within(PRODUCT)}*{_text(other).within(SIGN)}", PRODUCT)

    def __rmul__(self, other: object) -> "Text":
        return _text(other) * self

    def __truediv__(self, other: object) -> "Text":
        return Text(f"{self.within(PRODUCT)}/{_text(other).within(SIGN)}", PRODUCT)

    def __rtruediv__(self, other: object) -> "Text":
        return _text(other) / self

    def __pow__(self, other: object) -> "Text":
        return Text(f"{self.within(ATOM)}**{_text(other).within(ATOM)}", SIGN)

    def __rpow__(self, other: object) -> "Text":
        return _text(other) ** self

    def __neg__(self) -> "Text":
        return Text(f"-{self.within(ATOM)}", SUM)

    def __pos__(self) -> "Text":
        return self

    def __bool__(self) -> bool:
        raise TypeError("a formula has no branches")

    def __eq__(self, other: object) -> bool:
        raise TypeError("a formula has no branches")

    __hash__ = None  # type: ignore[assignment]

    def __abs__(self) -> "Text":
        return Text(f"abs({self.text})")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: object) -> Any:
        name = ufunc.__name__
        if method != "__call__" or options or (name not in _CALLS and name not in _OPERATORS_OF_NUMPY):
            return NotImplemented
        if name in _CALLS:
            return Text(f"{_CALLS[name]}({_text(inputs[0]).text})")
        return _OPERATORS_OF_NUMPY[name](*map(_text, inputs))


def _text(value: object) -> Text:
    """A part of a formula, of a number too."""
    if isinstance(value, Text):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    text = str(value) if isinstance(value, int) else repr(float(value))
    return Text(text, SUM if text.startswith("-") else ATOM)


def traced(function: Callable, arguments: Sequence[str], names: Sequence[str] = ()) -> str | None:
    """The formula that a Python function computes of these arguments and keyword arguments; None for a function that
    needs more than operators, numbers and NumPy's functions."""
    first = len(arguments)
    return _confirmed_formula(
        lambda of: function(*of[:first], **dict(zip(names, of[first:], strict=True))), [*arguments, *names]
    )


def traced_of_places(function: Callable, coordinates: Sequence[str], names: Sequence[str]) -> str | None:
    """The formula that a Python function computes of mappings of coordinates and of parameters, likewise."""
    first = len(coordinates)
    return _confirmed_formula(
        lambda of: function(dict(zip(coordinates, of[:first], strict=True)), dict(zip(names, of[first:], strict=True))),
        [*coordinates, *names],
    )


def _confirmed_formula(function: Callable[[list], Any], names: Sequence[str]) -> str | None:
    """The formula of a function of a list of values by these names; None also where it computes something else of
    numbers than of names."""
    try:
        text = _text(function([Text(name) for name in names])).text
        formula = parse(text)
        for place in TRACED_AT:
            values = [np.float64(place + 0.37 * i) for i in range(len(names))]
            named = dict(zip(names, values, strict=True))
            with np.errstate(all="ignore"):
                found = np.float64(function(values))
                expected = formula(**{name: named[name] for name in formula.names})
            if not np.isclose(found, expected, rtol=TRACED_TO, atol=TRACED_TO, equal_nan=True):
                return None
    except Exception:  # whatever a function of the user does with values that are not numbers
        return None
    return text
