"""Formulas from SymPy's expressions, by walking over their trees; no text is evaluated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any

from ..errors import InputError
from ..io import extra_package
from .formula import CONSTANTS, FUNCTIONS, parse, suggest
from .tracing import Text

# SymPy's names of functions that have another one in formulas.
OTHER_NAMES = {"Abs": "abs"}


def sympy_package() -> Any:
    """SymPy; raises `InputError` where it is not installed."""
    return extra_package("sympy", "for a machine in SymPy's expressions", "sympy")


def formula_of(expression: Any, names: Mapping[Any, str], what: str) -> str:
    """The formula of an expression.

    names : of those symbols whose names are not their own; all other symbols are parameters
    what : the expression is, for messages

    Raises `InputError` for what formulas do not have: functions that are not on their list, derivatives, conditions,
    complex and infinite numbers, and more operations than they may have.
    """
    sympy = sympy_package()
    shown = expression.xreplace({symbol: sympy.Symbol(name) for symbol, name in names.items()})
    try:
        found = _Writer(names, f"{what} = {abridged(shown)}").text(expression).text
        parse(found)
    except RecursionError:
        raise InputError(f"{what} is nested too deep for a formula: simplify it") from None
    except InputError as error:
        raise error if str(error).startswith(what) else InputError(f"{what}: {error}") from None
    return found


def name_of_parameter(symbol: Any) -> str:
    """The name of a symbol as that of a parameter; raises `InputError` for one that formulas do not take."""
    name = str(symbol.name)
    if not (name.isascii() and name.isidentifier()):
        raise InputError(f"symbol '{name}' cannot name a parameter: use letters, digits and _, as in 'm1'")
    if name in CONSTANTS or name in FUNCTIONS:
        raise InputError(f"symbol '{name}' has a meaning in formulas; rename it")
    return name


def abridged(expression: object) -> str:
    """An expression in at most 80 characters."""
    text = str(expression)
    return text if len(text) <= 80 else f"{text[:76]} ..."


@dataclass(frozen=True)
class _Writer:
    """Writes expressions as parts of formulas, with these names of symbols."""

    names: Mapping[Any, str]
    what: str

    def text(self, each: Any) -> Text:
        """The part of a formula that an expression is."""
        if not getattr(each, "is_commutative", False) or not hasattr(each, "is_Float"):
            raise InputError(f"{self.what} is not a scalar expression")
        if each in self.names:
            return Text(self.names[each])
        if each.is_Symbol:
            return Text(name_of_parameter(each))
        if each.is_Number and each.is_finite:
            return self._number(each)
        if each.is_Add:
            first, *others = each.as_ordered_terms()
            signs = [other.could_extract_minus_sign() for other in others]
            texts = [self.text(-other if less else other) for other, less in zip(others, signs, strict=True)]
            pairs = zip(texts, signs, strict=True)
            return reduce(lambda found, pair: found - pair[0] if pair[1] else found + pair[0], pairs, self.text(first))
        if each.is_Mul:
            return self._product(each.args)
        if each.is_Pow:
            return self._power(*each.args)
        return self._named(each)

    def _number(self, each: Any) -> Text:
        """A number: decimals have the digits that bring a double back."""
        if each.is_Float:
            return _signed(repr(float(each)))
        return _signed(str(each.p)) if each.q == 1 else _signed(str(each.p)) / Text(str(each.q))

    def _product(self, factors: Sequence[Any]) -> Text:
        """A product, as one quotient."""
        number, others = (factors[0], factors[1:]) if factors[0].is_Rational else (None, factors)
        below = [1 / each for each in others if each.is_Pow and each.exp.could_extract_minus_sign()]
        above = [each for each in others if not (each.is_Pow and each.exp.could_extract_minus_sign())]
        top, bottom = (1, 1) if number is None else (abs(number.p), number.q)
        over = [*([Text(str(top))] if top != 1 or not above else []), *map(self.text, above)]
        under = [*([Text(str(bottom))] if bottom != 1 else []), *map(self.text, below)]
        found = reduce(mul, over)
        found = found / reduce(mul, under) if under else found
        return -found if number is not None and number.p < 0 else found

    def _power(self, base: Any, exponent: Any) -> Text:
        if exponent.could_extract_minus_sign():
            return Text("1") / self.text(base**-exponent)
        if exponent.is_Rational and exponent.p == 1 and exponent.q == 2:
            return Text(f"sqrt({self.text(base).text})")
        return self.text(base) ** self.text(exponent)

    def _named(self, each: Any) -> Text:
        """A constant or a function by its name."""
        kind, constants = each.func.__name__, {"Pi": "pi", "Exp1": "exp(1)"}
        name = OTHER_NAMES.get(kind, kind)
        if kind in constants:
            return Text(constants[kind])
        if each.is_Function and name in FUNCTIONS and len(each.args) == 1:
            return Text(f"{name}({self.text(each.args[0]).text})")
        if each.is_Function:
            known = suggest(kind, FUNCTIONS)
            raise InputError(
                f"{self.what}: formulas have no function '{kind}'{known}; rewrite it with functions that they have"
            )
        raise InputError(f"{self.what}: '{abridged(each)}' ({kind}) cannot stand in a formula")


def _signed(number: str) -> Text:
    return -Text(number[1:]) if number.startswith("-") else Text(number)
