"""What hopper and juggler share: under constant gravity the spring's extension moves alone, r'' = -F(r).

F is the spring's force plus a constant load (0 for the hopper, the hand's weight 1 for the juggler), and F = 1 at
lift-off. The other coordinate is thrown upward at speed alpha under unit gravity, so half the flight takes the time
alpha, and an orbit is a root of r'(alpha) = 0: a problem in two states (section 8 of the paper, for a linear spring).
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from orbits.errors import InputError, NoOrbit
from orbits.model.closed_form import Oscillator, ThrownOscillator
from orbits.model.model import Model, Reduction
from orbits.model.phase import Affine, Arc, Phase, Pieces, Statement

from .launch_speed import lowest_launch_speed
from .laws import Key, Parameters, from_key
from .liftoff import Liftoff

# Outside these bounds the lengths of lift-off overflow or vanish beside others.
STIFFNESSES = (1e-12, 1e12)


def spring_pieces(key: Key, coordinate: tuple[float, ...]) -> Pieces | None:
    """The smooth pieces of a spring law's key, for a phase whose state gives the extension by these weights."""
    return Pieces(coordinate, *key.pieces, "extension") if key.pieces else None


def straight_line(key: Key, p: Mapping[str, float]) -> tuple[float, float]:
    """Stiffness k and zero r0 of a straight-line law k (r - r0) at parameter values `p`."""
    law = from_key(key, p)
    value, slope = law.with_slope(0.0)
    if not STIFFNESSES[0] < slope < STIFFNESSES[1]:
        raise InputError(
            f"spring '{law.text}' has stiffness {slope:g}: it never reaches a lift-off that can be computed; "
            f"stiffness lies between {STIFFNESSES[0]:g} and {STIFFNESSES[1]:g}"
        )
    return float(slope), -float(value) / float(slope)


@lru_cache(maxsize=64)
def relative_phase(spring: Key, load: float) -> Phase:
    """The motion r'' = -(phi(r) + load) of a spring law's key, in closed form where the law is a straight line."""
    force = spring.expression

    def oscillator(p):
        k, zero = straight_line(spring, p)
        return Oscillator(k, zero - load / k)

    return Phase(
        "flight",
        ("r", "r'"),
        lambda x, p, q: [x[1], -(force(x[0], p, q) + load)],
        pieces=spring_pieces(spring, (1.0, 0.0)),
        closed_form=oscillator if spring.degree() == 1 else None,
    )


def relative_reduction(spring: Key, load: float, complete: Callable, gap_slope: Callable) -> Reduction:
    """The reduction of a machine under constant gravity; `complete` and `gap_slope` as in `Reduction`."""
    phase, force = relative_phase(spring, load), spring.expression

    def exact(family: int, p: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Eq. (12): b = tan b with alpha = b/sqrt(k); the iteration b = n pi + atan(b) contracts to it."""
        k, zero = straight_line(spring, p)
        b = (family + 0.5) * np.pi
        for _ in range(60):
            b, before = family * np.pi + np.arctan(b), b
            if b == before:
                break
        alpha = b / np.sqrt(k)
        # The error is the residual of sin b = b cos b through its slope b sin b, and one rounding.
        error = abs((np.sin(b) - b * np.cos(b)) / (b * np.sin(b))) / np.sqrt(k) + np.spacing(alpha)
        return {"liftoff": zero + (1 - load) / k, "alpha": alpha}, float(error)

    arc = Arc(
        phase,
        start=lambda u, before, p: [u["liftoff"], u["alpha"]],
        duration=lambda u, p: u["alpha"],
        conditions=lambda u, x, p: [x[1]],
        guard=lambda u, x, p, q: [force(x[0], p, q) + load - 1],
    )
    statement = Statement("relative", ("liftoff", "alpha"), (arc,), ("alpha",))
    return Reduction(statement, (1, -1), complete, gap_slope, exact if phase.closed_form else None)


class TwoMassEquations:
    """What the functions of a model of two masses are made of; a machine adds its own, see `Model` for their arguments.

    spring, gravity : keys of the laws, None where gravity is constant
    damped : whether there is a damper beside the spring, or drag on the masses
    """

    def __init__(self, spring: Key, gravity: Key | None, damped: bool):
        self.spring, self.gravity, self.damped = spring, gravity, damped
        self.force = spring.expression

    def pull(self, z: Any, p: Parameters) -> Any:
        """Gravity ratio at height z; its share over constant gravity is a parameter to follow orbits along."""
        return 1 + p["gravity_share"] * (self.gravity.expression(z, p, []) - 1) if self.gravity else 1.0

    def dampers(self, p: Parameters) -> tuple[Any, Any]:
        """Coefficients of the damper beside the spring and of the drag on each mass."""
        return (p["damping"], p["drag"]) if self.damped else (0.0, 0.0)


def two_mass_model(machine: Any, liftoff: Liftoff, states: tuple[str, ...], extension: Affine, **own: Any) -> Model:
    """The model of a machine's equations; `own` is what only this machine has.

    states : their names, the four in flight before the two in contact
    """
    spring, constant = machine.spring, not (machine.gravity or machine.damped)
    reduction = relative_reduction(spring, liftoff.load, machine.complete, machine.gap_slope) if constant else None
    # The relative motion in closed form, without varying gravity or damping, gives both phases theirs.
    swing: Any = reduction.statement.arcs[0].phase.closed_form if reduction else None
    closed = (lambda p: ThrownOscillator(swing(p), machine.mix(p), machine.apart(p))) if swing else None
    standing, watch = machine.contact_oscillator if swing else None, {"contact force": machine.contact_force}
    in_flight, in_contact = spring_pieces(spring, extension.weights), spring_pieces(spring, (1.0, 0.0))
    return Model(
        flight=Phase("flight", states[:4], machine.flight, pieces=in_flight, closed_form=closed),
        contact=Phase("contact", states[4:], machine.contact, watch, in_contact, standing),
        liftoff=machine.liftoff,
        reversor=None if machine.damped else (1, -1, 1, -1),
        release=machine.release,
        touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
        flight_gradient=machine.flight_gradient,
        contact_gradient=machine.contact_gradient,
        extension=extension,
        separation=lambda p: Affine(extension.weights, p["rest_length"]) if "rest_length" in p else None,
        heights=machine.heights,
        contact_speed=Affine((0.0, 1.0)),
        guess=refuse_damping if machine.damped else launch_guess(spring, liftoff),
        homotopy="gravity_share" if machine.gravity else None,
        conservative=not machine.damped,
        reduction=reduction,
        **own,
    )


def launch_guess(spring: Key, liftoff: Liftoff) -> Callable:
    """(family, p) -> lift-off extension, launch speed and half flight time under constant gravity."""

    def guess(family: int, p: dict[str, float]) -> dict[str, float]:
        law = from_key(spring, p)
        extension = liftoff.extension(law)
        slopes = [float(law.with_slope(r)[1]) for r in (extension, law.rest())]
        scale = 1 / np.sqrt(max(filter(np.isfinite, slopes)))  # a law has a slope at lift-off, if not at rest
        phase, what = relative_phase(spring, liftoff.load), f"spring '{law.text}'"
        alpha = lowest_launch_speed(phase, p, extension, family, scale, what)
        return {"liftoff": extension, "alpha": alpha, "duration": alpha}

    return guess


def thrown(times: np.ndarray, count: int, u: Mapping[str, float]) -> np.ndarray:
    """Coefficients (N, 2, count) of the coordinate thrown up at lift-off under unit gravity, and of its speed, in steps
    from `times` (N,)."""
    rows = np.zeros((len(times), 2, count))
    rows[:, 0, 0] = u["liftoff"] + times * (u["alpha"] - times / 2)
    rows[:, 0, 1] = rows[:, 1, 0] = u["alpha"] - times
    rows[:, 0, 2], rows[:, 1, 1] = -0.5, -1.0
    return rows


def refuse_damping(family: int, p: Mapping[str, float]) -> dict[str, float]:
    """The guess of a damped machine, which has no orbit."""
    raise NoOrbit("a damped machine loses energy on every hop: it has no lossless orbit, but a return map")
