"""The hopper: a body and a foot joined by a spring, the foot landing plastically (sections 3 and 4 of the paper).

Units: force in the foot's weight m2 g, length in m2 g/k, time in 1/omega with omega**2 = k (1 + M)/m2, M = m2/m1 the
mass of the foot over that of the body. Flight state (y1, y1', y2, y2') of body and foot, extension r = y1 - y2:

    (1 + M) y1'' = -M phi(r) - gamma(rest_length + y1)        (1 + M) y2'' = phi(r) - gamma(y2)

and in contact y2 = 0 until phi(y1) = 1.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from orbits.model.closed_form import Oscillator
from orbits.model.model import Model
from orbits.model.phase import Affine, Phase

from .laws import Key, from_key
from .machine import TwoMassMachine, damper, gravity_at
from .relative import guess, no_orbit, relative_reduction, released, spring_pieces, straight_line, thrown, thrown_flight

HOPPER_STATES = ("y1", "y1'", "y2", "y2'")
WEIGHT = "the foot's weight"


@dataclass(frozen=True)
class Hopper(TwoMassMachine):
    """Body and foot joined by a spring; see `TwoMassMachine` for the arguments. `mass_ratio` is foot over body."""

    kind = "hopper"

    def build(self, spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        return _hopper_model(spring, gravity, has_length, damped)


@lru_cache(maxsize=64)
def _hopper_model(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
    force = spring.expression
    pull, dampers = gravity_at(gravity), damper(damped)

    def body_weight(y1, p):
        return pull(p["rest_length"] + y1, p) if gravity else 1.0

    def flight(x, p, q):
        M, (c, d) = p["mass_ratio"], dampers(p)
        tension = force(x[0] - x[2], p, q) + c * (x[1] - x[3])
        return [
            x[1],
            -(M * (tension + d * x[1]) + body_weight(x[0], p)) / (1 + M),
            x[3],
            (tension - pull(x[2], p) - d * x[3]) / (1 + M),
        ]

    def contact(x, p, q):
        M, (c, d) = p["mass_ratio"], dampers(p)
        return [x[1], -(M * (force(x[0], p, q) + (c + d) * x[1]) + body_weight(x[0], p)) / (1 + M)]

    def flight_gradient(x, p, q):
        M, tension = p["mass_ratio"], force(x[0] - x[2], p, q)
        return [
            M * tension + body_weight(x[0], p),
            (1 + M) * x[1],
            M * (pull(x[2], p) - tension),
            (1 + M) * M * x[3],
        ]

    def contact_gradient(x, p, q):
        M = p["mass_ratio"]
        return [M * force(x[0], p, q) + body_weight(x[0], p), (1 + M) * x[1]]

    def contact_oscillator(p):
        M = p["mass_ratio"]
        k, zero = straight_line(spring, p)
        return Oscillator(M * k / (1 + M), zero - 1 / (M * k), {"contact force": (-k, 1 + k * zero)})

    def mix(p):
        M = p["mass_ratio"]  # y1, y1', y2, y2' from r, r', w, w' with w = y1 + M y2
        return np.array([[M, 0, 1, 0], [0, M, 0, 1], [-1, 0, 1, 0], [0, -1, 0, 1]]) / (1 + M)

    def apart(p):
        return np.array([[1, 0, -1, 0], [0, 1, 0, -1], [1, 0, p["mass_ratio"], 0], [0, 1, 0, p["mass_ratio"]]])

    def complete(times, coefficients, u, p):
        M, flown = np.reshape(p["mass_ratio"], (-1, 1, 1)), thrown(times, coefficients.shape[2], u)
        swung = coefficients[:, :2]
        return np.concatenate([M * swung + flown, flown - swung], axis=1) / (1 + M)

    def heights(p):
        M, length = p["mass_ratio"], p.get("rest_length", 0.0)
        return {
            "body": Affine((1.0, 0.0, 0.0, 0.0), length),
            "foot": Affine((0.0, 0.0, 1.0, 0.0)),
            "centre of mass": Affine((1 / (1 + M), 0.0, M / (1 + M), 0.0), length / (1 + M)),
        }

    reduction = None
    if gravity is None and not damped:
        reduction = relative_reduction(
            spring, 0.0, complete, lambda t, dz, p: (t - dz[0]) / (1 + p["mass_ratio"]), WEIGHT
        )
    return Model(
        name="hopper",
        flight=Phase(
            "flight",
            HOPPER_STATES,
            flight,
            pieces=spring_pieces(spring, (1.0, 0.0, -1.0, 0.0)),
            closed_form=thrown_flight(reduction, mix, apart),
        ),
        contact=Phase(
            "contact",
            ("y1", "y1'"),
            contact,
            {"contact force": lambda x, p, q: 1 - force(x[0], p, q) - dampers(p)[0] * x[1]},
            spring_pieces(spring, (1.0, 0.0)),
            contact_oscillator if spring.degree() == 1 and gravity is None and not damped else None,
        ),
        launch=lambda u, p: [u["liftoff"], u["alpha"], 0.0, 0.0],
        liftoff=lambda u, p, q: force(u["liftoff"], p, q) + dampers(p)[0] * u["alpha"] - 1,
        landing=lambda u, x, p: [x[2], x[3], x[0] - u["liftoff"]],
        reversor=None if damped else (1, -1, 1, -1),
        release=lambda alpha, p: released(from_key(spring, p), 0.0, WEIGHT, dampers(p)[0], alpha),
        touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
        embed=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]),
        flight_gradient=flight_gradient,
        contact_gradient=contact_gradient,
        extension=Affine((1.0, 0.0, -1.0, 0.0)),
        gap=lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
        separation=lambda p: Affine((1.0, 0.0, -1.0, 0.0), p["rest_length"]) if "rest_length" in p else None,
        heights=heights,
        impact_mass=lambda p: p["mass_ratio"] * (1 + p["mass_ratio"]),
        impact=lambda p: np.array([0.0, 0.0, 0.0, 1.0]),
        contact_speed=Affine((0.0, 1.0)),
        violations={
            "gap": "foot below ground",
            "pull": "the ground would have to pull",
            "separation": "the masses pass through each other",
            "end": "contact: the spring collapses, the body never lifts off again",
        },
        springs=(("foot", "body"),),
        guess=no_orbit if damped else guess(spring, 0.0, WEIGHT),
        homotopy="gravity_share" if gravity else None,
        conservative=not damped,
        reduction=reduction,
        tension=lambda x, p, q: force(x[0] - x[2], p, q),
    )
