"""The juggler: a ball on a hand, the hand on a spring to the ground, the ball caught plastically (sections 5 and 6).

Units: force in the hand's weight m2 g, length in m2 g/k, time in sqrt(m2/k), M = m2/m1 the mass of the hand over that
of the ball. Flight state (w1, w1', w2, w2') of ball and hand; phi is the force of the hand's spring at extension w2:

    w1'' = -gamma(rest_length + w1)        w2'' = -phi(w2) - gamma(rest_length + w2)

and in contact both move as one, (1 + M) w'' = -M phi(w) - (1 + M) gamma(rest_length + w), until phi(w) = 0.
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

JUGGLER_STATES = ("w1", "w1'", "w2", "w2'")
FREE = "zero force"


@dataclass(frozen=True)
class Juggler(TwoMassMachine):
    """Ball on a sprung hand; see `TwoMassMachine` for the arguments. `mass_ratio` is hand over ball.

    The force is that of the hand's own spring, zero at lift-off. A hopper with spring force phi and lift-off extension
    rho moves as the juggler with force phi(r + rho) - 1 under constant gravity (eq. 6, with one clock).
    """

    kind = "juggler"

    def build(self, spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        return juggler_model(spring, gravity, has_length, damped)


@lru_cache(maxsize=64)
def juggler_model(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
    """The model of the keys of the laws, see `TwoMassMachine.build`."""
    force = spring.expression
    pull, dampers = gravity_at(gravity), damper(damped)

    def weight(w, p):
        return pull(p.get("rest_length", 0.0) + w, p)

    def flight(x, p, q):
        M, (c, d) = p["mass_ratio"], dampers(p)
        held = force(x[2], p, q) + (c + d) * x[3]
        return [x[1], -M * d * x[1] - weight(x[0], p), x[3], -held - weight(x[2], p)]

    def contact(x, p, q):
        M, (c, d) = p["mass_ratio"], dampers(p)
        return [x[1], -M / (1 + M) * (force(x[0], p, q) + (c + 2 * d) * x[1]) - weight(x[0], p)]

    def excess(p):
        """Of the force over that of the spring alone at lift-off, per speed: the hand's dampers less the ball's."""
        (c, d), M = dampers(p), p["mass_ratio"]
        return c + (1 - M) * d

    def flight_gradient(x, p, q):
        M = p["mass_ratio"]
        return [weight(x[0], p), x[1], M * (force(x[2], p, q) + weight(x[2], p)), M * x[3]]

    def contact_gradient(x, p, q):
        M = p["mass_ratio"]
        return [M * force(x[0], p, q) + (1 + M) * weight(x[0], p), (1 + M) * x[1]]

    def contact_oscillator(p):
        M = p["mass_ratio"]
        k, zero = straight_line(spring, p)
        force = {"contact force": (-k / (1 + M), k * zero / (1 + M))}
        return Oscillator(M * k / (1 + M), zero - (1 + M) / (M * k), force)

    def mix(p):
        return np.eye(4)[[2, 3, 0, 1]]  # the hand swings, the ball is thrown; its own inverse

    def complete(times, coefficients, u, p):
        return np.concatenate([thrown(times, coefficients.shape[2], u), coefficients[:, :2]], axis=1)

    def heights(p):
        length = p.get("rest_length", 0.0)
        return {"ball": Affine((1.0, 0.0, 0.0, 0.0), length), "hand": Affine((0.0, 0.0, 1.0, 0.0), length)}

    reduction = None
    if gravity is None and not damped:
        reduction = relative_reduction(spring, 1.0, complete, lambda t, dz, p: t - dz[0], FREE)
    return Model(
        name="juggler",
        flight=Phase(
            "flight",
            JUGGLER_STATES,
            flight,
            pieces=spring_pieces(spring, (0.0, 0.0, 1.0, 0.0)),
            closed_form=thrown_flight(reduction, mix, mix),
        ),
        contact=Phase(
            "contact",
            ("w", "w'"),
            contact,
            {"contact force": lambda x, p, q: -(force(x[0], p, q) + excess(p) * x[1]) / (1 + p["mass_ratio"])},
            spring_pieces(spring, (1.0, 0.0)),
            contact_oscillator if spring.degree() == 1 and gravity is None and not damped else None,
        ),
        launch=lambda u, p: [u["liftoff"], u["alpha"], u["liftoff"], u["alpha"]],
        liftoff=lambda u, p, q: force(u["liftoff"], p, q) + excess(p) * u["alpha"],
        landing=lambda u, x, p: [x[0] - x[2], x[1] - x[3], x[2] - u["liftoff"]],
        reversor=None if damped else (1, -1, 1, -1),
        release=lambda alpha, p: released(from_key(spring, p), 1.0, FREE, excess(p), alpha),
        touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
        embed=np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]),
        flight_gradient=flight_gradient,
        contact_gradient=contact_gradient,
        extension=Affine((0.0, 0.0, 1.0, 0.0)),
        gap=lambda p: Affine((1.0, 0.0, -1.0, 0.0)),
        separation=lambda p: Affine((0.0, 0.0, 1.0, 0.0), p["rest_length"]) if "rest_length" in p else None,
        heights=heights,
        impact_mass=lambda p: p["mass_ratio"] / (1 + p["mass_ratio"]),
        impact=lambda p: np.array([0.0, p["mass_ratio"], 0.0, -1.0]) / (1 + p["mass_ratio"]),
        contact_speed=Affine((0.0, 1.0)),
        violations={
            "gap": "ball below the hand",
            "pull": "the hand would have to pull the ball",
            "separation": "the hand passes through the ground",
            "end": "contact: the spring collapses, the ball is never thrown again",
        },
        springs=((None, "hand"),),
        guess=no_orbit if damped else guess(spring, 1.0, FREE),
        homotopy="gravity_share" if gravity else None,
        conservative=not damped,
        reduction=reduction,
        tension=lambda x, p, q: force(x[2], p, q),
    )
