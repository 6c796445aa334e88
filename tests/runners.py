"""The runner of the tests: its numbers to 25 digits by an integration with 34 of them, and its equations by hand."""

import numpy as np

from problems import runner

# Of the speed 0.4, with body mass, stiffness and gravity 1, foot mass 0.1 and rest length 3.7.
FAST = {
    "inertia": 5.654048422247933678285492, "hip_stiffness": 5.367600480798710523139727,
    "half flight": 1.348077700237736475866604, "half contact": 2.173573370247667148190992,
    "leg": 3.242433525386204997823882, "leg rate": -0.2467794287007899275084740,
    "pitch rate": -0.0262991724240760883004646, "step": 1.590953238828221527606223,
    "mean speed": 0.2258817252171626860733590, "friction": 0.25404979012958,
    "friction at landing": 0.24834459659423, "least leg": 0.89529588890123, "foot rise": 1.40576739923358,
}  # fmt: skip
NAMES = ("body_mass", "foot_mass", "inertia", "stiffness", "hip_stiffness", "rest_length", "surface_gravity")


def fast_runner(**stated):
    """The runner of `FAST` with its step, in the parameters of its machine."""
    own = {"inertia": FAST["inertia"], "hip_stiffness": FAST["hip_stiffness"], **stated}
    return runner(**own).with_values(step=FAST["step"])


def rates_by_hand(x, p, standing):
    """The rates of the states of flight or contact, and the forces (F_z, F_x) that hold the foot."""
    leg, u, theta, w, phi, q = x[-6:]
    m1, m2, inertia, k, kh, l0, g = (p[name] for name in NAMES)
    tension, torque, mu = k * (leg - l0), kh * (phi - theta), m1 if standing else m1 * m2 / (m1 + m2)
    pull = g if standing else 0.0
    rates = [
        *(u, leg * w**2 - pull * np.cos(theta) - tension / mu),
        *(w, (pull * leg * np.sin(theta) + torque / mu - 2 * leg * u * w) / leg**2),
        *(q, -torque / inertia),
    ]
    holding = [
        m2 * g - tension * np.cos(theta) - torque / leg * np.sin(theta),
        -tension * np.sin(theta) + torque / leg * np.cos(theta),
    ]
    if standing:
        return rates, holding
    return [x[1], -holding[1] / m2, x[3], -holding[0] / m2, *rates], holding


def energy_by_hand(x, p):
    """The energy of a flight state."""
    vx, z, vz, leg, u, theta, w, phi, q = x[1:]
    m1, m2, inertia, k, kh, l0, g = (p[name] for name in NAMES)
    across, up = vx + u * np.sin(theta) + leg * w * np.cos(theta), vz + u * np.cos(theta) - leg * w * np.sin(theta)
    kinetic = m1 * (across**2 + up**2) + m2 * (vx**2 + vz**2) + inertia * q**2
    springs = k * (leg - l0) ** 2 + kh * (phi - theta) ** 2
    return (kinetic + springs) / 2 + m1 * g * (z + leg * np.cos(theta)) + m2 * g * z
