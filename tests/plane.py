"""Wheel and rocker with masses in the plane: of the inertia A = 1/mu about the foot, M l^2 (M h^2 of the rocker) is a
share, with k = J = 1."""

import math

import numpy as np

from orbits import Mechanism
from orbits.mechanics import Mass, Potential, Spring

MAPS = {
    "wheel": {
        "reversor": {"theta": "2*a - theta", "phi": "2*a - phi"},
        "symmetry": {"theta": "theta - 2*a", "phi": "phi - 2*a"},
        "gaps": {"rear foot": "theta", "front foot": "2*a - theta"},
    },
    "rocker": {"symmetry": {"theta": "-theta", "phi": "-phi"}, "gaps": {"foot": "theta"}},
}


def wheel(mu: float = 1.0, kappa: float = 0.5, a: float = 0.3, share: float = 1.0, law: str = "r", **other: object):
    """With the sine, l = 1."""
    numbers = {"mu": mu, "kappa": kappa, "a": a, "share": share}
    return Mechanism(
        ("phi", "theta"),
        [Spring("phi - theta", law), Mass("cos(theta - a)", "share/mu", across="sin(theta - a)")],
        inertia={"phi": 1.0, "theta": "(1 - share)/mu"}, gravity="kappa*mu/share", angles=("phi", "theta"),
        heights={"hub": "cos(theta - a)"}, parameters=numbers, name="wheel", **MAPS["wheel"], **other,
    )  # fmt: skip


def rocker(mu: float = 1.0, kappa: float = 0.5, a: float = 0.3, share: float = 0.9, **other: object):
    """With the sine, h = 1 and b = tan a."""
    numbers = {"mu": mu, "kappa": kappa, "b": math.tan(a), "m": share / mu}
    height, across = "cos(theta) + b*sin(theta)", "sin(theta) - b*cos(theta)"
    return Mechanism(
        ("phi", "theta"), [Spring("phi - theta"), Mass(height, "m", across=across)],
        inertia={"phi": 1.0, "theta": "1/mu - m*(1 + b**2)"}, gravity="kappa/m", angles=("phi", "theta"),
        parameters=numbers, name="rocker", **MAPS["rocker"], **other,
    )  # fmt: skip


def linear(kind: str, mu: float, kappa: float, share: float = 1.0, **other: object):
    """The linearised machines in units of the angle, of b/h."""
    energy = "-kappa*(theta - 1)**2/2" if kind == "wheel" else "kappa*(theta - theta**2/2)"
    maps = {what: {name: text.replace("2*a", "2") for name, text in of.items()} for what, of in MAPS[kind].items()}
    return Mechanism(
        ("phi", "theta"), [Spring("phi - theta"), Potential(energy), Mass("0", "share/mu", across="theta")],
        inertia={"phi": 1.0, "theta": "(1 - share)/mu"}, gravity="mu*kappa/share",
        parameters={"mu": mu, "kappa": kappa, "share": share}, name=kind, **maps, **other,
    )  # fmt: skip


def friction_by_formula(kind: str, mu: float, kappa: float, a: float | None, share: float, theta: np.ndarray,
                        rate: np.ndarray, change: np.ndarray) -> np.ndarray:  # fmt: skip
    """T/N on the standing foot, from the angle (..,), its rate and its acceleration."""
    c = share / (mu * kappa)
    if a is None:
        return c * change
    z = theta - a  # of the line from the foot to the centre of mass, from the vertical
    r = 1.0 if kind == "wheel" else 1 / math.cos(a)
    along = r * (np.cos(z) * change - np.sin(z) * rate**2)
    return c * along / (1 - c * r * (np.sin(z) * change + np.cos(z) * rate**2))
