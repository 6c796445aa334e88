"""A machine held against mechanics: what its model declares, its orbit and its hops."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .consistency.accepted import wrong_parts
from .consistency.draws import Graphs, coordinates
from .consistency.relations import Relation, share
from .consistency.verdict import algebraic_relations, inconsistent
from .errors import InconsistentModel, InputError, NoOrbit
from .flow.flow import flow_of
from .flow.trajectory import Trajectory
from .model.machine import Machine, dimensionless, machine_in_words
from .model.model import Search
from .model.phase import Phase
from .periodic.find import dimensionless_start, find
from .periodic.formulations import vector
from .periodic.guess import guess, guesses
from .periodic.orbit import MACHINE_FIELDS, Orbit
from .result import Result
from .return_map.return_map import ReturnMap
from .running.exclusive import exclusive
from .simulation.simulated import Simulation
from .simulation.simulation import simulate

# All parts of a machine.
PARTS = ("model", "values", "with_values", "describe", "units", "restitution", "rest_length")
# Motions are integrated again by SciPy's DOP853 with this relative tolerance, and agree to the second number, beside
# what the motion amplifies, and where the field has corners.
TOLERANCE, LARGEST_DIFFERENCE = 1e-11, 1e-6
# The launch of the hops that are followed, as a share of an orbit's: on its stable side, with a large loss.
BESIDE_ORBIT, HOPS = 1.05, 2
# A guess lies so near to the orbit that it leads to: it may be one of a machine a little simpler.
LARGEST_MISS = 0.3
# The launch speed of the hops of a machine without orbits; and the slowest searched for orbits, in the search's scale.
WITHOUT_ORBIT, SLOWEST_SEARCHED = 2.0, 1e-3
INTEGRATED = "integrated by DOP853"


@dataclass(frozen=True, repr=False)
class Checked(Result, what="check", printed_digits=2):
    """What holds of a machine: printed, a table of the relations with their largest deviations.

    machine : in words and numbers
    relations : each with its fields and deviation, all of which hold
    left_out : what could not be looked at, with the reason
    """

    machine: Mapping[str, Any]
    relations: tuple[Relation, ...]
    left_out: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """The largest deviation as a share of what is allowed."""
        return max(each.deviation / each.bound for each in self.relations)

    def _line(self) -> dict[str, Any]:
        return {"machine": self.machine["machine"], "relations": len(self.relations), "largest": self.largest}

    def title(self) -> str:
        return f"{self.machine['machine']}: {len(self.relations)} relations hold"

    def _notes(self) -> list[str]:
        return list(self.left_out)

    def table(self) -> dict[str, list[Any]]:
        """The relations as columns: in words, their deviations, what is allowed, and their fields."""
        columns = zip(*((r.words, r.deviation, r.bound, ", ".join(r.fields)) for r in self.relations), strict=True)
        return dict(zip(("relation", "deviation", "bound", "fields"), map(list, columns), strict=True))


@exclusive
def check(machine: Machine, *, start: Orbit | Mapping[str, float] | None = None) -> Checked:
    """Hold what a machine declares against what follows from the rest of it.

    start : as in `find`, for a machine whose model guesses no orbit

    First the parts of the machine and the fields of its model, at random states and parameters; then its orbit and two
    hops beside it, whose flights, impacts and contacts are integrated again by another method. Raises `InputError`
    where a part of the machine is missing or malformed, and `InconsistentModel` with all that does not hold.

    >>> from orbits import check
    >>> from problems import Hopper
    >>> check(Hopper()).largest < 1
    True
    """
    _check_parts(machine)
    relations = algebraic_relations(machine.model, machine.values)
    left_out: list[str] = []
    if not relations:
        text = f"the model '{machine.model.name}' is malformed: its flight.field gives no numbers near a launch"
        raise InconsistentModel(text, ("flight.field",))
    if all(each.holds for each in relations):
        bare = dimensionless(machine)
        if bare is not machine and machine.units is not None:
            known = {each.words for each in relations}
            own = algebraic_relations(bare.model, bare.values)
            relations += [each for each in own if each.words not in known or not each.holds]
            start = dimensionless_start(start, machine)
        relations += _along_motions(bare, start, left_out)
    if not all(each.holds for each in relations):
        raise inconsistent(machine.model.name, relations)
    return Checked(machine_in_words(machine), tuple(relations), tuple(left_out))


def _check_parts(machine: Any) -> None:
    """Raise `InputError` that names each part of a machine that is missing or malformed."""
    wrong = {name: text or "it is missing" for name, text in wrong_parts(machine, *PARTS).items()}
    if "describe" not in wrong:
        told = machine.describe()
        absent = [name for name in MACHINE_FIELDS if name not in told] if isinstance(told, Mapping) else MACHINE_FIELDS
        if absent:
            wrong["describe"] = f"it tells no '{absent[0]}'"
    if not wrong:
        values = dict(machine.values)
        try:
            again = machine.with_values()
            if again.values != values or again.model.name != machine.model.name:
                wrong["with_values"] = "without values it does not give the same machine"
        except Exception as error:
            wrong["with_values"] = f"it cannot be called without values ({type(error).__name__}: {error})"
    if wrong:
        told = "; ".join(f"{name}: {text}" for name, text in wrong.items())
        raise InputError(f"'{type(machine).__name__}' is no machine such as problems.Hopper(): {told}")


def _along_motions(machine: Machine, start: Any, left_out: list[str]) -> list[Relation]:
    """The relations along an orbit and along hops beside it."""
    model, graphs = machine.model, Graphs(machine.model, tuple(machine.values))
    pieces = [*_of_pieces(machine, graphs)]
    if not all(each.holds for each in pieces):
        return pieces
    orbit, found = _orbit_of(machine, start, left_out)
    found += pieces
    if orbit:
        found += [*_of_orbit(machine, orbit, graphs), *_of_search(machine, orbit)]
    if not all(each.holds for each in found):
        return found
    launch: Any = BESIDE_ORBIT * orbit.alpha if orbit else WITHOUT_ORBIT
    if not model.one_speed:
        if orbit is None:
            return found
        launch = model.launch_at(orbit(0.0).tolist())
    try:
        run = simulate(machine, launch, hops=HOPS)
    except (InputError, NoOrbit) as error:
        left_out.append(f"no hop was looked at: {error}")
        return found
    found += _of_hops(machine, run, graphs)
    return [*found, *_of_map(machine, run)] if model.one_speed else found


def _orbit_of(machine: Machine, start: Any, left_out: list[str]) -> tuple[Orbit | None, list[Relation]]:
    """An orbit of a machine, with what holds of the guess that led there; None where it has none."""
    model = machine.model
    if not model.conservative:
        left_out.append("no orbit was looked at: the machine is not conservative")
        return None, []
    try:
        guessed = [] if start is not None else _of_guess(machine)
        if not all(each.holds for each in guessed):
            return None, guessed
        orbit = find(machine, start=start)
    except NoOrbit as error:
        left_out.append(f"no orbit was looked at: {error}")
        return None, []
    return orbit, guessed + ([] if start is not None else _near(machine, orbit))


def _plain_values(machine: Machine) -> dict[str, float]:
    """The parameters of the scene of the guess."""
    homotopy = machine.model.homotopy
    return {**machine.values, homotopy: 0.0} if homotopy else dict(machine.values)


def _of_guess(machine: Machine) -> list[Relation]:
    """The form of what a model guesses."""
    if not machine.model.is_guessed:
        return []
    found, names = guess(machine.model, 1, _plain_values(machine)), ("duration", *machine.model.launch_unknowns)
    told = isinstance(found, Mapping) and all(np.isfinite(found.get(name, np.nan)) for name in names)
    return [Relation("guess tells the launch and the half flight", ("guess",), 0.0 if told else np.inf)]


def _near(machine: Machine, orbit: Orbit) -> list[Relation]:
    """How near a guess and that of many machines are to the orbit, in the scene of the guess."""
    model, plain, found = machine.model, _plain_values(machine), list[Relation]()
    if not model.is_guessed:
        return []
    one, names = guess(model, 1, dict(plain)), ("duration", *model.launch_unknowns)
    if not model.homotopy:
        near = model.launch_at(orbit(0.0)) | {"duration": orbit.flight_time / 2}
        off = max(abs(near[name] - one[name]) / orbit.alpha for name in near)
        fields = ("guess",) if model.guess else ("relative",)
        found.append(Relation("the guess is near the orbit that it leads to", fields, off, LARGEST_MISS))
    if model.guess and model.relative and all(each.holds for each in found):
        many = guesses(model.relative, 1, {name: np.array([value, value]) for name, value in plain.items()})
        rows = np.array([np.asarray(many.unknowns[name], float) - one[name] for name in names])
        off = share(rows[:, np.asarray(many.own, bool)], orbit.alpha)
        found.append(Relation("guesses of many machines are those of each", ("relative",), off, LARGEST_MISS))
    return found


def _of_pieces(machine: Machine, graphs: Graphs) -> Iterator[Relation]:
    """At the breakpoints of a field, the pieces on both sides agree."""
    p, rng = vector(machine.values), np.random.default_rng(1)
    for where, table, graph in zip(("flight", "contact"), graphs.pieces, (graphs.flight, graphs.contact), strict=True):
        phase = getattr(machine.model, where)
        if table is None or phase.pieces is None:
            continue
        breaks, data = (np.array(each) for each in table(p))
        along, inner = np.array(phase.pieces.coordinate), breaks.ravel()[1:-1]
        x = rng.standard_normal((len(inner), len(along)))
        x += np.outer((inner - x @ along) / (along @ along), along)
        below, above = (graph(x, p, rows)["field"] for rows in (data[:-1], data[1:])) if len(inner) else (x, x)
        words = f"the {where} is continuous where its pieces meet"
        yield Relation(words, (f"{where}.pieces",), share(below - above, below))


def _of_orbit(machine: Machine, orbit: Orbit, graphs: Graphs) -> Iterator[Relation]:
    """An orbit's flight from launch to landing and its contact, integrated again; and the other way to find it."""
    model = machine.model
    begins, lands = orbit(0.0), orbit(orbit.flight_time)
    half = orbit.flight_time / 2
    middle = _integrated(machine, graphs, model.flight, begins, half)
    words = f"the orbit's flight to its middle is that {INTEGRATED}"
    fields: tuple[str, ...] = ("flight.field", "flight.closed_form", "flight.pieces")
    yield Relation(words, fields, share(middle - orbit(half), begins, middle), LARGEST_DIFFERENCE)
    if orbit.contact is not None and orbit.contact_time is not None:
        stood = np.linalg.pinv(model.embed) @ lands
        middle = np.asarray(model.embed) @ _integrated(machine, graphs, model.contact, stood, orbit.contact_time / 2)
        words = f"the orbit's contact to its middle is that {INTEGRATED}"
        fields = ("contact.field", "contact.closed_form", "contact.pieces")
        there = orbit(orbit.flight_time + orbit.contact_time / 2)
        yield Relation(words, fields, share(middle - there, lands, there), LARGEST_DIFFERENCE)
    if model.reduction and model.reversor:
        other = find(machine, start=orbit, method="half orbit")
        words, off = "the reduction has the orbit of the whole states", abs(other.alpha - orbit.alpha)
        bound = max(LARGEST_DIFFERENCE, (orbit.error + other.error) / orbit.alpha)
        yield Relation(words, ("reduction.statement", "reduction.phase"), off / orbit.alpha, bound)


def _of_search(machine: Machine, orbit: Orbit) -> Iterator[Relation]:
    """The range in which all orbits of a family are searched."""
    model = machine.model
    if model.search:
        search = model.search(machine.values)
        fine = isinstance(search, Search) and search.scale > 0 and 0 < search.spacing < search.fastest
        fine = fine and SLOWEST_SEARCHED * search.scale < orbit.alpha < search.scale * search.fastest
        yield Relation("search has a range with the orbit in it", ("search",), 0.0 if fine else np.inf)


def _of_hops(machine: Machine, run: Simulation, graphs: Graphs) -> Iterator[Relation]:
    """Each leg of a simulation integrated again, and each impact by the inertia of the energy's gradient."""
    model, x = machine.model, run(0.0)
    worst, embed = {"flight": 0.0, "contact": 0.0}, np.asarray(model.embed, float)
    drift, scale = {"flight": 0.0, "contact": 0.0}, _kinetic(graphs, machine, x)
    for leg, event in zip(run.legs, run.events, strict=False):
        phase = model.flight if leg.phase == "flight" else model.contact
        begin = leg.path(0.0)[: len(phase.states)]
        end = _integrated(machine, graphs, phase, begin, float(leg.path.times[-1]))
        after = end if phase is model.flight else embed @ end
        worst[leg.phase] = max(worst[leg.phase], share(after - event.before, begin, after))
        drift[leg.phase] = max(drift[leg.phase], abs(_energy_between(machine, graphs, phase, leg.path)) / scale)
    for where in worst:
        fields: tuple[str, ...] = (f"{where}.field", f"{where}.closed_form", f"{where}.pieces")
        words = f"the {where} of hops is that {INTEGRATED}"
        yield Relation(words, fields, worst[where], LARGEST_DIFFERENCE)
        if model.conservative:
            words, fields = f"the {where} of hops keeps its energy", (f"{where}.field", f"{where}_gradient")
            yield Relation(words, fields, drift[where], LARGEST_DIFFERENCE)
    off = lost = 0.0
    for event in run.events:
        if event.kind in ("impact", "landing"):
            off = max(off, _impact_off(graphs, machine, event.before, event.after, event.kind == "landing"))
            change = _kinetic(graphs, machine, event.before) - _kinetic(graphs, machine, event.after)
            lost = max(lost, abs(change - event.loss) / scale)
    fields = ("impact", "gap", "flight_gradient")
    yield Relation("impacts change the speeds as their inertia says", fields, off, LARGEST_DIFFERENCE)
    yield Relation("impacts lose the kinetic energy that they take", ("impact_mass", *fields), lost, LARGEST_DIFFERENCE)


def _of_map(machine: Machine, run: Simulation) -> Iterator[Relation]:
    """The return map against the simulation, which it must not differ from."""
    launches = run.launches[np.isfinite(run.launches)]
    hops = ReturnMap(machine)(launches[:-1])
    ended = np.isfinite(hops.next)
    fields = ("impact_mass", "contact_speed", "release", "launch", "embed", "contact.closed_form")
    words = "the return map has the launches of the simulation"
    yield Relation(words, fields, share((hops.next - launches[1:])[ended], launches), LARGEST_DIFFERENCE)


def _integrated(machine: Machine, graphs: Graphs, phase: Phase, start: np.ndarray, time: float) -> np.ndarray:
    """The state after a time by SciPy's DOP853, of the field as it is stated."""
    from scipy.integrate import solve_ivp  # takes longer to import than most checks take

    p, at = vector(machine.values), graphs.in_flight if phase is machine.model.flight else graphs.in_contact
    scale = TOLERANCE * max(float(np.abs(start).max()), np.finfo(float).tiny)
    run = solve_ivp(lambda t, x: at(x[None], p)["field"][0], (0.0, time), start, "DOP853", rtol=TOLERANCE, atol=scale)
    return run.y[:, -1]


def _energy_between(machine: Machine, graphs: Graphs, phase: Phase, path: Trajectory) -> float:
    """The change of energy along a motion: the integral of its gradient along the straight line between its ends, which
    is another path than the motion's."""
    at, p = graphs.in_flight if phase is machine.model.flight else graphs.in_contact, vector(machine.values)
    n, (places, weights) = len(phase.states), np.polynomial.legendre.leggauss(12)
    begin, end = path(0.0)[:n], path.end[:n]
    flow, panels = flow_of(phase, tuple(machine.values)), np.linspace(0.0, 1.0, 65)
    if phase.pieces:
        first, last = (float(flow.coordinate @ x) for x in (begin, end))
        breaks = flow.piece_table(p)[0]
        inner = (breaks - first) / (last - first) if last != first else np.zeros(0)
        panels = np.unique([*panels, *inner[(inner > 0) & (inner < 1)]])
    middles, halves = (panels[1:] + panels[:-1]) / 2, np.diff(panels) / 2
    shares = (middles[:, None] + halves[:, None] * places).ravel()
    gradient = at(begin + shares[:, None] * (end - begin), p)["gradient"]
    return float((halves[:, None] * weights).ravel() @ (gradient @ (end - begin)))


def _inertia(graphs: Graphs, machine: Machine, x: np.ndarray) -> np.ndarray:
    """The inertia matrix at a flight state: the derivative of the energy's gradient by the speeds."""
    _, rates = coordinates(machine.model.flight)
    return graphs.in_flight(x[None], vector(machine.values))["hessian"][0][np.ix_(rates, rates)]


def _kinetic(graphs: Graphs, machine: Machine, x: np.ndarray) -> float:
    _, rates = coordinates(machine.model.flight)
    return float(0.5 * x[rates] @ _inertia(graphs, machine, x) @ x[rates])


def _impact_off(graphs: Graphs, machine: Machine, before: np.ndarray, after: np.ndarray, held: bool) -> float:
    """By how much the state after an impact differs from what inertia and restitution make of the one before."""
    at, rates = coordinates(machine.model.flight)
    a = np.array(machine.model.gap(machine.values).weights, float)[at]
    inertia, e = _inertia(graphs, machine, before), 0.0 if held else float(machine.restitution)
    if np.linalg.matrix_rank(inertia) < len(rates):
        return 0.0  # a mass without inertia takes the speed of the others
    along = np.linalg.solve(inertia, a)
    expected = before[rates] - (1 + e) * (a @ before[rates]) / (a @ along) * along
    return max(share(after[rates] - expected, before[rates]), share(after[at] - before[at], before[at], 1.0))
