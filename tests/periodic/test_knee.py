"""A machine whose inertia depends on its configuration: a body on a massless knee, hopping vertically.

Coordinates are the foot's height h and the knee's angle theta. Two links of length l join the foot to the hip, which
stays above it, at the height h + L with L(theta) = 2 l sin(theta / 2); a torsional spring of torque tau(theta) bends
the knee. With the kinetic energy (m1 (h' + L' theta')^2 + m2 h'^2) / 2 of body and foot, Lagrange's equations are

    (m1 + m2) h'' + m1 L' theta'' = -m1 L'' theta'^2 - (m1 + m2) g + lambda
    m1 L' h'' + m1 L'^2 theta''   = -m1 L' L'' theta'^2 - tau - m1 g L'

with the ground force lambda, 0 in flight and m2 g - tau / L' in contact, where h = 0. The determinant of the inertia
matrix is m1 m2 L'^2, and its inverse times the gradient (1, 0) of the gap h is (1, -1 / L') / m2: an impact changes
(h', theta') along (1, -1 / L'), which leaves the body's speed as it is, and its mass is m2.

The machine is stated in SI, and its launch speed is theta' at lift-off, in rad/s.
"""

import pickle
from dataclasses import asdict, dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import Orbit, ReturnMap, find, find_all, follow, multiplier, optimize, simulate, sweep
from orbits.errors import InputError, NoOrbit
from orbits.model.model import Model, Search
from orbits.model.phase import Affine, Phase
from orbits.model.state_formula import StateFormula
from orbits.model.units import Units
from orbits.symbolic.formula import parse
from problems import hopper_in_si

SI = Units(1.0, 1.0, 1.0, 1.0, ("theta", "liftoff"))
LEG, BODY = "2*link*sin(theta/2)", "h + 2*link*sin(theta/2)"
STATES = ("h", "h'", "theta", "theta'")
COSINE_AND_SINE = parse("cos(half)"), parse("sin(half)")  # of numbers, arrays and expressions alike


def torque(theta, p):
    """tau(theta)."""
    return p["stiffness"] * (theta - p["rest_angle"])


def slopes(theta, p):
    """L' and L''."""
    cosine, sine = (function(half=theta / 2) for function in COSINE_AND_SINE)
    return p["link"] * cosine, -p["link"] / 2 * sine


def tension(theta, p):
    """The force with which the knee pulls body and foot together."""
    return torque(theta, p) / slopes(theta, p)[0]


def flight_rates(x, p, q):
    along, bend = slopes(x[2], p)
    pull = tension(x[2], p)
    foot, body = pull / p["foot_mass"] - p["gravity"], -pull / p["body_mass"] - p["gravity"]
    return [x[1], foot, x[3], (body - foot - bend * x[3] ** 2) / along]


def contact_rates(x, p, q):
    along, bend = slopes(x[0], p)
    body = -tension(x[0], p) / p["body_mass"] - p["gravity"]
    return [x[1], (body - bend * x[1] ** 2) / along]


def flight_gradient(x, p, q):
    m1, m2, g = p["body_mass"], p["foot_mass"], p["gravity"]
    along, bend = slopes(x[2], p)
    body = x[1] + along * x[3]
    by_theta = m1 * body * bend * x[3] + torque(x[2], p) + m1 * g * along
    return [(m1 + m2) * g, m1 * body + m2 * x[1], by_theta, m1 * body * along]


def contact_gradient(x, p, q):
    return flight_gradient([0.0, 0.0, *x], p, q)[2:]


def release(alpha, p):
    """The knee's angle where the tension is the foot's weight."""
    weight = p["foot_mass"] * p["gravity"]
    angle = brentq(lambda a: tension(a, p) - weight, p["rest_angle"], 3.1, xtol=1e-300, rtol=1e-15)
    return np.full(np.shape(alpha), angle)


def search(p):
    """Scales of the small oscillation about the knee's rest."""
    m1, m2, along = p["body_mass"], p["foot_mass"], slopes(p["rest_angle"], p)[0]
    time = along * np.sqrt(m1 * m2 / (m1 + m2) / p["stiffness"])
    return Search(float(m2 * p["gravity"] * along / p["stiffness"] / time), 0.05, 30.0, True, float(time))


def heights(p):
    return {"body": StateFormula(BODY, STATES, p), "foot": Affine((1.0, 0.0, 0.0, 0.0))}


MODEL = Model(
    name="knee hopper",
    flight=Phase("flight", STATES, flight_rates),
    contact=Phase(
        "contact",
        STATES[2:],
        contact_rates,
        {"contact force": lambda x, p, q: p["foot_mass"] * p["gravity"] - tension(x[0], p)},
    ),
    launch=lambda u, p: [0.0, 0.0, u["liftoff"], u["alpha"]],
    liftoff=lambda u, p, q: tension(u["liftoff"], p) - p["foot_mass"] * p["gravity"],
    landing=lambda u, x, p: [x[0], x[1], x[2] - u["liftoff"]],
    reversor=(1, -1, 1, -1),
    release=release,
    touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
    embed=np.eye(4)[:, 2:],
    flight_gradient=flight_gradient,
    contact_gradient=contact_gradient,
    extension=Affine((0.0, 0.0, 1.0, 0.0)),
    gap=lambda p: Affine((1.0, 0.0, 0.0, 0.0)),
    separation=lambda p: StateFormula(LEG, STATES, p),
    heights=heights,
    impact_mass=lambda x, p: p["foot_mass"],
    impact=lambda x, p: [0.0, 1.0, 0.0, -1.0 / slopes(x[2], p)[0]],
    contact_speed=Affine((0.0, 1.0)),
    violations={
        "gap": "foot below ground",
        "pull": "the ground would have to pull",
        "separation": "the knee folds through",
        "end": "contact: the knee folds, the body never lifts off again",
    },
    springs=(("foot", "body"),),
    guess=None,
    search=search,
    rest=lambda p: [0.0, 0.0, p["rest_angle"], 0.0],
    units=lambda p: SI,
)


@dataclass(frozen=True)
class KneeHopper:
    """Masses in kg, link in m, stiffness in N m/rad, angle in rad, gravity in m/s^2."""

    body_mass: float = 6.0
    foot_mass: float = 1.0
    link: float = 0.25
    stiffness: float = 20.0
    rest_angle: float = 1.8
    gravity: float = 9.81
    restitution: float = 0.0
    units: Units | None = SI

    model = MODEL

    @property
    def values(self):
        kept = asdict(replace(self, units=None))
        return {name: value for name, value in kept.items() if name not in ("restitution", "units")}

    @property
    def rest_length(self):
        return float(2 * self.link * np.sin(self.rest_angle / 2))

    def with_values(self, **values):
        return replace(self, **values)

    def dimensionless(self):
        return replace(self, units=None)

    def describe(self):
        units = ("kg", "kg", "m", "N m", "", "m/s^2")
        return {
            "machine": "knee hopper",
            "spring": "stiffness*(theta - rest_angle)",
            "gravity": "1",
            "mass_ratio": self.foot_mass / self.body_mass,
            "rest_length": self.rest_length,
            "restitution": self.restitution,
            "parameters": self.values,
            "laws_in": "SI",
            "units": dict(zip(self.values, units, strict=True)),
        }


MACHINE = KneeHopper()
