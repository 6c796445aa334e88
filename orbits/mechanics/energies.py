"""Mechanisms from a kinetic and a potential energy in SymPy's expressions.

Coordinates are functions of time, as `sympy.physics.mechanics.dynamicsymbols` makes them, and all other symbols are
parameters. The kinetic energy T = v' M v/2 gives the inertia M, whose entries may depend on the coordinates. The
potential energy is taken apart as its terms allow, so that the machine has the closed forms and the proofs of one that
is stated by its elements:

- what is proportional to the acceleration of gravity is the weight of masses at heights,
- a function of one sum of coordinates with numbers before them, as k (y1 - y2 - l)^2/2, is a spring along this sum,
- what is left is a `Potential`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any

import numpy as np

from ..errors import InputError, as_array_or_nan, true_or_false
from ..laws import number
from ..symbolic import abridged, formula_of, name_of_parameter, suggest, sympy_package
from .bodies import Body, Joint
from .drawing import LANDINGS, REPEATED, Drawing, Outline
from .elements import Element, Potential, Spring, Weight, names_in, value_of
from .ground import Ground
from .refusals import listed

ALONG = "r"  # the variable of springs' laws
# Names that formulas of these have in addition to those of coordinates and parameters.
NAMES_BESIDE: Mapping[type, tuple[str, ...]] = {
    Spring: (ALONG,), Ground: (ALONG,), Joint: (LANDINGS,), Outline: (LANDINGS, REPEATED),
}  # fmt: skip
# The least eigenvalue of an inertia, over the largest, from which on it is regular.
REGULAR = 1e-13


def stated_by_energies(
    T: Any, V: Any, coordinates: Sequence[Any], gap: Any, parameters: Mapping[Any, float], gravity: Any,
    stated: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """The arguments of a `Mechanism` with these energies; see `Mechanism.from_lagrangian`."""
    if taken := [name for name in ("inertia", "surface_gravity", "gap", "gaps") if name in stated]:
        raise InputError(f"{taken[0]} = {stated[taken[0]]!r}: that follows from T, V, gap and gravity; leave it out")
    for name, value in (("parameters", parameters), ("rest", stated.get("rest", {}))):
        if not isinstance(value, Mapping):
            raise InputError(f"{name} = {value!r}; it must be a mapping of names")
    if along := [name for name in ("sticks", "friction") if stated.get(name)]:
        raise InputError(
            f"{along[0]} = {stated[along[0]]!r}: the force along the ground depends on where the masses are, which T "
            "does not say; state the machine by its elements, Mass(height, mass, across=...)"
        )
    energies = _Energies.of(coordinates)
    own = {name: energies.plain(value, name) for name, value in stated.items()}
    inertia = energies.inertia(energies.checked(T, "T", speeds=True))
    energy = energies.checked(V, "V")
    if not isinstance(gravity, energies.sympy.Symbol) and not (isinstance(gravity, str) and gravity.isidentifier()):
        raise InputError(
            f"gravity = {gravity!r}; it must be the symbol of the acceleration in V, or its name; give its value in "
            "parameters"
        )
    if str(gravity) not in {"g", *map(str, energy.free_symbols - {*energies.places})}:
        raise InputError(f"V has no gravity '{gravity}'")
    in_si = true_or_false("in_si", own.get("in_si", False))
    elements, pulled = energies.elements(energy, str(gravity), in_si)
    own |= {"surface_gravity": str(gravity)} if pulled else {}
    own["inertia"] = [[energies.formula(entry, "T") if entry != 0 else 0.0 for entry in row] for row in inertia]
    own["gaps" if isinstance(gap, Mapping) else "gap"] = energies.plain(gap, "gap")
    values = dict[str, float]()
    for name, value in parameters.items():
        if str(name) in values:
            raise InputError(f"parameters have '{name}' twice, by its symbol and by its name: leave one out")
        values[str(name)] = number(str(name), value)
    if missing := sorted(energies.found.keys() - values.keys()):
        raise InputError(f"'{missing[0]}' has no value: give parameters={{{missing[0]}: ...}}")
    _refuse_singular(own["inertia"], energies.names, values, own.get("rest", {}))
    vanished = energies.found.keys() - energies.used - {str(gravity)}
    return {
        **own,
        "coordinates": energies.names,
        "elements": [*elements, *listed("elements", own.get("elements", ()))],
        "parameters": {name: value for name, value in values.items() if name not in vanished},
    }


@dataclass(frozen=True)
class _Energies:
    """The coordinates of a machine in SymPy's expressions, and the parameters that these have.

    sympy : the package
    names : of the coordinates
    places, rates : the symbols that stand for the coordinates and for their speeds
    symbols : these by the functions of time that they stand for
    time : the symbol of time
    found : the symbols of parameters by name
    used : the names of symbols in formulas; others, as of constant energies, vanish
    """

    sympy: Any
    names: tuple[str, ...]
    places: tuple[Any, ...]
    rates: tuple[Any, ...]
    symbols: Mapping[Any, Any]
    time: Any
    found: dict[str, Any] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, coordinates: Any) -> "_Energies":
        """The expressions of functions of time."""
        sympy, listed = sympy_package(), list(coordinates) if np.iterable(coordinates) else [coordinates]
        times = {each.args for each in listed if isinstance(each, sympy.core.function.AppliedUndef)}
        odd = [each for each in listed if not isinstance(each, sympy.core.function.AppliedUndef)]
        if odd or len(times) != 1 or any(len(each) != 1 or not each[0].is_Symbol for each in times):
            raise InputError(
                f"coordinates = {listed}: they are functions of time, as y1, y2 = dynamicsymbols('y1 y2') of "
                "sympy.physics.mechanics"
            )
        names, (time,) = tuple(each.func.__name__ for each in listed), times.pop()
        places, rates = ([sympy.Dummy(name, real=True) for name in names] for _ in range(2))
        symbols = {each.diff(time): rate for each, rate in zip(listed, rates, strict=True)}
        symbols |= dict(zip(listed, places, strict=True))
        return cls(sympy, names, tuple(places), tuple(rates), symbols, time)

    def checked(self, expression: Any, what: str, speeds: bool = False, own: Collection[str] = ()) -> Any:
        """An expression in the symbols of places and rates, with names of its `own` in addition to parameters; raises
        `InputError` where it has anything else that depends on time, and speeds where it must not."""
        try:
            inner = self.sympy.sympify(expression, strict=True).doit().xreplace(self.symbols)
        except (AttributeError, TypeError, self.sympy.SympifyError):
            raise InputError(f"{what} = {expression!r} is not an expression of SymPy") from None
        if getattr(inner, "shape", None) == (1, 1):  # as of q.T * M * q
            inner = inner[0, 0]
        if not isinstance(inner, self.sympy.Expr) or inner.is_Matrix:
            text = " ".join(abridged(expression).split())
            raise InputError(f"{what} = {text} is not a scalar expression of SymPy")
        undefined = inner.atoms(self.sympy.Derivative, self.sympy.core.function.AppliedUndef)
        for each in sorted(undefined, key=self.sympy.default_sort_key):
            known, name = ", ".join(self.names), each.xreplace(self._named)
            raise InputError(
                f"{what} has {name}, which is not a coordinate or the speed of one; coordinates are {known}"
            )
        if inner.has(self.sympy.nan, self.sympy.oo, self.sympy.zoo):
            raise InputError(f"{what} = {abridged(inner.xreplace(self._named))} is not finite")
        if self.time in inner.free_symbols:
            raise InputError(f"{what} depends on time {self.time} itself, but a machine must be autonomous")
        if not speeds and (moving := [name for name, v in zip(self.names, self.rates, strict=True) if inner.has(v)]):
            raise InputError(
                f"{what} depends on the speed of {moving[0]}: it must be a function of the coordinates alone"
            )
        for symbol in inner.free_symbols - {*self.places, *self.rates}:
            name = name_of_parameter(symbol)
            if name in own:
                continue
            if name in self.names:
                raise InputError(f"{what} has a symbol and a coordinate that are both called {name}: rename the symbol")
            if self.found.setdefault(name, symbol) != symbol:
                raise InputError(f"{what} has two symbols '{name}' with different assumptions: make one of them")
        return inner.xreplace({each: self.real(each) for each in inner.free_symbols})

    def real(self, symbol: Any) -> Any:
        """The symbol of a parameter as a real number, for derivatives of abs and the like."""
        return symbol if symbol.is_real is not None else self.sympy.Symbol(symbol.name, real=True)

    @property
    def _named(self) -> dict[Any, Any]:
        """Plain symbols by those of places and rates, for messages."""
        named = {y: self.sympy.Symbol(name) for y, name in zip(self.places, self.names, strict=True)}
        return named | {v: self.sympy.Symbol(f"{name}'") for v, name in zip(self.rates, self.names, strict=True)}

    def formula(self, expression: Any, what: str, **others: Any) -> str:
        """The formula of an expression in the symbols of places."""
        names = dict(zip(self.places, self.names, strict=True)) | {symbol: name for name, symbol in others.items()}
        self.used.update(str(each) for each in self.sympy.sympify(expression).free_symbols - names.keys())
        return formula_of(expression, names, what)

    def plain(self, value: Any, what: str, own: Collection[str] = ()) -> Any:
        """A statement without SymPy: expressions as formulas, which may have names of their `own` in addition to
        parameters, numbers as floats, symbols and coordinates in mappings by their names."""
        if isinstance(value, Mapping):
            return {self.plain(name, what, own): self.plain(each, what, own) for name, each in value.items()}
        if isinstance(value, list | tuple):
            return type(value)(self.plain(each, what, own) for each in value)
        if isinstance(value, Element | Ground | Body | Joint | Outline | Drawing):
            own = NAMES_BESIDE.get(type(value), ())
            return replace(
                value, **{each.name: self.plain(getattr(value, each.name), what, own) for each in fields(value)}
            )
        if not isinstance(value, self.sympy.Basic):
            return value
        return float(value) if value.is_Number else self.formula(self.checked(value, what, own=own), what)

    def inertia(self, T: Any) -> list[list[Any]]:
        """The matrix M (n, n) of T = v' M v/2; raises `InputError` for another T."""
        still = dict.fromkeys(self.rates, 0)
        slopes = [self.sympy.diff(T, v) for v in self.rates]
        beside = [T.subs(still), *(slope.subs(still) * v for slope, v in zip(slopes, self.rates, strict=True))]
        rows = [[self._simple(self.sympy.diff(slope, v)) for v in self.rates] for slope in slopes]
        remedy = "T is v'M v/2, a sum of products of two speeds"
        for part in beside:
            if self._simple(part) != 0:
                term = abridged(part.xreplace(self._named))
                raise InputError(f"T must be quadratic in the speeds, but it has '{term}': {remedy}")
        for entry in (entry for row in rows for entry in row):
            if entry.has(*self.rates):
                mass = abridged(entry.xreplace(self._named))
                raise InputError(f"T is not quadratic in the speeds, with the mass '{mass}': {remedy}")
        return [[rows[max(i, j)][min(i, j)] for j in range(len(rows))] for i in range(len(rows))]

    def elements(self, V: Any, gravity: str, in_si: bool) -> tuple[list[Element], bool]:
        """The elements whose potential energy is V, and whether gravity of this name pulls at them."""
        g = self.found.get(gravity)
        g = None if g is None else self.real(g)
        pulled = g is not None and V.has(g)
        found: list[Element] = []
        if pulled:
            by_gravity = self.sympy.diff(V, g)
            if self._simple(self.sympy.diff(by_gravity, g)) != 0:
                raise InputError(
                    f"V is not linear in gravity '{gravity}': a weight is {gravity} times a mass and a height"
                )
            found += [self._weight(term) for term in self.sympy.Add.make_args(by_gravity) if term.has(*self.places)]
            V = V.subs(g, 0)
        steady = [term for term in self.sympy.Add.make_args(V) if self._is_steady(term)]
        laws, left = self._along_sums(V - sum(steady))
        if pulled or not in_si:  # else what pulls has no mass in kg
            found += [self._weight(term / (g if pulled else 1)) for term in steady if term.has(*self.places)]
        else:
            left += sum(steady)
        counting = sorted(laws, key=lambda way: not all(weight.is_Number for weight in way))  # families by the first
        springs: list[Element] = [self._spring(way, laws[way]) for way in counting]
        return [*springs, *([] if left == 0 else [Potential(self.formula(left, "V"))]), *found], pulled

    def _is_steady(self, energy: Any) -> bool:
        """Whether an energy is that of a force that does not depend on the place."""
        return not any(self.sympy.diff(energy, y).has(*self.places) for y in self.places)

    def _along_sums(self, energy: Any) -> tuple[dict[tuple, Any], Any]:
        """An energy as functions of sums of coordinates, by these, and the rest.

        Its terms are taken as they are written. Where some are not such functions, products are multiplied out, and
        those with one parameter before them are taken together, as k y1**2/2 - k y1 y2 + k y2**2/2.
        """
        terms = self.sympy.Add.make_args(energy)
        if any(self._way(term) is None for term in terms):
            groups, plain = dict[Any, Any](), [term for term in terms if sum(map(bool, self._way(term) or ())) > 1]
            for term in self.sympy.Add.make_args(self.sympy.expand(energy - sum(plain))):
                before = term.as_independent(*self.places, as_Add=False)[0].as_coeff_Mul()[1]
                groups[before] = groups.get(before, 0) + term
            terms = plain
            for group in groups.values():
                terms += [group] if self._way(group) is not None else self.sympy.Add.make_args(group)
        laws, left = dict[tuple, Any](), self.sympy.S.Zero
        for term in terms:
            way = self._way(term)
            if way is None:
                left += term
            elif any(way):
                laws[way] = laws.get(way, 0) + term
        return laws, left

    def _way(self, energy: Any) -> tuple | None:
        """The numbers before the coordinates in the sum on which an energy depends, the first being 1; None for an
        energy that is not a function of such a sum, zeros for one that does not vary."""
        slopes = [self.sympy.diff(energy, y) for y in self.places]
        first = next((slope for slope in slopes if slope != 0), None)
        if first is None:
            return (0,) * len(slopes)
        ratios = tuple(slope if slope == 0 else self.sympy.simplify(slope / first) for slope in slopes)
        return ratios if all(ratio.is_number for ratio in ratios) else None

    def _spring(self, way: tuple, energy: Any) -> Spring:
        """The spring along a sum of coordinates with this energy; its extension counts from where it is unloaded, if
        that is a number that a sum in the force has, or a quotient of a straight line."""
        r = self.sympy.Dummy(ALONG, real=True)
        first = next(y for y, weight in zip(self.places, way, strict=True) if weight != 0)
        along = sum(weight * y for weight, y in zip(way, self.places, strict=True))
        force = self.sympy.diff(energy.subs({y: r if y is first else 0 for y in self.places}, simultaneous=True), r)
        rests = [each - r for each in force.atoms(self.sympy.Add) if each.diff(r) == 1]
        slope = self._simple(self.sympy.diff(force, r))
        rests += [force.subs(r, 0) / slope] if slope != 0 and not slope.has(r) else []
        rests = sorted((-each for each in rests if not each.has(r)), key=self.sympy.default_sort_key)
        rests = [self.sympy.S.Zero, *rests]
        rest = next((each for each in rests if self._simple(force.subs(r, each)) == 0), rests[0])
        shifted = force.subs(r, r + rest)
        simpler = self._simple(shifted)  # has cases where signs meet, which formulas do not have
        force = force if rest == 0 else shifted if simpler.has(self.sympy.Piecewise) else simpler
        if ALONG in {*self.names, *(str(each) for each in force.free_symbols - {r})}:
            raise InputError(f"'{ALONG}' is the extension in a spring's law; rename the symbol or the coordinate")
        return Spring(self.formula(along - rest, "V"), self.formula(force, "V", **{ALONG: r}))

    def _weight(self, term: Any) -> Weight:
        """The weight with this energy under gravity of 1."""
        mass, height = term.as_independent(*self.places, as_Add=False)
        if mass.could_extract_minus_sign():
            mass, height = -mass, -height
        return Weight(self.formula(height, "V"), self.formula(mass, "V"))

    def _simple(self, expression: Any) -> Any:
        """An expression simplified, so that what is 0, and what does not depend on the coordinates, is seen."""
        return self.sympy.simplify(expression)


def _refuse_singular(
    rows: Sequence[Sequence[Any]], names: Sequence[str], p: Mapping[str, Any], rest: Mapping[str, Any]
) -> None:
    """Raise `InputError` for an inertia that is not positive definite at rest."""
    for name, place in rest.items():
        if not isinstance(place, str | Real) and not callable(place):
            raise InputError(f"rest: {place!r} is neither a formula nor a number")
        if isinstance(place, Real) and not np.isfinite(as_array_or_nan(place)):
            raise InputError(f"rest: '{name}' must be a finite number")
        if missing := sorted(names_in(place) - p.keys()):
            raise InputError(f"rest: '{missing[0]}' has no value: give it one in parameters={suggest(missing[0], p)}")
    at = {name: float(value_of(rest.get(name, 0.0), {}, p)) for name in names}
    matrix = np.array([[float(value_of(entry, at, p)) for entry in row] for row in rows])
    place = ", ".join(f"{name} = {value:g}" for name, value in at.items())
    if not np.isfinite(matrix).all():
        raise InputError(f"T has no finite value where {place}: state where the machine rests, rest=...")
    values, vectors = np.linalg.eigh(matrix)
    if not values[0] > REGULAR * values[-1]:
        name = names[int(np.argmax(abs(vectors[:, 0])))]
        raise InputError(
            f"the masses of T are not positive: the least eigenvalue of their matrix is {values[0]:.3g} where {place}; "
            f"give {name} a mass above 0 in T" + ("" if rest else ", or state where the machine rests, rest=...")
        )
