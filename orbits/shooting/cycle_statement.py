"""The equations of a periodic motion of one arc, at an energy: a whole cycle, without any mirror image.

A conservative machine has such motions in families along the energy E, without a change of the machine: x(T) = x(0) for
a state x (2n,) leaves E free, and holds for one equation less than it has, since energy is conserved. So E is the
parameter, a section fixes the instant at which the cycle begins, and a multiple of the energy's gradient is added to
the field. This unfolding is a further unknown, which vanishes on a cycle (Munoz-Almaraz et al. 2003, Physica D 181).

Where the machine bounces, the cycle begins after an elastic impact, and the section is the closed gap.

The energy at the beginning is the work from the equilibrium on a straight way to the place there, integrated as a
motion is, so that laws of any form and tables have it, and the kinetic energy.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from ..laws import Algebraic, Parameters, Scalars
from ..model import Arc, Model, Phase, Pieces, Statement

# The parameter of the equations besides those of the machine.
ENERGY_OF_CYCLE = "energy"


def unfolded(phase: Phase, gradient: Callable) -> Phase:
    """A phase with a multiple of the energy's gradient, its further state "unfolding", added to the field."""

    def field(x, p, q):
        *state, unfolding = x
        slopes = gradient(state, p, q)
        rates = [f + unfolding * g for f, g in zip(phase.field(state, p, q), slopes, strict=True)]
        return [*rates, 0 * unfolding]

    watch = {name: lambda x, p, q, own=own: own(x[:-1], p, q) for name, own in phase.watch.items()}
    return Phase(phase.name, (*phase.states, "unfolding"), field, watch, _pieces_of_one_state_more(phase))


def _pieces_of_one_state_more(phase: Phase) -> Pieces | None:
    """The pieces of a phase's law where a further state, on which they do not depend, comes last."""
    return phase.pieces and replace(phase.pieces, coordinate=(*phase.pieces.coordinate, 0.0))


def moving_phase(model: Model, bounces: bool) -> tuple[Phase, Callable]:
    """The phase of the cycles of a model, and the gradient of its energy."""
    return (model.flight, model.flight_gradient) if bounces else (model.contact, model.contact_gradient)


def elastic(model: Model, x: Scalars, p: Parameters) -> list[Algebraic]:
    """The flight state after an elastic impact in the flight state x: the gap's speed changes its sign."""
    return [2 * landed - before for landed, before in zip(model.landed(x, p), x, strict=True)]


def parameters_of_cycle(states: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the further parameters: the places of the equilibrium, the weights of the speeds whose sum vanishes
    at the beginning, and the energy."""
    places = states[::2]
    return *(f"{y} at rest" for y in places), *(f"weight of {y}'" for y in places), ENERGY_OF_CYCLE


@lru_cache(maxsize=64)
def whole_cycle(model: Model, bounces: bool = False) -> Statement:
    """The statement of a periodic motion, whose unknowns are the state at its beginning, its time and the unfolding: in
    contact, or where it `bounces`, in flight from one elastic impact to the next."""
    phase, gradient = moving_phase(model, bounces)
    states = phase.states
    rest, weights, energy = _split(parameters_of_cycle(states), len(states) // 2)

    def work(x: Scalars, p, q) -> list[Algebraic]:
        *own, _ = x
        still = [each if i % 2 == 0 else 0.0 for i, each in enumerate(own)]
        power = sum(slope * speed for slope, speed in zip(gradient(still, p, q)[::2], own[1::2], strict=True))
        return [part for speed in own[1::2] for part in (speed, 0.0 * speed)] + [power]

    def kinetic(u, p) -> Algebraic:
        state, data = [u[name] for name in states], phase.pieces.size if phase.pieces else 0
        momenta = gradient(state, p, [0.0] * data)[1::2]
        return 0.5 * sum(m * v for m, v in zip(momenta, state[1::2], strict=True))

    way = Arc(
        Phase("way", (*states, "work"), work, pieces=_pieces_of_one_state_more(phase)),
        start=lambda u, before, p: [
            *(part for y, at in zip(states[::2], rest, strict=True) for part in (p[at], u[y] - p[at])), 0.0
        ],
        duration=lambda u, p: 1.0,
        conditions=lambda u, x, p: [x[-1] + kinetic(u, p) - p[energy]],
    )  # fmt: skip
    cycle = Arc(
        unfolded(phase, gradient),
        start=lambda u, before, p: [u[name] for name in (*states, "unfolding")],
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: [
            *(end - u[name] for end, name in zip(elastic(model, x[:-1], p) if bounces else x, states, strict=False)),
            model.gap(p).at([u[name] for name in states])
            if bounces
            else sum(p[weight] * u[v] for weight, v in zip(weights, states[1::2], strict=True)),
        ],
    )
    return Statement("whole cycle", (*states, "duration", "unfolding"), (way, cycle), ("duration",))


def _split(names: tuple[str, ...], n: int) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """The names of parameters of a cycle in groups."""
    return names[:n], names[n : 2 * n], names[-1]
