"""What follows about the short cuts of a model: the flows in closed form, and the reduction to fewer states."""

from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np

from ..model.model import Model, Reduction
from .draws import Draw, Expressions, reversor_of
from .relations import Relation, share

# A closed form is held against its Taylor series of this order after this time, where these agree to rounding.
SERIES_ORDER, SERIES_TIME = 16, 0.05
# A difference quotient of the gap has this error, as a share of it.
LARGEST_QUOTIENT = 1e-6
FAMILIES = (1, 2)  # of which the exact orbit is looked at
NEWTON_STEPS_TO_MIDDLE = 6


def closed_forms(model: Model, draw: Draw) -> Iterator[Relation]:
    """The flows in closed form of both phases, against their fields."""
    for where, states, at in (("flight", draw.x, draw.flown), ("contact", draw.y, draw.stood)):
        phase = getattr(model, where)
        if phase.closed_form is None:
            continue
        name, n = f"{where}.closed_form", len(phase.states)
        form, x = phase.closed_form(draw.p), states[0]
        series = form.series(states.T, 0.0, SERIES_ORDER)
        value, rate = share(series[:, :n, 0] - states, states), share(series[:, :n, 1] - at["field"], at["field"])
        yield Relation(f"{name} moves by the field", (name, f"{where}.field"), max(value, rate))
        watched = [at["force"][:, 0]] if where == "contact" else []
        for row, force in enumerate(watched, n):
            off = share(series[:, row, 0] - force, force) if series.shape[1] > row else np.inf
            yield Relation(f"{name} watches the contact force", (name, "contact.watch"), off)
        after = form.state(x, SERIES_TIME)
        summed = series[0, :n] @ SERIES_TIME ** np.arange(SERIES_ORDER + 1)
        moved = np.array([form.state(x + unit, SERIES_TIME) - after for unit in np.eye(n)]).T
        transition = form.transition(SERIES_TIME)
        off = max(share(after - summed, after), share(transition - moved, moved))
        yield Relation(f"{name} has the series and the transition matrix of its states", (name,), off)


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
    start = own.start(u, draw.numbers)["start"]
    z = start + np.array([draw.length, *np.ones(start.shape[1] - 1)]) * 0.2 * rng.standard_normal(start.shape)
    times = rng.uniform(0.0, 1.0, count)

    def whole(at_times: Any, states: np.ndarray, field: Any = 0.0, bend: Any = 0.0) -> np.ndarray:
        """The first two Taylor coefficients (L, n, 2) of flight states from reduced ones (L, k)."""
        rows = np.stack([states, field + 0 * states, bend + 0 * states], axis=2)
        return np.array(reduction.complete(at_times, rows, named, p))[:, :, :2]

    at = own.states(z, u, draw.numbers)
    flown = whole(times, z, at["field"], at["bend"])
    rates = draw.graphs.in_flight(flown[:, :, 0], draw.numbers)["field"]
    good, (positions, speeds) = np.isfinite(rates).all(1), (draw.graphs.positions, draw.graphs.speeds)
    words = "the completed positions change at their speeds"
    yield Relation(words, ("reduction.complete",), share(flown[:, positions, 1] - flown[:, speeds, 0], flown))
    fields: tuple[str, ...] = ("reduction.phase", "reduction.complete", "flight.field")
    words = "the completed flight moves by the field"
    yield Relation(words, fields, share((flown[:, :, 1] - rates)[good], rates[good]))
    signs = np.array(reduction.reversor, float)
    back = own.states(z * signs, u, draw.numbers)["field"]
    words, fields = "the reversor turns reduced motions back", ("reduction.reversor", "reduction.phase")
    yield Relation(words, fields, share(back * signs + at["field"], at["field"]))
    words, fields = "the reduced motion starts from the launch", ("reduction.statement", "reduction.complete", "launch")
    launched = whole(np.zeros(count), start)[:, :, 0]
    yield Relation(words, fields, share(launched - draw.free["launch"], launched))
    words, fields = "gap_slope is the derivative of the gap", ("reduction.gap_slope", "reduction.complete")
    yield Relation(words, fields, _slope_off(model, reduction, draw, z, times, named, p), LARGEST_QUOTIENT)
    durations = np.broadcast_to(np.asarray(arc.duration(named, p), float), (count,))
    halfway = whole(durations, own.middle(z, u, draw.numbers))[:, :, 0]
    words = "the reduced motion ends in the middle of the flight, at rest"
    fields = ("reduction.statement", "reduction.complete")
    yield Relation(words, fields, share(halfway - halfway * reversor_of(model), halfway, u))
    if draw.roots:
        guard = own.guard(draw.roots["u"], draw.numbers)
        words, off = "the reduced guard vanishes at launches", share(guard["guard"], guard["slope"] * draw.length)
        yield Relation(words, ("reduction.statement",), off)
    if arc.phase.closed_form:
        series = np.array(arc.phase.closed_form(draw.p).series(z.T, 0.0, 2))[:, : z.shape[1]]
        off = max(share(series[:, :, 0] - z, z), share(series[:, :, 1] - at["field"], at["field"]))
        yield Relation("the reduced closed form moves by its field", ("reduction.phase",), off)
    if reduction.exact and arc.phase.closed_form:
        off = max(_exact_off(reduction, draw, family) for family in FAMILIES)
        words, fields = "the exact orbit solves the statement", ("reduction.exact", "reduction.statement")
        yield Relation(words, fields, off)


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
    return share(np.asarray(reduction.gap_slope(times, dz.T, p)) - difference, difference, np.ones(1))


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
