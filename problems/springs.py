"""Spring laws: force phi(r) against extension r, tension positive, stiffness 1 at rest where nothing else is said.

Lengths are in units of the foot's weight over the stiffness, forces in the foot's weight (hopper), or of the hand's
(juggler); of a machine stated in SI, in m and N. Each named law is a function of its parameters, whose units follow
from these: `beta` is 1/length**2, `delta` 1/length**4, `a` and `b` are 1/length, `gap`, `length`, `height` and
`thickness` lengths, `k`, `ratio` and `stop` stiffnesses. `NAMED` lists the laws for the command line.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from orbits.errors import InputError

from . import laws
from .laws import Law, number
from .spring_tables import checked_pairs, quintic_pieces, read_table


def formula(text: str, /, **parameters: float) -> Law:
    """A spring from a formula of the extension r: ``formula("r + beta*r**3", beta=0.3)``."""
    return laws.from_formula(text, "r", parameters)


def potential(text: str, /, **parameters: float) -> Law:
    """A spring from its potential energy V(r); the force is dV/dr."""
    return laws.from_potential(text, "r", parameters)


def function(force: Callable, /, breakpoints: tuple[float, ...] = (), **parameters: float) -> Law:
    """A spring from a Python function force(r, **parameters), smooth between the breakpoints.

    State where it jumps or bends: integration steps end there, and derivatives are carried across a jump.
    """
    return laws.from_function(force, "r", parameters, breakpoints)


def linear(*, k: float = 1.0) -> Law:
    """Hooke's law k r: metal springs in small strain (Hooke 1678)."""
    number("k", k, low=0)
    return formula("r") if k == 1 else formula("k*r", k=k)


def cubic(*, beta: float = 0.3) -> Law:
    """Duffing's spring r + beta r**3: hardening for beta > 0, softening for beta < 0 (Duffing 1918)."""
    return formula("r + beta*r**3", beta=beta)


def quintic(*, beta: float = 0.0, delta: float = 0.1) -> Law:
    """Spring r + beta r**3 + delta r**5, softening first and hardening then, or inversely (Nayfeh and Mook 1979)."""
    return formula("r + beta*r**3 + delta*r**5", beta=beta, delta=delta)


def tanh(*, b: float = 0.2) -> Law:
    """Saturating spring tanh(b r)/b: at most 1/b, a smooth elastic, perfectly plastic curve (Hill 1950)."""
    number("b", b, low=0)
    return formula("tanh(b*r)/b", b=b)


def sinh(*, b: float = 0.5) -> Law:
    """Hardening spring sinh(b r)/b, exponentially stiff both ways, as in Eyring's theory of flow (1936)."""
    number("b", b, low=0)
    return formula("sinh(b*r)/b", b=b)


def toda(*, b: float = 0.2) -> Law:
    """Toda's lattice spring (1 - exp(-b r))/b (1967): hard in compression, at most 1/b in tension; b < 0 reverses."""
    if number("b", b) == 0:
        raise InputError("b = 0 makes the Toda spring linear; use the law 'linear'")
    return formula("(1 - exp(-b*r))/b", b=b)


def morse(*, a: float = 0.05) -> Law:
    """Morse's bond (1 - exp(-a r)) exp(-a r)/a: the tension has its maximum 1/(4 a) and then falls (Morse 1929)."""
    number("a", a, low=0)
    return formula("(1 - exp(-a*r))*exp(-a*r)/a", a=a)


def bilinear(*, ratio: float = 3.0, gap: float = 0.5) -> Law:
    """Stiffness 1 up to the extension `gap`, `ratio` beyond: a second spring picked up (Shaw and Holmes 1983)."""
    number("ratio", ratio, low=0)
    number("gap", gap, low=0)
    return Law("bilinear", "r", _line_expression, {"ratio": ratio, "gap": gap}, (3, _bilinear_pieces))


def end_stops(*, gap: float = 3.0, stop: float = 20.0) -> Law:
    """Stiffness 1 between extensions -gap and gap, `stop` beyond: bump stop and strap (Shaw and Holmes 1983)."""
    number("gap", gap, low=0)
    number("stop", stop, low=0)
    return Law("end_stops", "r", _line_expression, {"gap": gap, "stop": stop}, (3, _end_stop_pieces))


def air(*, length: float = 5.0, exponent: float = 1.4) -> Law:
    """Air spring: a gas column of effective length `length`, compressed polytropically with `exponent`.

    (length/exponent) (1 - (1 + r/length)**-exponent), the change of the force p A (V0/V)**n from rest (Bachrach and
    Rivin 1983); exponent 1 is slow (isothermal), 1.4 fast (adiabatic) air. Tension stays below length/exponent.
    """
    number("length", length, low=0)
    number("exponent", exponent, low=0)
    return formula("length/exponent*(1 - (1 + r/length)**(-exponent))", length=length, exponent=exponent)


def belleville(*, height: float = 4.0, thickness: float = 4.0) -> Law:
    """Belleville washer after Almen and Laszlo (1936), held at both rims so that it can also be pulled.

    With deflection -r, cone height h and thickness t: r ((h + r)(h + r/2) + t**2)/(h**2 + t**2), stiffness 1 at rest.
    Where h/t exceeds sqrt(2) the washer snaps through in compression.
    """
    number("height", height, low=0)
    number("thickness", thickness, low=0)
    text = "r*((height + r)*(height + r/2) + thickness**2)/(height**2 + thickness**2)"
    return formula(text, height=height, thickness=thickness)


def rubber(*, length: float = 10.0) -> Law:
    """Neo-Hookean strip of rest length `length` in uniaxial tension (Treloar 1975).

    (length/3) (s - s**-2) with stretch s = 1 + r/length; stiffness 1 at rest, singular where the strip has no length.
    """
    number("length", length, low=0)
    return formula("length/3*((1 + r/length) - (1 + r/length)**(-2))", length=length)


def table(source: str | Path | tuple[ArrayLike, ArrayLike], *, in_si: bool = False) -> Law:
    """A spring from measured pairs: a CSV file with a header, or (extensions, forces) as two sequences.

    The header names one column of `spring_tables.EXTENSION_NAMES` and one of `spring_tables.FORCE_NAMES`, tension and
    extension positive; under `compression` both are counted the other way. In SI a unit after the name (mm, kN) is
    converted to m and N; a dimensionless machine takes the numbers as they stand. The rows may have any order, and the
    forces at repeated extensions are averaged.

    The law is the C2 cubic spline, as a quintic Hermite interpolant whose slopes and curvatures are cut back where the
    spline would overshoot: between rows the force is monotone, and the whole is twice differentiable. Outside the table
    there is no force: an orbit that needs one is refused with the range. Raises `InputError` for a table that cannot be
    read or interpolated.
    """
    label = Path(source).name if isinstance(source, str | Path) else "table"
    pairs = read_table(Path(source), in_si) if isinstance(source, str | Path) else source
    grid, forces = checked_pairs(pairs, label)
    data = quintic_pieces(grid, forces)

    def expression(x, p, q):
        value = 0
        for coefficient in reversed(q[1:]):
            value = value * (x - q[0]) + coefficient
        return value

    return Law(f"table:{label}", "r", expression, {}, (7, lambda p: (grid.tolist(), data.tolist())))


NAMED = {
    law.__name__: law
    for law in (linear, cubic, quintic, tanh, sinh, toda, morse, bilinear, end_stops, air, belleville, rubber)
}


def as_spring(law: Any, given: Mapping[str, float] | None = None, in_si: bool = False) -> Law:
    """A spring from a law, a formula, a law's name, "table:FILE", "potential:FORMULA" or a Python function, with those
    of the given parameters that it takes."""
    kind, colon, rest = law.partition(":") if isinstance(law, str) else ("", "", "")
    if not (colon and kind in ("table", "potential")):
        return laws.from_any(law, "r", given, NAMED, "a spring")
    parameters = laws.own_parameters(law, "r", NAMED, given)
    if not rest.strip():
        raise InputError(f"spring '{law}' names no {'file' if kind == 'table' else 'formula'} after the colon")
    return table(rest, in_si=in_si) if kind == "table" else potential(rest, **parameters)


def _line_expression(x, p, q):
    start, force, stiffness = q
    return force + stiffness * (x - start)


def _bilinear_pieces(p):
    return [-math.inf, p["gap"], math.inf], [[0.0, 0.0, 1.0], [p["gap"], p["gap"], p["ratio"]]]


def _end_stop_pieces(p):
    gap, stop = p["gap"], p["stop"]
    return [-math.inf, -gap, gap, math.inf], [[-gap, -gap, stop], [0.0, 0.0, 1.0], [gap, gap, stop]]
