"""Formulas of a case as Taylor series with some sixty digits, from the text of the case alone.

They share nothing with the toolkit nor with `check.py`, and need python-flint only. `motion.py` strings the series
together, `zeros.py` finds events, and `build.py` writes the answers.
"""

import ast
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from flint import arb, arb_series, ctx

from studies.exact_orbits.zeros import middle

State = dict[str, arb]


class Number(str):
    """The digits of a number in a file."""


class CaseError(ValueError):
    """What a case states cannot be computed."""


@dataclass(frozen=True)
class Options:
    """How exactly motions are computed.

    digits : of all numbers
    orders_per_digit : of the series; the least work is near log(10)/2
    rough_digits : of the slopes of Newton's method, and of its first steps
    spare_digits : by which Newton's last step may be larger than the last digit
    most_events : a motion with more of them at nearly one time fails
    """

    digits: int = 60
    orders_per_digit: float = 1.15
    rough_digits: int = 24
    spare_digits: int = 10
    most_events: int = 4

    @property
    def order(self) -> int:
        """Of the Taylor series."""
        return round(self.orders_per_digit * self.digits)

    @property
    def cluster(self) -> float:
        """Zeros of a guard as close as this, as a part of a step, are one multiple zero."""
        return 10 ** (-self.digits / 4)

    @property
    def negligible(self) -> float:
        """A guard or a kink below this is zero at the start of a mode."""
        return 10 ** (-0.3 * self.digits)


def read(path: Path) -> dict[str, Any]:
    """The document of a case, whose numbers are their digits."""
    return json.loads(path.read_text(encoding="utf-8"), parse_float=Number, parse_int=Number)


def sign_at_start(x: Any, negligible: float) -> int:
    """The sign of a number, or of a series just after its start; 0 where it vanishes."""
    for c in x.coeffs() if isinstance(x, arb_series) else [arb(x)]:
        if abs(float(c)) > negligible:
            return 1 if float(c) > 0 else -1
    return 0


def _functions(negligible: float) -> dict[str, Callable[..., Any]]:
    """What a formula's operators and functions do with numbers and with series."""

    def power(base: Any, exponent: Any) -> Any:
        whole = exponent.unique_fmpz() if isinstance(exponent, arb) else None
        if whole is None or not isinstance(base, arb_series):
            return base**exponent
        n, product = abs(int(whole)), arb_series([1])
        for bit in f"{n:b}":  # flint's own power needs a first coefficient that is not 0
            product = product * product * base if bit == "1" else product * product
        return product if whole >= 0 else 1 / product

    def ratio(a: Any, b: Any) -> Any:
        return a / b if sign_at_start(b, 0.0) else a + arb("nan")  # where flint raises an error for series

    def larger(a: Any, b: Any) -> Any:
        return a if sign_at_start(a - b, negligible) >= 0 else b

    found: dict[str, Callable[..., Any]] = {"Add": lambda a, b: a + b, "Sub": lambda a, b: a - b, "Pow": power}
    found |= {"Mult": lambda a, b: a * b, "Div": ratio, "USub": lambda a: -a}
    found |= {"max": larger, "min": lambda a, b: -larger(-a, -b), "abs": lambda a: larger(a, -a)}
    return found | {
        name: lambda a, name=name: getattr(a, name)() for name in ("sin", "cos", "tan", "exp", "log", "sqrt")
    }


class Names(dict[str, Any]):
    """Values by name; `other` computes a formula's value when its name is first used."""

    def __init__(self, values: Mapping[str, Any], other: Callable[[str, "Names"], Any]) -> None:
        super().__init__(values)
        self.other = other

    def __missing__(self, name: str) -> Any:
        found = self[name] = self.other(name, self)
        return found


class Formulas:
    """The formulas of a case as numbers and as series.

    document : of the case; its unknowns are the stored ones, or else the guesses
    """

    def __init__(self, document: Mapping[str, Any], options: Options) -> None:
        self.document, self.options, self.parsed = document, options, cache(self._parsed)
        self.set_digits()
        self.functions = _functions(options.negligible)
        self.texts = {**document["parameters"], **document["formulas"]}
        stored = {name: each["value"] for name, each in document.get("unknowns", {}).items()}
        guesses = document["orbit"]["unknowns"] if "orbit" in document else {}
        self.unknowns = {name: middle(arb(str(stored.get(name, guess)))) for name, guess in guesses.items()}

    def set_digits(self) -> None:
        """Compute with the digits of the options from here on; those of flint are global."""
        ctx.dps = self.options.digits

    def _parsed(self, text: str) -> Callable[[Names], Any]:
        """The function of names that a formula's text states."""

        def built(node: ast.AST) -> Callable[[Names], Any]:
            if isinstance(node, ast.Constant):
                number = arb(str(ast.get_source_segment(text, node)))
                return lambda names: number
            if isinstance(node, ast.Name):
                return lambda names: names[node.id]
            called = isinstance(node, ast.Call)
            name = getattr(node.func, "id", "") if called else type(getattr(node, "op", None)).__name__
            nodes = node.args if called else ast.iter_child_nodes(node)
            parts = [built(each) for each in nodes if isinstance(each, ast.expr)] if name in self.functions else []
            if not 1 <= len(parts) <= 2:
                raise CaseError(
                    f"{ast.unparse(node)!r} in {text!r}; formulas have numbers, names, + - * / ** and {known}"
                )
            act, first, last = self.functions[name], parts[0], parts[-1]
            return (
                (lambda names: act(first(names), last(names))) if len(parts) == 2 else (lambda names: act(first(names)))
            )

        known = " ".join(name for name in self.functions if name.islower())
        return built(ast.parse(text, mode="eval").body)

    def names(self, values: Mapping[str, Any], other: Callable[[str], Any] | None = None) -> Names:
        """Values by name; those of parameters and formulas, and at last of `other`, are added as they are used."""

        def computed(name: str, names: Names) -> Any:
            if name in self.texts:
                return self.parsed(self.texts[name])(names)
            if other is None:
                raise CaseError(f"nothing is called {name!r}: no parameter, state, unknown or formula")
            return other(name)

        return Names({**self.unknowns, **values}, computed)

    def value(self, text: str, names: Names | None = None) -> arb:
        """The number that a formula states."""
        return middle(arb(self.parsed(text)(self.names({}) if names is None else names)))

    def series(self, mode: str, t: arb, x: State, forward: int = 1) -> Names:
        """The Taylor series of the time, of the states of a mode, and of formulas as they are used, in the time since
        t, or in the time before it if `forward` is -1."""
        ctx.cap = self.options.order + 1
        right = {name: self.parsed(text) for name, text in self.document["modes"][mode]["derivatives"].items()}
        clock, found = arb_series([t, forward]), {name: arb_series([x[name]], prec=1) for name in right}
        while min(each.prec for each in found.values()) < ctx.cap:
            names = self.names({"t": clock, **found})
            for name, slope in reversed(right.items()):  # speeds first, and then the places that they move
                names[name] = found[name] = (forward * arb_series(slope(names))).integral() + x[name]
        exact = {name: arb_series([middle(c) for c in each.coeffs()]) for name, each in found.items()}
        if not all(c.is_finite() for each in exact.values() for c in each.coeffs()):
            raise CaseError(f"the derivatives of the mode {mode!r} have no value at the time {float(t):g}")
        return self.names({"t": clock, **exact})

    def step(self, series: Names, texts: list[str]) -> float:
        """The length at which the last terms of the series of all these formulas are negligible."""
        tiny, length = 10.0**-self.options.digits, math.inf
        for text in texts:
            c = [abs(float(each)) for each in arb_series(self.parsed(text)(series)).coeffs()]
            for k in range(self.options.order - 2, len(c)):
                if c[k] > 0:
                    length = min(length, (max(1.0, c[0]) * tiny / c[k]) ** (1 / k))
        return length
