"""Machines without a gap, which oscillate."""

from orbits import Mechanism
from orbits.mechanics import Mass, Potential, Spring


def duffing(**parameters: float) -> Mechanism:
    """The oscillator u'' + u + b u**3 = 0."""
    return Mechanism(
        ("u",), [Spring("u", "r + b*r**3")], gap=None, inertia={"u": 1.0}, parameters={"b": 1.0, **parameters}
    )


def henon_heiles() -> Mechanism:
    """The system of Henon and Heiles."""
    energy = "(x**2 + y**2)/2 + x**2*y - y**3/3"
    return Mechanism(("x", "y"), [Potential(energy)], gap=None, inertia={"x": 1.0, "y": 1.0})


def pendulum(**stated: object) -> Mechanism:
    """A pendulum in SI."""
    bob = Mass("-L*cos(q)", "m", across="L*sin(q)")
    own = {"parameters": {"m": 2.0, "L": 0.5}, "gravity": 9.80665, "angles": ("q",), "in_si": True, **stated}
    return Mechanism(("q",), [bob], gap=None, **own)


def double_pendulum() -> Mechanism:
    """Two equal pendulums, one below the other, of length, mass and gravity 1."""
    masses = [Mass("-cos(a)", 1.0, across="sin(a)"), Mass("-cos(a) - cos(b)", 1.0, across="sin(a) + sin(b)")]
    return Mechanism(("a", "b"), masses, gap=None, angles=("a", "b"))


def chain_of_carts(*stiffnesses: float) -> Mechanism:
    """Carts of mass 1 between walls, on springs: a chain of these stiffnesses."""
    carts = tuple(f"x{i}" for i in range(1, len(stiffnesses)))
    pairs = zip(("", *carts), (*carts, ""), stiffnesses, strict=True)
    springs = [Spring(f"{b} - {a}" if a and b else a or b, f"{k}*r") for a, b, k in pairs]
    return Mechanism(carts, springs, gap=None, inertia=dict.fromkeys(carts, 1.0))
