"""Wheel, rocker and shuttle written by hand, and their closed forms for straight lines.

Time in sqrt(J/k), mu = J/A, kappa = M g l/k; without an angle the linearised machines in units of it. Coordinates are
counted from the closed gap: theta is the angle that has opened, phi that of the inner body.
"""

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from orbits import Mechanism
from orbits.mechanics import Potential, Spring
from orbits.model import Affine, Model, Phase

STATES = ("phi", "phi'", "theta", "theta'")
# mu, kappa, family -> half flight S, launch speed v over a (or b/h), whole contact.
WHEELS = {
    (1.0, 0.5, 1): (2.121296681535578, 1.166426907629781, 0.80993241436553),
    (1.0, 0.5, 2): (4.429839732203949, 0.961020776943322, 0.95947951994663),
    (0.2, 0.5, 1): (2.726470676846290, 2.608559871631617, 0.37875934612040),
}
ROCKERS = {
    (1.0, 0.5, 1): (3.230912484535146, 0.884056118603061, 1.02944452446783),
    (1.0, 0.5, 2): (5.600913401568130, 0.938628209747397, 0.97891620502864),
    (0.2, 0.5, 1): (4.042648844862001, 1.420948094958247, 0.67669331177531),
}
SHUTTLES = {(1.0, 0.5, 1): (2.121296681535578, 1.166426907629781, 3.95152506795532)}
TABLE = {"wheel": WHEELS, "rocker": ROCKERS, "shuttle": SHUTTLES}
# kind, law, family -> v, S, whole contact with the sine, mu = 1, kappa = 0.5, angle 0.3: by other integrators.
SINES = {
    ("wheel", "r", 1): (0.349144090286584708, 2.12361479955147, 0.80070137977167),
    ("wheel", "r", 2): (0.287062754278098419, None, 0.950725704274436823),
    ("wheel", "r + r**3", 1): (0.354514451501611334, 2.02677297697251, 0.774709720346572439),
    ("shuttle", "r", 1): (0.349144090286584708, 2.12361479955147, 3.94229403336145991),
    ("rocker", "r", 1): (0.270673010467295362, 3.234113708127885, 1.038280158520387556),
}


def closed_form(kind: str, mu: float, kappa: float, family: int) -> tuple[float, float, float]:
    """Half flight S, launch speed and whole contact of the linearised machine."""
    p, q = rates(mu, kappa)
    c = p * p * q * q / (mu * (p * p + q * q))
    if kind == "rocker":
        low, high = family * math.pi / q, (family + 0.5) * math.pi / q
        half = brentq(lambda s: p * math.sin(q * s) - q * math.tanh(p * s) * math.cos(q * s), low, high, xtol=1e-15)
        speed = c * (p * math.tanh(p * half) + q * math.tan(q * half))
    else:
        low, high = (family - 0.5) * math.pi / q, family * math.pi / q
        half = brentq(lambda s: q * math.sin(q * s) + p * math.tanh(p * s) * math.cos(q * s), low, high, xtol=1e-15)
        speed = c * (p / math.tanh(p * half) - q / math.tan(q * half))
    return half, speed, 2 * math.atan(kappa / speed) + (math.pi if kind == "shuttle" else 0.0)


def rates(mu: float, kappa: float) -> tuple[float, float]:
    """p and q, with p^2 and -q^2 the eigenvalues of the flight."""
    trace, product = mu * kappa - 1 - mu, -mu * kappa
    root = math.sqrt(trace * trace - 4 * product)
    return math.sqrt((trace + root) / 2), math.sqrt((root - trace) / 2)


def lifting(law: str, level: float) -> float:
    """The extension at which the spring has a torque."""
    return level if law == "r" else brentq(lambda r: r + r**3 - level, -10.0, 10.0, xtol=1e-16)


def by_hand(kind: str, law: str = "r", sine: bool = False):
    """A machine of protocol, kind "wheel", "rocker" or "shuttle", as a function of mu, kappa and the angle."""
    odd = kind != "rocker"

    def torque(r):
        return r + r**3 if law == "r + r**3" else r

    def weight(theta, p):
        """The torque of gravity on the machine at theta over k."""
        kappa, angle = p["kappa"], p["angle"]
        if odd:
            return kappa * (ca.sin(theta - angle) if sine else theta - angle)
        return kappa * (ca.sin(theta) - ca.tan(angle) * ca.cos(theta) if sine else theta - angle)

    def flight(x, p, q):
        phi, rate, theta, turn = x
        t = torque(phi - theta)
        return [rate, -t, turn, p["mu"] * (weight(theta, p) + t)]

    def contact(x, p, q):
        return [x[1], -torque(x[0])]

    def at_rest(p):
        return -weight(0.0, p)

    watch = {"contact force": lambda x, p, q: at_rest(p) - torque(x[0])}
    if kind != "shuttle":
        watch["contact force of the landed point"] = lambda x, p, q: at_rest(p) + torque(x[0])
    twice = lambda p: [2 * p["angle"], 0.0, 2 * p["angle"], 0.0]  # noqa: E731
    back = lambda p: [-2 * p["angle"], 0.0, -2 * p["angle"], 0.0]  # noqa: E731
    relabelled = {
        "wheel": {"symmetry": (1, 1, 1, 1), "symmetry_shift": back},
        "rocker": {"symmetry": (-1, -1, -1, -1)},
        "shuttle": {"symmetry": (-1, -1, -1, -1), "symmetry_shift": twice},
    }[kind]
    if odd:
        relabelled |= {
            "reversor_shift": twice,
            "landing_gap": lambda p: Affine((0.0, 0.0, -1.0, 0.0), 2 * p["angle"]),
        }
    model = Model(
        name=kind,
        flight=Phase("flight", STATES, flight),
        contact=Phase("contact", STATES[:2], contact, watch),
        reversor=(-1, 1, -1, 1) if odd else (1, -1, 1, -1),
        release=lambda alpha, p: np.full(np.shape(alpha), lifting(law, float(at_rest(p)))),
        embed=np.eye(4, 2),
        flight_gradient=lambda x, p, q: [
            torque(x[0] - x[2]), x[1], -torque(x[0] - x[2]) - weight(x[2], p), x[3] / p["mu"],
        ],
        extension=Affine((1.0, 0.0, -1.0, 0.0)),
        gap=lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
        separation=lambda p: None,
        heights=lambda p: {"theta": Affine((0.0, 0.0, 1.0, 0.0)), "phi": Affine((1.0, 0.0, 0.0, 0.0))},
        impact_mass=lambda x, p: 1 / p["mu"],
        impact=lambda x, p: [0.0, 0.0, 0.0, 1.0],
        violations=dict.fromkeys(("gap", "pull", "separation", "end", "landing gap", "landed pull"), "it is no motion"),
        springs=(),
        **relabelled,
    )  # fmt: skip

    def at(mu: float, kappa: float, angle: float = 1.0):
        values = {"mu": mu, "kappa": kappa, "angle": angle}
        return SimpleNamespace(
            model=model, values=values, restitution=0.0, units=None, rest_length=None,
            describe=lambda: dict.fromkeys(("gravity", "mass_ratio", "rest_length"), None)
            | {"machine": kind, "spring": law, "restitution": 0.0, "parameters": values, "laws_in": "its units"},
            with_values=lambda **new: at(**{**values, **new}),
        )  # fmt: skip

    return at


def start_of(kind: str, mu: float, kappa: float, family: int, angle: float = 1.0, law: str = "r") -> dict[str, float]:
    """The unknowns of the linearised machine, with lift-off by the law and, for angles below 1, by the sine."""
    half, speed, contact = closed_form(kind, mu, kappa, family)
    lifts = {"wheel": math.sin, "shuttle": math.sin, "rocker": math.tan}[kind](angle) if angle < 1 else 1.0
    return {
        "liftoff": lifting(law, kappa * lifts),
        "alpha": speed * angle,
        "duration": half,
        "contact_duration": contact / 2,
    }


def stepping(
    kind: str, mu: float, kappa: float, angle: float | None = None, law: object = "r", **parameters: float
) -> Mechanism:
    """These machines as mechanisms, linearised without an angle."""
    a, energy = "angle", "kappa*cos(theta - angle)"
    if angle is None:
        a, energy = "1", "-kappa*(theta - 1)**2/2"
    turned, maps = {"theta": f"2*{a} - theta", "phi": f"2*{a} - phi"}, dict[str, dict[str, str]]()
    if kind == "rocker":
        energy = "kappa*(theta - theta**2/2)" if angle is None else "kappa*(cos(theta) + tan(angle)*sin(theta))"
        maps = {"symmetry": {"theta": "-theta", "phi": "-phi"}, "gaps": {"foot": "theta"}}
    else:
        step = {"theta": f"theta - 2*{a}", "phi": f"phi - 2*{a}"}
        feet = {"rear foot": "theta", "front foot": f"2*{a} - theta"}
        maps = {"reversor": turned, "symmetry": step if kind == "wheel" else turned, "gaps": feet}
    numbers = {"mu": mu, "kappa": kappa, **parameters} | ({} if angle is None else {"angle": angle})
    return Mechanism(
        ("phi", "theta"), [Spring("phi - theta", law), Potential(energy)], name=kind,
        inertia={"phi": 1.0, "theta": "1/mu"}, parameters=numbers, **maps,
    )  # fmt: skip
