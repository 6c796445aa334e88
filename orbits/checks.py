"""Checks of a machine against mechanics: what its model declares, its orbit and its hops."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .consistency.accepted import wrong_parts
from .consistency.draws import Graphs
from .consistency.relations import Relation, share
from .consistency.verdict import algebraic_relations, inconsistent
from .errors import InconsistentModel, InputError, NoOrbit, refuse_machine
from .hops.simulated import Simulation
from .hops.simulation import simulate
from .model.machine import MACHINE_FIELDS, Machine, dimensionless, machine_in_words
from .model.phase import Phase
from .model.relative import Search
from .periodic.find import find
from .periodic.guess import guess
from .periodic.orbit import Orbit
from .result import Result
from .returns.return_map import ReturnMap
from .running.exclusive import exclusive

# All parts of a machine.
PARTS = ("model", "values", "with_values", "describe", "units", "restitution", "rest_length")
# Motions are integrated again by SciPy's DOP853 with this relative tolerance, and agree to the second number, beside
# the amplification of errors by the motion, and where the field has corners.
TOLERANCE, LARGEST_DIFFERENCE = 1e-11, 1e-6
# The launch of the hops that are followed, as a share of an orbit's: on its stable side, with a large loss.
BESIDE_ORBIT, HOPS = 1.05, 2
# A guess lies this near to the orbit that it leads to: it may be one of a machine a little simpler.
LARGEST_MISS = 0.3
# The launch speed of the hops of a machine without orbits; and the slowest searched for orbits, in the search's scale.
WITHOUT_ORBIT, SLOWEST_SEARCHED = 2.0, 1e-3
INTEGRATED = "integrated by DOP853"


@dataclass(frozen=True, repr=False)
class Checked(Result, what="check", printed_digits=2, undrawn="relations have nothing to draw: print them"):
    """The relations that `check` found to hold for a machine; printed, a table of them with their largest deviations.

    machine : in words and numbers
    relations : each with its fields and its deviation
    left_out : relations that could not be checked, with the reason
    """

    machine: Mapping[str, Any]
    relations: tuple[Relation, ...]
    left_out: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """The largest deviation as a share of its tolerance."""
        return max(each.deviation / each.bound for each in self.relations)

    def _line(self) -> dict[str, object]:
        return {"machine": self.machine["machine"], "relations": len(self.relations), "largest": self.largest}

    def title(self) -> str:
        return f"{self.machine['machine']}: {len(self.relations)} relations hold"

    def _notes(self) -> list[str]:
        return list(self.left_out)

    def table(self) -> dict[str, list[Any]]:
        """The relations as columns: in words, their deviations, the allowed ones, and their fields."""
        columns = zip(*((r.words, r.deviation, r.bound, ", ".join(r.fields)) for r in self.relations), strict=True)
        return dict(zip(("relation", "deviation", "bound", "fields"), map(list, columns), strict=True))


@exclusive
def check(machine: Machine, *, start: Orbit | Mapping[str, float] | None = None) -> Checked:
    """Check that the parts of a machine are consistent with each other and with mechanics.

    machine : any `Machine`
    start : an initial guess as in `find`, for a machine whose model has no guess. For a machine with a coordinate that
        sticks it is an orbit of that machine, to which numbers of the machine are tuned

    First the parts of the machine and the fields of its model are compared, at random states and parameters. Then its
    orbit and two hops near it are integrated again by another method, SciPy's DOP853, with their contacts.
    Raises `InputError` where a part of the machine is missing or malformed, and `InconsistentModel` with all relations
    that do not hold.

    >>> from orbits import check
    >>> from problems import Hopper
    >>> check(Hopper()).largest < 1
    True
    """
    refuse_machine(machine, wrong_parts(machine, *PARTS) or _wrong_results(machine))
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
            start = machine.units.dimensionless("start", start)
        relations += _along_motions(bare, start, left_out)
    if not all(each.holds for each in relations):
        raise inconsistent(machine.model.name, relations)
    return Checked(machine_in_words(machine), tuple(relations), tuple(left_out))


def _wrong_results(machine: Machine) -> dict[str, str]:
    """The faults in the results of a machine's methods, in words by name."""
    found, words = dict[str, str](), machine.describe()
    if absent := [name for name in MACHINE_FIELDS if not isinstance(words, Mapping) or name not in words]:
        found["describe"] = f"it says no '{absent[0]}'"
    try:
        copy = machine.with_values()
        if copy.values != dict(machine.values) or copy.model.name != machine.model.name:
            found["with_values"] = "without values it does not give the same machine"
    except Exception as error:
        found["with_values"] = f"it cannot be called without values ({type(error).__name__}: {error})"
    return found


def _along_motions(machine: Machine, start: Orbit | Mapping[str, float] | None, left_out: list[str]) -> list[Relation]:
    """The relations along an orbit and along hops beside it."""
    model, graphs = machine.model, Graphs(machine.model, tuple(machine.values))
    found, orbit = [*_piece_relations(machine, graphs)], None
    if model.hysteretic:
        left_out.append("no motion was looked at: the spring has hysteresis, and the phases have its mean law")
        return found
    if not model.conservative:
        left_out.append("no orbit was looked at: the machine is not conservative")
    elif model.sticks and not isinstance(start, Orbit):
        left_out.append("no orbit was looked at: give start= one of the machine, whose numbers are tuned for it")
    elif all(each.holds for each in found):
        try:
            guessed = guess(model, 1, _plain_values(machine)) if start is None and model.is_guessed else None
            found += [] if guessed is None else [_guess_relation(machine, guessed)]
            if model.sticks and isinstance(start, Orbit):
                orbit = start.dimensionless()
            else:
                orbit = find(machine, start=start) if all(each.holds for each in found) else None
        except NoOrbit as error:
            left_out.append(f"no orbit was looked at: {error}")
        if orbit:
            searched = () if model.sticks else _search_relations(machine, orbit, guessed)
            found += [*_orbit_relations(machine, orbit, graphs), *searched]
    if not all(each.holds for each in found) or model.sticks or (orbit is None and not model.one_speed):
        return found
    launch = BESIDE_ORBIT * orbit.alpha if orbit else WITHOUT_ORBIT
    try:
        run = simulate(machine, launch if orbit is None or model.one_speed else model.launch_at(orbit(0.0)), hops=HOPS)
    except (InputError, NoOrbit) as error:
        left_out.append(f"no hop was looked at: {error}")
        return found
    found += _hop_relations(machine, run, graphs)
    return [*found, *_map_relations(machine, run)] if model.one_speed else found


def _plain_values(machine: Machine) -> dict[str, float]:
    """The parameters of the scene of the guess."""
    homotopy = machine.model.homotopy
    return {**machine.values, homotopy: 0.0} if homotopy else dict(machine.values)


def _guess_relation(machine: Machine, guessed: object) -> Relation:
    """The form of a model's guess."""
    names = ("duration", *machine.model.launch_unknowns)
    fine = isinstance(guessed, Mapping) and all(np.isfinite(guessed.get(name, np.nan)) for name in names)
    return Relation("guess states the launch and the half flight", ("guess",), 0.0 if fine else np.inf)


def _piece_relations(machine: Machine, graphs: Graphs) -> Iterator[Relation]:
    """At the breakpoints of a field, the pieces on both sides agree, unless it jumps there."""
    p, rng = machine.values, np.random.default_rng(1)
    for where, graph in (("flight", graphs.flight), ("contact", graphs.contact)):
        if (pieces := getattr(machine.model, where).pieces) is None or pieces.jumps:
            continue
        breaks, data = (np.asarray(each, float) for each in pieces.table(p))
        along, inner = np.array(pieces.coordinate), pieces.levels(breaks[1:-1], p)
        x = rng.standard_normal((len(inner), len(along)))
        x += np.outer((inner - x @ along) / (along @ along), along)
        below, above = (graph(x, p, rows)["field"] for rows in (data[:-1], data[1:])) if len(inner) else (x, x)
        words = f"the {where} is continuous where its pieces meet"
        yield Relation(words, (f"{where}.pieces",), share(below - above, below))


def _fields_of(where: str) -> tuple[str, ...]:
    """The fields of a phase that say how it moves."""
    return f"{where}.field", f"{where}.closed_form", f"{where}.pieces"


def _orbit_relations(machine: Machine, orbit: Orbit, graphs: Graphs) -> Iterator[Relation]:
    """An orbit's flight from launch to landing and its contact, integrated again; and the other way to find it."""
    model, begins, lands, half = machine.model, orbit(0.0), orbit(orbit.flight_time), orbit.flight_time / 2
    middle = _integrated(machine, graphs, model.flight, begins, half)
    words = f"the orbit's flight to its middle is that {INTEGRATED}"
    yield Relation(words, _fields_of("flight"), share(middle - orbit(half), begins, middle), LARGEST_DIFFERENCE)
    if orbit.contact is not None and orbit.contact_time is not None:
        stood = np.linalg.pinv(model.embed) @ model.relabelling(lands, machine.values)
        middle = np.asarray(model.embed) @ _integrated(machine, graphs, model.contact, stood, orbit.contact_time / 2)
        words, there = (
            f"the orbit's contact to its middle is that {INTEGRATED}",
            orbit(2 * half + orbit.contact_time / 2),
        )
        yield Relation(words, _fields_of("contact"), share(middle - there, lands, there), LARGEST_DIFFERENCE)
    if model.reduction and model.reversor:
        other = find(machine, start=orbit, method="half orbit")
        words, off = "the reduction has the orbit of the whole states", abs(other.alpha - orbit.alpha)
        bound = max(LARGEST_DIFFERENCE, (orbit.error + other.error) / orbit.alpha)
        yield Relation(words, ("reduction.statement", "reduction.phase"), off / orbit.alpha, bound)


def _search_relations(machine: Machine, orbit: Orbit, guessed: Mapping[str, float] | None) -> Iterator[Relation]:
    """How near the guess was to the orbit, where both are of one scene, and the range in which a family is searched."""
    model = machine.model
    if guessed and model.guess and not model.homotopy:
        near = model.launch_at(orbit(0.0)) | {"duration": orbit.flight_time / 2}
        off = max(abs(near[name] - guessed[name]) / orbit.alpha for name in near)
        yield Relation("the guess is near the orbit that it leads to", ("guess",), off, LARGEST_MISS)
    if model.search:
        search = model.search(machine.values)
        fine = isinstance(search, Search) and search.scale > 0 and 0 < search.spacing < search.fastest
        fine = fine and SLOWEST_SEARCHED * search.scale < orbit.alpha < search.scale * search.fastest
        yield Relation("search has a range with the orbit in it", ("search",), 0.0 if fine else np.inf)


def _hop_relations(machine: Machine, run: Simulation, graphs: Graphs) -> Iterator[Relation]:
    """Each leg of a simulation integrated again."""
    model, worst = machine.model, {"flight": 0.0, "contact": 0.0}
    for leg, event in zip(run.legs, run.events, strict=False):
        phase = model.flight if leg.phase == "flight" else model.contact
        begin = leg.path(0.0)[: len(phase.states)]
        end = _integrated(machine, graphs, phase, begin, float(leg.path.times[-1]))
        after = end if phase is model.flight else np.asarray(model.embed, float) @ end
        worst[leg.phase] = max(worst[leg.phase], share(after - event.before, begin, after))
    for where, off in worst.items():
        yield Relation(f"the {where} of hops is that {INTEGRATED}", _fields_of(where), off, LARGEST_DIFFERENCE)


def _map_relations(machine: Machine, run: Simulation) -> Iterator[Relation]:
    """The return map against the simulation, which it must not differ from."""
    launches = run.launches[np.isfinite(run.launches)]
    hops = ReturnMap(machine)(launches[:-1])
    ended = np.isfinite(hops.next)
    fields = ("impact_mass", "release", "embed", "contact.closed_form")
    words = "the return map has the launches of the simulation"
    yield Relation(words, fields, share((hops.next - launches[1:])[ended], launches), LARGEST_DIFFERENCE)


def _integrated(machine: Machine, graphs: Graphs, phase: Phase, start: np.ndarray, time: float) -> np.ndarray:
    """The state after a time by SciPy's DOP853, of the field as it is stated."""
    from scipy.integrate import solve_ivp  # takes longer to import than most checks take

    p, at = machine.values, graphs.in_flight if phase is machine.model.flight else graphs.in_contact
    scale = TOLERANCE * max(float(np.abs(start).max()), np.finfo(float).tiny)
    run = solve_ivp(lambda t, x: at(x[None], p)["field"][0], (0.0, time), start, "DOP853", rtol=TOLERANCE, atol=scale)
    return run.y[:, -1]
