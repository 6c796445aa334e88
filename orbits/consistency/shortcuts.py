"""Relations for the short cuts of a model: the flows in closed form, and the reduction to fewer states."""

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

from ..laws.law import Algebraic
from ..model.model import Model
from ..model.relative import Reduction
from .draws import Draw, Expressions, coordinates, data_count, data_of_pieces, named, reversor_of
from .relations import Relation, share

# A closed form is compared with its Taylor series of this order after this time, where these agree to rounding.
SERIES_ORDER, SERIES_TIME = 16, 0.05
# A difference quotient of the gap has this error, as a share of it.
LARGEST_QUOTIENT, STEP = 1e-6, 1e-4
FAMILIES = (1, 2)  # whose exact orbits are checked
NEWTON_STEPS_TO_MIDDLE = 6
AtStates = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]


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
        if where == "contact":
            forces = np.concatenate([at["force"], at.get("landed", at["force"][:, :0])], axis=1)
            off = share(series[:, n:, 0] - forces, forces) if series.shape[1] == n + forces.shape[1] else np.inf
            yield Relation(f"{name} watches the contact force", (name, "contact.watch"), off)
        after, transition = form.state(x, SERIES_TIME), form.transition(SERIES_TIME)
        summed = series[0, :n] @ SERIES_TIME ** np.arange(SERIES_ORDER + 1)
        moved = np.array([form.state(x + unit, SERIES_TIME) - after for unit in np.eye(n)]).T
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
    (arc,), at = reduction.statement.arcs, _evaluated(reduction, draw)
    u, rng, (count, _) = draw.free["u"], np.random.default_rng(1), draw.free["u"].shape
    of_u = dict(zip(model.launch_unknowns, u.T, strict=True))
    p = {name: np.full(count, value) for name, value in draw.p.items()}
    start, signs = at(u, u)["start"], np.array(reduction.reversor, float)
    z = start + np.array([draw.length, 1.0]) * 0.2 * rng.standard_normal(start.shape)
    times = np.asarray(rng.uniform(0.0, 1.0, count))
    here, back = at(z, u), at(z * signs, u)

    def whole(at_times: np.ndarray, *rows: np.ndarray, alpha: Algebraic = 0.0) -> np.ndarray:
        """The Taylor coefficients (L, n, 3) of flight states from those of reduced ones, (L, k) of each order."""
        filled = [*rows, *(0.0 * rows[0] for _ in range(3 - len(rows)))]
        moved = {**of_u, "alpha": of_u["alpha"] + alpha}
        return np.array(reduction.complete(at_times, np.stack(filled, axis=2), moved, p))

    flown = whole(times, z, here["field"], here["bend"])
    rates, positions, speeds = draw.graphs.in_flight(flown[:, :, 0], draw.p)["field"], *coordinates(model.flight)
    good = np.isfinite(rates).all(1)
    words, off = "the completed positions change at their speeds", flown[:, positions, 1] - flown[:, speeds, 0]
    yield Relation(words, ("reduction.complete",), share(off, flown[:, :, :2]))
    words, off = "the completed flight moves by the field", (flown[:, :, 1] - rates)[good]
    yield Relation(words, ("reduction.phase", "reduction.complete", "flight.field"), share(off, rates[good]))
    words, off = "the reversor turns reduced motions back", back["field"] * signs + here["field"]
    yield Relation(words, ("reduction.reversor", "reduction.phase"), share(off, here["field"]))
    words, launched = "the reduced motion starts from the launch", whole(np.zeros(count), start)[:, :, 0]
    fields = ("reduction.statement", "reduction.complete")
    yield Relation(words, fields, share(launched - draw.free["launch"], launched))
    dz, gap = np.tile([0.7, -0.4], (count, 1)), model.gap(draw.p)
    up, down = (gap(whole(times, z + step * dz, alpha=step)[:, :, 0]) for step in (STEP, -STEP))
    words, slope = "gap_slope is the derivative of the gap", (up - down) / (2 * STEP)
    off = share(np.asarray(reduction.gap_slope(times, dz.T, p)) - slope, slope, 1.0)
    yield Relation(words, ("reduction.gap_slope", "reduction.complete"), off, LARGEST_QUOTIENT)
    for _ in range(NEWTON_STEPS_TO_MIDDLE):  # to where the conditions of mid-flight hold
        ends = at(z, u)
        slopes = ends["slopes"].reshape(count, -1, z.shape[1])
        z = z - np.einsum("lij,lj->li", np.linalg.pinv(slopes), ends["ends"].reshape(count, -1))
    half = whole(np.broadcast_to(np.asarray(arc.duration(of_u, p), float), (count,)), z)[:, :, 0]
    words = "the reduced motion ends in the middle of the flight, at rest"
    yield Relation(words, fields, share(half - half * reversor_of(model), half, u))
    if draw.released:
        guard = at(at(draw.released["u"], draw.released["u"])["start"], draw.released["u"])["guard"]
        words, off = "the reduced guard vanishes at launches", share(guard, here["guard"])
        yield Relation(words, ("reduction.statement",), off)
    if arc.phase.closed_form:
        form = arc.phase.closed_form(draw.p)
        series, field = np.array(form.series(z.T, 0.0, 2))[:, : z.shape[1]], at(z, u)["field"]
        off = max(share(series[:, :, 0] - z, z), share(series[:, :, 1] - field, field))
        yield Relation("the reduced closed form moves by its field", ("reduction.phase",), off)
        if reduction.exact:
            words, fields = "the exact orbit solves the statement", ("reduction.exact", "reduction.statement")
            off = max(_exact_off(reduction, draw, at, family) for family in FAMILIES)
            yield Relation(words, fields, off)


def _evaluated(reduction: Reduction, draw: Draw) -> AtStates:
    """(reduced states (L, k), unknowns (L, 2)) -> the parts of a reduction's statement there, by name."""
    (arc,), unknowns = reduction.statement.arcs, reduction.statement.unknowns
    phase, (z, zs), (u, us), (p, known) = arc.phase, *map(named, (arc.phase.states, unknowns, tuple(draw.p)))
    (q, data), states = named(range(data_count(phase))), [*zs.values()]
    field = ca.vertcat(*phase.field(states, known, [*data.values()]))
    ends = ca.vertcat(*arc.conditions(us, states, known))
    parts = {
        "field": field, "bend": ca.jtimes(field, z, field) / 2, "ends": ends, "slopes": ca.jacobian(ends, z),
        "start": ca.vertcat(*arc.start(us, [], known)),
        "guard": ca.vertcat(*arc.guard(us, states, known, [*data.values()])),
    }  # fmt: skip
    graph = Expressions([ca.vertcat(z, u), p, q], parts)
    return lambda at, of_u: graph(np.hstack([at, of_u]), draw.p, data_of_pieces(phase, at, draw.p))


def _exact_off(reduction: Reduction, draw: Draw, at: AtStates, family: int) -> float:
    """By how much the exact orbit of a family misses the end of the reduced statement, beyond its stated error."""
    assert reduction.exact is not None
    (arc,), (u, error) = reduction.statement.arcs, reduction.exact(family, dict(draw.p))
    assert arc.phase.closed_form is not None
    unknowns = np.array([[u[name] for name in reduction.statement.unknowns]])
    start = at(unknowns, unknowns)["start"]
    end = arc.phase.closed_form(draw.p).state(start[0], float(arc.duration(u, draw.p)))
    off = max(share(at(end[None], unknowns)["ends"], start), share(at(start, unknowns)["guard"], start))
    return off if 0 <= error <= 1e-6 * (1 + abs(u["alpha"])) else np.inf


SHORT_CUTS: tuple[Callable[[Model, Draw], Iterator[Relation]], ...] = (closed_forms, reductions)
