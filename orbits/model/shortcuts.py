"""What follows about the short cuts of a model: the flows in closed form, and the reduction to fewer states."""

from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np

from .draws import Draw, Expressions, reversor_of
from .model import Model, Reduction
from .relations import Relation, share

# A closed form is held against its Taylor series of this order after this time, where these agree to rounding.
SERIES_ORDER, SERIES_TIME = 16, 0.05
FAMILIES = (1, 2)  # of which the exact orbit is looked at
NEWTON_STEPS_TO_MIDDLE = 6


def closed_forms(model: Model, draw: Draw) -> Iterator[Relation]:
    """The flows in closed form of both phases, against their fields."""
    for phase, states, at in ((model.flight, draw.x, draw.flown), (model.contact, draw.y, draw.stood)):
        if phase.closed_form is None:
            continue
        name, n = f"{phase.name}.closed_form", len(phase.states)
        form, x = phase.closed_form(draw.p), states[0]
        series = form.series(states.T, SERIES_ORDER)
        value, rate = share(series[:, :n, 0] - states, states), share(series[:, :n, 1] - at["field"], at["field"])
        yield Relation(f"{name} moves by the field", (name, f"{phase.name}.field"), max(value, rate))
        watched = [at["force"][:, 0]] if phase is model.contact else []
        for row, force in enumerate(watched, n):
            off = share(series[:, row, 0] - force, force) if series.shape[1] > row else np.inf
            yield Relation(f"{name} watches the contact force", (name, "contact.watch"), off)
        after = form.state(x, SERIES_TIME)
        summed = series[0, :n] @ SERIES_TIME ** np.arange(SERIES_ORDER + 1)
        yield Relation(f"{name} has states on its own series", (name,), share(after - summed, after))
        moved = np.array([form.state(x + unit, SERIES_TIME) - after for unit in np.eye(n)]).T
        transition = form.transition(SERIES_TIME)
        yield Relation(f"{name} has the transition matrix of its states", (name,), share(transition - moved, moved))


def reductions(model: Model, draw: Draw) -> Iterator[Relation]:
    """The reduction to fewer states, against the whole flight."""
    if model.reduction is None:
        return
    try:
        yield from _reduced(model, model.reduction, draw)
    except Exception as error:
        yield Relation(f"the reduction can be evaluated ({type(error).__name__}: {error})", ("reduction",), np.inf)


def _reduced(model: Model, reduction: Reduction, draw: Draw) -> Iterator[Relation]:
    (arc,), own = reduction.statement.arcs, _reduced_graph(reduction, draw)
    u, rng = draw.free["u"], np.random.default_rng(1)
    count, named = len(u), dict(zip(model.launch_unknowns, u.T, strict=True))
    p = {name: np.full(count, value) for name, value in draw.p.items()}
    z = np.array(own.start(u, draw.numbers)["start"])
    z = z + np.array([draw.length, *np.ones(z.shape[1] - 1)]) * 0.2 * rng.standard_normal(z.shape)
    times = rng.uniform(0.0, 1.0, count)
    at = own.states(z, u, draw.numbers)
    flown = np.array(reduction.complete(times, np.stack([z, at["field"], at["bend"]], axis=2), named, p))
    whole = draw.graphs.in_flight(flown[:, :, 0], draw.numbers)["field"]
    good = np.isfinite(whole).all(1)
    yield Relation("reduction: complete moves by the flight's field", ("reduction", "flight.field"),
                   share((flown[:, :, 1] - whole)[good], whole[good]))  # fmt: skip
    signs = np.array(reduction.reversor, float)
    back = own.states(z * signs, u, draw.numbers)["field"]
    yield Relation("reduction: its reversor turns its motions back", ("reduction",),
                   share(back * signs + at["field"], at["field"]))  # fmt: skip
    start = own.start(u, draw.numbers)["start"]
    rows = np.stack([start, 0 * start, 0 * start], axis=2)
    launched = np.array(reduction.complete(np.zeros(count), rows, named, p))[:, :, 0]
    yield Relation("reduction: it starts from the launch", ("reduction", "launch"),
                   share(launched - draw.free["launch"], launched))  # fmt: skip
    yield Relation("reduction: gap_slope is the derivative of the gap", ("reduction",),
                   _slope_off(model, reduction, draw, z, times, named, p))  # fmt: skip
    middle = own.middle(z, u, draw.numbers)
    durations = np.broadcast_to(np.asarray(arc.duration(named, p), float), (count,))
    rows = np.stack([middle, 0 * middle, 0 * middle], axis=2)
    halfway = np.array(reduction.complete(durations, rows, named, p))[:, :, 0]
    yield Relation("reduction: it ends in the middle of the flight, at rest", ("reduction",),
                   share(halfway - halfway * reversor_of(model), halfway, u))  # fmt: skip
    if draw.roots:
        guard = own.guard(draw.roots["u"], draw.numbers)
        yield Relation("reduction: its guard vanishes at launches", ("reduction",),
                       share(guard["guard"], guard["slope"] * draw.length))  # fmt: skip
    if reduction.exact and arc.phase.closed_form:
        off = max(_exact_off(reduction, draw, family) for family in FAMILIES)
        yield Relation("reduction: exact solves its statement", ("reduction",), off)


class _ReducedGraph:
    """The expressions of a reduction's statement."""

    def __init__(self, reduction: Reduction, draw: Draw):
        (arc,) = reduction.statement.arcs
        phase, unknowns = arc.phase, reduction.statement.unknowns
        z, u, p = ca.SX.sym("z", len(phase.states)), ca.SX.sym("u", len(unknowns)), ca.SX.sym("p", len(draw.p))
        known, of_u = (
            dict(zip(names, ca.vertsplit(each), strict=True)) for names, each in ((draw.p, p), (unknowns, u))
        )
        q = ca.SX.sym("q", phase.pieces.size if phase.pieces else 0)
        data = ca.vertsplit(q) if q.numel() else []
        field = ca.vertcat(*phase.field(ca.vertsplit(z), known, data))
        ends = ca.vertcat(*arc.conditions(of_u, ca.vertsplit(z), known))
        start = ca.vertcat(*arc.start(of_u, [], known))
        guard = ca.vertcat(*arc.guard(of_u, ca.vertsplit(z), known, data))
        at_start = ca.substitute(guard, z, start)
        slope = ca.jacobian(at_start, u[unknowns.index("liftoff")])
        self.phase, self.pieces, self.width = phase, draw.graphs.piece_functions((phase,))[0], z.numel()
        joint = ca.vertcat(z, u)
        bend = ca.jtimes(field, z, field) / 2
        self._states = Expressions([joint, p, q], {"field": field, "bend": bend})
        self._ends = Expressions([joint, p], {"ends": ends, "slopes": ca.jacobian(ends, z)})
        self._start = Expressions([u, p], {"start": start})
        self._guard = Expressions([u, p, q], {"guard": at_start, "slope": slope})
        self.data: Callable = draw.graphs.piece_data

    def start(self, u: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        """The reduced states (L, k) at launches with unknowns (L, 2)."""
        return self._start(u, p)

    def states(self, z: np.ndarray, u: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        """The field, and half its derivative along the motion, at reduced states (L, k)."""
        return self._states(np.hstack([z, u]), p, self.data(self.phase, self.pieces, z, p))

    def guard(self, u: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        """The guard at launches with unknowns (L, 2), and its slope by the lift-off's extension."""
        return self._guard(u, p, self.data(self.phase, self.pieces, self.start(u, p)["start"], p))

    def middle(self, z: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Reduced states (L, k) near others at which the conditions of mid-flight hold."""
        for _ in range(NEWTON_STEPS_TO_MIDDLE):
            at = self._ends(np.hstack([z, u]), p)
            slopes = at["slopes"].reshape(len(z), -1, self.width)
            z = z - np.einsum("lij,lj->li", np.linalg.pinv(slopes), at["ends"].reshape(len(z), -1))
        return z


def _reduced_graph(reduction: Reduction, draw: Draw) -> _ReducedGraph:
    kept: dict[str, Any] = draw.graphs.kept
    if "reduced" not in kept:
        kept["reduced"] = _ReducedGraph(reduction, draw)
    return kept["reduced"]


def _slope_off(model: Model, reduction: Reduction, draw: Draw, z, times, named, p) -> float:
    """By how much the gap's slope differs from a difference quotient along changes of the reduced states."""
    dz, step = np.ones_like(z) * [0.7, *[-0.4] * (z.shape[1] - 1)], 1e-4

    def gap(side: float) -> np.ndarray:
        moved = z + side * step * dz
        rows = np.stack([moved, 0 * moved, 0 * moved], axis=2)
        u = {**named, "alpha": named["alpha"] + side * step}
        return model.gap(draw.p)(np.array(reduction.complete(times, rows, u, p))[:, :, 0])

    difference = (gap(1.0) - gap(-1.0)) / (2 * step)
    return share(np.asarray(reduction.gap_slope(times, dz.T, p)) - difference, difference, np.ones(1)) * 1e-2


def _exact_off(reduction: Reduction, draw: Draw, family: int) -> float:
    """By how much the exact orbit of a family misses the end of the reduced statement, beyond its stated error."""
    assert reduction.exact is not None
    (arc,), (u, error) = reduction.statement.arcs, reduction.exact(family, dict(draw.p))
    assert arc.phase.closed_form is not None
    unknowns = np.array([[u[name] for name in reduction.statement.unknowns]])
    own = _reduced_graph(reduction, draw)
    start, duration = own.start(unknowns, draw.numbers)["start"][0], float(arc.duration(u, draw.p))
    end = arc.phase.closed_form(draw.p).state(start, duration)
    ends = own._ends(np.concatenate([end, unknowns[0]])[None], draw.numbers)["ends"]
    guard = own.guard(unknowns, draw.numbers)
    off = max(share(ends, start), share(guard["guard"], guard["slope"] * draw.length))
    return off if 0 <= error <= 1e-6 * (1 + abs(u["alpha"])) else np.inf


SHORT_CUTS: tuple[Callable[[Model, Draw], Iterator[Relation]], ...] = (closed_forms, reductions)
