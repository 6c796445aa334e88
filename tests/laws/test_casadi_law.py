"""Functions of CasADi as laws, against the same laws as formulas, and what is refused of them."""

import math

import casadi as ca
import numpy as np
import pytest

from orbits import InputError, Mechanism, Orbit, find, follow, sweep
from orbits.laws.law_statement import from_any
from orbits.mechanics import Mass, Spring
from problems import Hopper, springs

r, b = ca.SX.sym("r"), ca.SX.sym("b")
x = ca.MX.sym("x")
CUBIC = ca.Function("cubic", [r, b], [r + b * r**3], ["r", "b"], ["force"])
SATURATING = ca.Function("saturating", [r, b], [ca.erf(b * r) * math.sqrt(math.pi) / (2 * b)], ["r", "b"], ["force"])


def test_a_short_function_is_a_formula():
    law = springs.function(CUBIC, b=0.3)
    assert law.written.formulas == (law.text,) == ("r + b*(r*r**2)",)
    assert find(Hopper(CUBIC, parameters={"b": 0.3})).alpha == pytest.approx(find(Hopper("cubic")).alpha, rel=1e-14)
    everything = ca.Function("all", [r, b], [
        -(ca.tanh(r) * ca.exp(-b)) / (2 + r * r) + 1 / (3 + r) - ca.sqrt(1 + r**2) ** b + 2 * r - ca.fabs(r) + 0.1 * r
    ], ["r", "b"], ["force"])  # fmt: skip
    law = springs.function(everything, b=0.7)
    places = np.linspace(-2, 2, 9)
    assert law.written is not None
    assert law(places) == pytest.approx([float(everything(each, 0.7)) for each in places], rel=1e-14)


def test_a_function_that_formulas_do_not_have(tmp_path):
    """It is found, followed and swept like any law, with slopes by CasADi; a file of its orbit needs the machine."""
    machine = Hopper(SATURATING, parameters={"b": 0.2})
    places = np.array([0.3, -1.7])
    value, slope = machine.spring.with_slope(places)
    assert value == pytest.approx([math.erf(0.2 * each) * math.sqrt(math.pi) / 0.4 for each in places], rel=1e-14)
    assert slope == pytest.approx(np.exp(-((0.2 * places) ** 2)), rel=1e-14)
    orbit = find(machine)
    traced = find(Hopper(lambda r, b: SATURATING(r, b), parameters={"b": 0.2}))
    assert orbit.alpha == pytest.approx(traced.alpha, rel=1e-13)
    family = follow(machine, "b", 0.21)
    assert family.end.kind == "reached"
    members = sweep(machine, {"b": [0.2, 0.21]}).table()
    assert list(members["alpha"]) == pytest.approx([orbit.alpha, family.points[-1].alpha], rel=1e-12)
    assert Orbit.load(orbit.save(tmp_path / "hop.json"), machine) == orbit


def test_gravity_and_mechanisms():
    z, radius = ca.SX.sym("z"), ca.SX.sym("R")
    gravity = ca.Function("gravity", [z, radius], [1 / (1 + z / radius) ** 2], ["z", "R"], ["g"])
    law = from_any(gravity, "z", {"R": 150.0}, {}, "gravity")
    assert (law.variable, law.text) == ("z", "1/(1 + z/R)**2")
    masses = [Mass("body", 1.0), Mass("foot", 1.0)]
    own = [
        Mechanism(("body", "foot"), [*masses, Spring("body - foot", force)], gap="foot", parameters={"b": 0.3})
        for force in (CUBIC, "r + b*r**3")
    ]
    assert find(own[0]).alpha == pytest.approx(find(own[1]).alpha, rel=1e-14)


def test_branches_need_breakpoints():
    """A spring twice as stiff in compression, as CasADi's switch and as the law in pieces of a formula."""
    stiff = ca.Function("stiff", [r], [ca.if_else(r > 0, r, 2 * r)])
    with pytest.raises(InputError, match=r"'stiff' has branches \(if_else_zero, lt, not\): state where .* breakpoints"):
        Hopper(stiff)
    law = springs.function(stiff, breakpoints=(0.0,))
    assert law(np.array([-1.0, 2.0])).tolist() == [-2.0, 2.0]
    assert law.corners() == [0.0]
    for jumping in (ca.floor(r), ca.fmax(r, 0), ca.fmod(r, 2)):
        with pytest.raises(InputError, match="has branches"):
            springs.function(ca.Function("jumping", [r], [r + jumping]))


def test_a_function_too_long_for_a_formula():
    long = r
    for _ in range(8):
        long = long + ca.sin(long) * long / 50
    law = springs.function(ca.Function("long", [r], [long]))
    assert (law.text, law.written) == ("long", None)
    assert law(0.7) == pytest.approx(float(ca.Function("long", [r], [long])(0.7)), rel=1e-15)


class Wrapped(ca.Callback):
    """A Python function that CasADi cannot see into."""

    def __init__(self):
        super().__init__()
        self.construct("wrapped", {})

    def eval(self, arguments):
        return arguments


def rejected():
    """Functions with what the message says of each."""
    pair, table = ca.SX.sym("pair", 2), ca.interpolant("table", "bspline", [[0.0, 1, 2, 3, 4]], [0.0, 1, 2, 4, 8])
    yield ca.Function("f", [pair], [pair[0]]), "a function of i0 2x1; its arguments must be numbers"
    yield ca.Function("f", [], [ca.SX(1)]), "a function of nothing"
    yield ca.Function("f", [r], [r, r]), "returns 1x1, 1x1; a law must return one number"
    yield ca.Function("f", [r], [ca.vertcat(r, r)]), "returns 2x1"
    yield ca.Function("f", [r], [ca.SX(1, 1)]), "returns a result without entries"
    yield ca.Function("f", [r], [r * b], {"allow_free": True}), "has free variables, b"
    yield ca.Function("f", [r, b], [r * b], ["r", "exp"], ["force"]), "an argument 'exp', which has a meaning"
    yield CUBIC, "needs a value for 'b'"
    yield (
        ca.Function("f", [x], [table(x)]),
        "calls table, which cannot be written in scalar operations: .* springs.table",
    )
    yield Wrapped(), "has call, which cannot be written in scalar operations"
    yield ca.Function("f", [r], [ca.erfinv(r)]), "has erfinv"
    yield ca.Function("f", [r], [ca.sin(r) / r]), "0/0 at r = 0"


@pytest.mark.parametrize(("function", "message"), [*rejected()])
def test_what_is_refused(function, message):
    with pytest.raises(InputError, match=message):
        springs.function(function)
