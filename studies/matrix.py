"""Every machine, with every kind of spring, under every verb: what works, and what is refused, and why.

Each cell that works is held against an independent figure: another integrator and another root finder, neighbouring
orbits, the same question asked in another way. Each refusal gives a reason of mathematics in words that the page of
limits has too. The table of the documentation is made of what this study finds.
Run: python studies/matrix.py [--machine NAME] [--spring NAME] [--verb NAME] [--rows FILE] [--write]
"""

import argparse
import json
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

import orbits
from orbits import OrbitsError, ReturnMap, find, find_all, follow, simulate, starts
from orbits.mechanics import Damper, Spring
from orbits.model import dimensionless, free_parameters
from orbits.symbolic import parse
from orbits.units import LIFTOFF_SPEED
from problems import (
    Actuator,
    Chain,
    HeavyHand,
    Hopper,
    Juggler,
    chain_hand,
    inerter_hopper,
    knee_hopper,
    plate_hopper,
    springs,
    steering,
)

# The most processor time of a cell, in seconds.
LONGEST_CELL = 60.0
LIMITS = Path(__file__).parent / "docs" / "limits.md"
TABLE = Path(__file__).parent / "docs" / "machines_and_verbs.md"
# The reasons for which something is refused, in the words of errors and of the page of limits.
REASONS = ("an infinitely heavy hand is only a limit of mechanisms",)
HEAD = """# Which function takes which machine

A cell names the springs with which a function works for a machine. Each result was compared with an independent one,
such as the orbit by another integrator, or with neighbouring orbits. The springs are two formulas (one of them linear),
a potential, a measured table, and a piecewise law with a corner. If a cell does not name a spring, the function refuses
the machine with this spring, finds no motion, or takes more than a minute of processor time; the
[limitations](limits.md) give the reasons. `python studies/matrix.py --write` tries all cells, in half an hour, and
writes this table.
"""
# The rows of the measured spring, which has the law of the cubic one.
EXTENSIONS = np.linspace(-12.0, 12.0, 25)
BETA = 0.02
# The springs, by the extension at which one in pieces has its corner: law, values of its names, and the one varied.
SPRINGS: dict[str, Callable[[float], tuple[Any, dict[str, float], str]]] = {
    "linear": lambda gap: ("k*r + c", {"k": 1.0, "c": 0.1}, "k"),
    "cubic": lambda gap: ("k*r + beta*r**3", {"k": 1.0, "beta": BETA}, "beta"),
    "potential": lambda gap: (springs.potential("k*r**2/2 + beta*r**4/4", k=1.0, beta=BETA), {}, "beta"),
    "table": lambda gap: (_measured(), {}, "s"),
    "pieces": lambda gap: (springs.bilinear(stiffness=1.0, ratio=2.0, gap=gap), {}, "ratio"),
}
# The extension at which the spring in pieces has its corner, which the motion passes; and the dampers of kept hops.
GAPS, DAMPING = {"knee": 0.003}, {"knee": 2e-4}
# The gain of launch speed by injection, where it is not the usual one.
INJECTED = {"plate": 1e-3}
MACHINES: dict[str, Callable[[Any, dict[str, float]], Any]] = {
    "hopper": lambda law, values: Hopper(law, mass_ratio=0.5, rest_length=20.0, parameters=values),
    "juggler": lambda law, values: Juggler(law, mass_ratio=0.5, rest_length=20.0, parameters=values),
    "heavy hand": lambda law, values: HeavyHand(law, parameters=values),
    "inerter": lambda law, values: inerter_hopper(law, rest_length=20.0, parameters=values),
    "knee": lambda law, values: knee_hopper(law, body_mass=0.9, foot_mass=0.045, link=0.05, parameters=values),
    "plate": lambda law, values: plate_hopper(spring=law, parameters={"plate_stiffness": 100.0, **values}),
    "chain": lambda law, values: Chain((1.0, 1.0, 1.0), [law, "r"], parameters=values),
    "chain as a hand": lambda law, values: chain_hand((1.0, 1.0, 1.0), [law, "r"], parameters=values),
}
# The half durations of contact and flight up to which hops of several coordinates are looked for.
LONGEST = {"plate": (2.2, 3.4), "chain": (4.0, 4.0), "chain as a hand": (4.0, 4.0)}


def _measured() -> Any:
    """The cubic spring as rows, scaled and shifted by parameters."""
    return springs.table((EXTENSIONS, EXTENSIONS + BETA * EXTENSIONS**3), noise=0, scale="s", shift="d")


class Held(NamedTuple):
    """A number of the toolkit and the same number found in another way, with the share by which they may differ."""

    name: str
    value: float
    other: float
    share: float = 1e-8

    @property
    def agrees(self) -> bool:
        """Whether both are the same, up to the share of their size."""
        return bool(abs(self.value - self.other) <= self.share * max(1.0, abs(self.other)))


class Cell(NamedTuple):
    """What a verb does for a machine with a spring: the figures that it is held against, or why it is refused."""

    machine: str
    spring: str
    verb: str
    held: tuple[Held, ...]
    refused: str = ""

    @property
    def stands(self) -> bool:
        """Whether it works as it should, or is refused with a reason of the page of limits."""
        return bool(reason_of(self.refused)) if self.refused else bool(self.held) and all(h.agrees for h in self.held)


def reason_of(refusal: str) -> str | None:
    """The reason that a refusal gives in the words of the page of limits; None where it gives none."""
    limits = " ".join(LIMITS.read_text(encoding="utf-8").split())
    return next((reason for reason in REASONS if reason in refusal and reason in limits), None)


@dataclass(frozen=True)
class Case:
    """A machine with a spring, and the orbit from which its verbs begin."""

    name: str
    spring: str

    @cached_property
    def machine(self) -> Any:
        """The machine."""
        return MACHINES[self.name](*self.law[:2])

    @cached_property
    def law(self) -> tuple[Any, dict[str, float], str]:
        """The law of the spring, the values of its names, and the name that is varied."""
        return SPRINGS[self.spring](GAPS.get(self.name, 0.5))

    @property
    def varied(self) -> str:
        """The name of the spring's parameter that is varied."""
        return self.law[2]

    @property
    def another(self) -> str:
        """The name of another parameter."""
        return next(name for name in free_parameters(self.machine) if name != self.varied)

    @property
    def value(self) -> float:
        """The machine's value of the parameter that is varied."""
        return self.machine.values[self.varied]

    def range_of(self, name: str, share: float = 0.02) -> tuple[float, float]:
        """Bounds of a parameter around its value, or around 0."""
        value = self.machine.values[name]
        return value - share * (abs(value) or 1.0), value + share * (abs(value) or 1.0)

    @cached_property
    def start(self) -> dict[str, Any]:
        """The argument `start` of a machine whose launch is more than a speed: the slowest of its hops that
        are motions and no short bounces."""
        if self.machine.model.one_speed:
            return {}
        hops = find_all(self.machine, starts(self.machine, *LONGEST[self.name]))
        return {"start": min((hop for hop in hops if hop.admissible and hop.alpha > 1), key=lambda hop: hop.alpha)}

    @cached_property
    def orbit(self) -> Any:
        """The orbit."""
        return find(self.machine, **self.start)

    def at(self, **values: float) -> Any:
        """The orbit of the machine with other values."""
        return find(self.machine.with_values(**values), **self.start)

    def alpha_at(self, value: float) -> float:
        """Its launch speed at a value of the parameter that is varied."""
        return self.at(**{self.varied: value}).alpha

    @cached_property
    def stated(self) -> Any:
        """The machine as a mechanism."""
        return self.machine.stated() if hasattr(self.machine, "stated") else self.machine

    def actuator_of(self, place: int) -> Any:
        """An actuator that moves the end of a spring."""
        return Actuator([each for each in self.stated.elements if isinstance(each, Spring)][place].extension)

    @property
    def actuator(self) -> Any:
        """An actuator that moves the end of the lowest spring, on a plate that of the leg."""
        return self.actuator_of(0 if self.name == "plate" else -1)

    @cached_property
    def damped(self) -> Any:
        """The machine with a damper beside the varied spring."""
        if self.name in ("hopper", "juggler"):
            return self.machine.with_values(damping=0.01)
        values = {**self.stated.parameters, "damping": DAMPING.get(self.name, 0.01)}
        damper = Damper(self.actuator.along, "damping")
        return replace(self.stated, elements=[*self.stated.elements, damper], parameters=values)

    def slope(self, quantity: str = "alpha") -> float:
        """The derivative of a quantity by the parameter that is varied, by differences of fourth order."""
        step = 1e-3 * self.value
        at = lambda k: getattr(self.at(**{self.varied: self.value + k * step}), quantity)  # noqa: E731
        return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)


def solved_otherwise(case: Case) -> float:
    """The launch speed by SciPy's integrator and root finder, from unknowns that are off by some 1e-4.

    Odd states vanish in mid-flight and in mid-contact, and the contact force at lift-off."""
    machine, model = dimensionless(case.machine), case.machine.model
    unit = case.machine.units.of(LIFTOFF_SPEED) if case.machine.units else 1.0
    orbit = find(machine, start=case.start["start"]) if case.start else find(machine)
    p, names = machine.values, model.launch_unknowns
    launch = (
        model.launch_at(orbit(0.0))
        if not model.one_speed
        else {"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha}
    )
    times = orbit.flight_time / 2, orbit.contact_time / 2
    odd = [np.flatnonzero(np.array(signs) < 0) for signs in (model.reversor, model.mirror)]

    def missed(z: np.ndarray) -> np.ndarray:
        u = dict(zip(names, z, strict=False))
        begins = model.launch(u, p), model.touchdown(u, p)
        phases = zip((model.flight, model.contact), begins, z[-2:], odd, strict=True)
        ends = [_after(phase, p, begin, time)[places] for phase, begin, time, places in phases]
        begin = [float(x) for x in model.launch(u, p)]
        contact = [float(x) for x in np.linalg.lstsq(model.embed, begin, rcond=None)[0]]
        return np.array([*np.concatenate(ends), *map(float, model.liftoff(u, p, _piece(model.contact, p, contact)))])

    guess = np.array([*(float(launch[name]) for name in names), *times])
    found = root(missed, guess * (1 + 1e-4), tol=1e-13)
    return float(found.x[1]) * unit


def _piece(phase: Any, p: Mapping[str, float], x: Any) -> list[float]:
    """The data of the piece that holds at a state."""
    if phase.pieces is None:
        return []
    breaks, rows = phase.pieces.table(p)
    place = np.clip(np.searchsorted(breaks, phase.pieces.place(x, p)) - 1, 0, len(rows) - 1)
    return [float(each) for each in rows[int(place)]]


def _after(phase: Any, p: Mapping[str, float], begin: Any, time: float) -> np.ndarray:
    """The state of a phase after a time, by SciPy's integrator on the phase's own field."""
    rates = lambda t, x: [float(rate) for rate in phase.field(list(x), p, _piece(phase, p, x))]  # noqa: E731
    return solve_ivp(rates, (0.0, time), [float(x) for x in begin], "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


def _finds(case: Case) -> Iterator[Held]:
    yield Held("launch speed, another integrator", case.orbit.alpha, solved_otherwise(case), 1e-7)


def _follows(case: Case) -> Iterator[Held]:
    value = 1.05 * case.value
    family = follow(case.machine, case.varied, value, **case.start)
    yield Held("launch speed at the family's end", family[-1].alpha, case.at(**{case.varied: value}).alpha)


def _sweeps(case: Case) -> Iterator[Held]:
    swept = orbits.sweep(case.machine, {case.varied: case.range_of(case.varied)}, 3, **case.start)
    for value, alpha in zip(swept.table()[case.varied], swept.table()["alpha"], strict=True):
        yield Held("launch speed of a member", alpha, case.alpha_at(float(value)))


def _exists(case: Case) -> Iterator[Held]:
    names = case.varied, case.another
    axes = [(name, case.range_of(name)) for name in names]
    diagram = orbits.existence(case.machine, *axes[0], *axes[1], samples=3, **case.start)
    yield Held("designs with a hop", float(np.sum(diagram.grid["status"] == "certified")), 9.0)


def _is_uncertain(case: Case) -> Iterator[Held]:
    share = 1e-3
    spread = orbits.uncertainty(
        case.machine, {case.varied: case.range_of(case.varied, share)}, samples=64, **case.start
    )
    deviation = abs(case.slope()) * share * case.value / 3**0.5
    yield Held("standard deviation over the one of the slope", spread.deviation["alpha"] / deviation, 1.0, 0.02)


def _is_sensitive(case: Case) -> Iterator[Held]:
    found = orbits.sensitivities(case.machine, case.orbit, case.varied, "alpha")
    yield Held("slope of the launch speed", found["alpha"][case.varied], case.slope(), 1e-6)


def _is_optimised(case: Case) -> Iterator[Held]:
    low, high = case.range_of(case.varied)
    best = orbits.optimize(case.machine, minimise="alpha", over={case.varied: (low, high)}, **case.start)
    grid = min(case.alpha_at(value) for value in np.linspace(low, high, 9))
    yield Held("least launch speed of a grid", best.orbit.alpha, grid, 1e-7)


def _has_a_front(case: Case) -> Iterator[Held]:
    low, high = case.range_of(case.varied)
    goals = ("alpha", "-flight_time")
    front = orbits.pareto(case.machine, minimise=goals, over={case.varied: (low, high)}, points=3, **case.start)
    grid = min(case.alpha_at(value) for value in np.linspace(low, high, 9))
    yield Held("least launch speed of a grid", min(front.table()["alpha"]), grid, 1e-6)


def derivative(of: Callable[[float], Any], size: float = 1e-3) -> Any:
    """The derivative at 0 of a function, an array, by differences of fourth order with a step of `size` that is
    divided by 10 again and again: the one of each entry that changes least with the step."""
    at = [[of(k * size * 10.0**-n) for k in (-2, -1, 1, 2)] for n in range(5)]
    found = np.array([(x[0] - 8 * x[1] + 8 * x[2] - x[3]) / (12 * size * 10.0**-n) for n, x in enumerate(at)])
    best = np.abs(np.diff(found, axis=0)).argmin(0)
    return np.take_along_axis(found, np.expand_dims(best + 1, 0), 0)[0]


def _maps(case: Case) -> Iterator[Held]:
    if case.start:
        step = ReturnMap(case.machine)
        launch = 1.02 * np.array(step(case.orbit).launches)
        run = simulate(case.machine, dict(zip(step.names, launch.tolist(), strict=True)), hops=1)
        yield Held("next launch speed, simulated", float(step(launch).next[0]), float(run.launches[1]))
        return
    hops = ReturnMap(case.machine)(1.02 * case.orbit.alpha)
    run = simulate(case.machine, 1.02 * case.orbit.alpha, hops=1)
    yield Held("next launch speed, simulated", float(hops.next), float(run.launches[1]))


def _has_multipliers(case: Case) -> Iterator[Held]:
    if case.start:
        one = ReturnMap(case.machine)
        launch = 1.02 * np.array(one(case.orbit).launches)
        matrix = orbits.multipliers(case.machine, launch).matrix
        sizes = np.maximum(np.abs(launch), 1e-2 * np.abs(launch).max())
        columns = derivative(lambda k: one(launch + k * np.diag(sizes)).next) / sizes[:, None]
        for value, other in zip(matrix.T.ravel(), columns.ravel(), strict=True):
            yield Held("an entry of the derivative", float(value), float(other), 1e-6)
        return
    speed = 1.02 * case.orbit.alpha
    one = ReturnMap(case.machine)
    slope = derivative(lambda k: np.array(float(one(speed * (1 + k)).next))) / speed
    yield Held("slope of the map", orbits.multiplier(case.machine, speed), float(slope), 1e-6)


def _bifurcates(case: Case) -> Iterator[Held]:
    unit = case.machine.units.of(LIFTOFF_SPEED) if case.machine.units else 1.0
    speed, size = abs(case.orbit.alpha), INJECTED.get(case.name, 0.02) * unit
    span = size, 1.5 * size
    near = {"starts": [case.orbit]} if case.start else {"attractor": 0}
    between = sorted((0.8 * case.orbit.alpha, 1.2 * case.orbit.alpha)) if case.start else (0.8 * speed, 1.1 * speed)
    diagram = orbits.bifurcations(case.machine, "inject", span, tuple(between), sections=2, **near)
    for branch in diagram.branches[:1]:
        inject, several = float(branch.values[-1]), branch.launches is not None
        launch = branch.launches[-1][0] if several else float(branch.alphas[-1][0])
        hop = ReturnMap(case.machine, inject=inject)(launch)
        yield Held("a hop that comes back", float(np.ravel(hop.next)[0]), float(np.ravel(launch)[0]), 1e-7)
    if not diagram.branches:
        hops = ReturnMap(case.machine, inject=span[0])(np.linspace(*between, 200))
        gains = np.sign((hops.next - hops.alpha)[np.isfinite(hops.next)])
        yield Held("changes of the sign of the gain of speed", float(np.abs(np.diff(gains)).sum()), 0.0)


def _simulates(case: Case) -> Iterator[Held]:
    run = simulate(case.machine, state=case.orbit(0.0), time=case.orbit.flight_time / 2)
    bare = dimensionless(case.machine)
    sizes = case.machine.units.of_states(bare.model.flight.states) if case.machine.units else 1.0
    time = case.orbit.flight_time / 2 / (case.machine.units.time if case.machine.units else 1.0)
    other = _after(bare.model.flight, bare.values, case.orbit(0.0) / sizes, time) * sizes
    for name, value, also in zip(bare.model.flight.states, run(run.end), other, strict=True):
        yield Held(f"{name} in mid-flight", value, also, 1e-7)


def _is_stated_in_casadi(case: Case) -> Iterator[Held]:
    own, half = case.machine.casadi(), case.orbit.flight_time / 2
    x, accurate = ca.MX.sym("x", len(own.states)), {"abstol": 1e-12, "reltol": 1e-12}
    problem = {"x": x, "ode": own.flight(x, own.values)}
    end = ca.integrator("flight", "cvodes", problem, 0.0, half, accurate)(x0=case.orbit(0.0))["xf"]
    for name, value, other in zip(own.states, end.full().ravel(), case.orbit(half), strict=True):
        yield Held(f"{name} in mid-flight", float(value), float(other), 1e-7)
    energies = [float(own.energy(state, own.values)) for state in (case.orbit(0.0), case.orbit(half))]
    yield Held("energy in mid-flight", *energies)


def _is_held(case: Case) -> Iterator[Held]:
    machine = case.damped
    kept = steering.keep_hopping(machine, actuator=case.actuator, **case.start)
    yield Held("state after the hop, simulated open loop", steering.missed(machine, kept), 0.0, 1e-7)


def _recovers(case: Case) -> Iterator[Held]:
    short = 0.02 * abs(case.orbit.alpha)
    back = steering.recover(case.machine, short, actuator=case.actuator, **case.start)
    yield Held("state after the hop, simulated open loop", steering.missed(case.machine, back), 0.0, 1e-7)


def _starts_up(case: Case) -> Iterator[Held]:
    up = steering.start_up(case.machine, 2, intervals=14, actuator=case.actuator, **case.start)
    yield Held("state at lift-off, simulated open loop", steering.missed(case.machine, up), 0.0, 1e-7)


def _is_proved(case: Case) -> Iterator[Held]:
    theorem = orbits.prove(case.orbit)
    if not theorem.proved or theorem.alpha is None:
        raise orbits.InputError("; ".join(theorem.reasons))
    yield Held(
        "launch speed that is proved",
        (float(theorem.alpha.low) + float(theorem.alpha.high)) / 2,
        solved_otherwise(case),
        1e-7,
    )


def _is_exported(case: Case) -> Iterator[Held]:
    with tempfile.TemporaryDirectory() as folder:
        case.orbit.save(Path(folder) / "hop.csv")
        case.orbit.page(Path(folder) / "hop.html")
        for path in Path(folder).iterdir():
            yield Held(f"{path.suffix} has something in it", float(path.stat().st_size > 1000), 1.0)
    law, values, _ = case.law
    law = springs.formula(law, **values) if isinstance(law, str) else law
    time, is_mechanism = 0.3 * case.orbit.flight_time, not isinstance(case.machine, HeavyHand)
    extension = parse(str(case.actuator_of(0).along) if is_mechanism else "w2")
    known = dict(zip(case.machine.model.flight.states, case.orbit(time), strict=True))
    known |= case.stated.parameters if is_mechanism else {}
    name = next(name for name in case.orbit.table() if name.startswith("spring force"))
    force = case.orbit.spring_forces([time])[name][0]
    yield Held("force of the spring", float(force), float(law(extension(**{n: known[n] for n in extension.names}))))


# The verbs, as functions of a case that yield the figures that they are held against.
VERBS: dict[str, Callable[[Case], Iterator[Held]]] = {
    "find": _finds,
    "follow": _follows,
    "sweep": _sweeps,
    "existence": _exists,
    "uncertainty": _is_uncertain,
    "sensitivities": _is_sensitive,
    "optimize": _is_optimised,
    "pareto": _has_a_front,
    "keep_hopping": _is_held,
    "recover": _recovers,
    "start_up": _starts_up,
    "ReturnMap": _maps,
    "multipliers": _has_multipliers,
    "bifurcations": _bifurcates,
    "simulate": _simulates,
    "casadi": _is_stated_in_casadi,
    "prove": _is_proved,
    "save, page": _is_exported,
}


class CellIsLong(Exception):
    """A cell takes more processor time than it may."""


@contextmanager
def processor_time(seconds: float) -> Iterator[None]:
    """Raise `CellIsLong` where the block takes more processor time, in seconds, on systems that can measure it."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    over = list[bool]()

    def interrupt(*_: object) -> None:
        # What computes without Python notes a keyboard interrupt, and ends.
        over.append(True)
        signal.raise_signal(signal.SIGINT)

    before = [signal.signal(signal.SIGINT, signal.default_int_handler), signal.signal(signal.SIGPROF, interrupt)]
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    except KeyboardInterrupt:
        if over:
            raise CellIsLong(f"it takes more than {seconds:g} s of processor time") from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for number, handler in zip((signal.SIGINT, signal.SIGPROF), before, strict=True):
            signal.signal(number, handler)


def cell_of(case: Case, verb: str) -> Cell:
    """The cell of a case and a verb."""
    try:
        with processor_time(LONGEST_CELL):
            return Cell(case.name, case.spring, verb, tuple(VERBS[verb](case)))
    except (OrbitsError, CellIsLong) as refusal:
        return Cell(case.name, case.spring, verb, (), str(refusal))


def cells(machines: Iterable[str], laws: Iterable[str], verbs: Sequence[str], known: Sequence[Cell]) -> Iterator[Cell]:
    """The cells of these machines, springs and verbs; those that are known are not tried again."""
    done = {cell[:3]: cell for cell in known}
    for law, machine in product(laws, machines):
        case = Case(machine, law)
        yield from (done.get((machine, law, verb)) or cell_of(case, verb) for verb in verbs)


def read(path: Path | None) -> list[Cell]:
    """The cells in a file of rows."""
    lines = path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []
    rows = [Cell(*json.loads(line)) for line in lines]
    return [cell._replace(held=tuple(Held(*each) for each in cell.held)) for cell in rows]


def diagonal() -> Iterator[Cell]:
    """Some cells, so that each machine, each spring and each verb occurs."""
    names, laws = list(MACHINES), list(SPRINGS)
    cases = [Case(name, laws[i % len(laws)]) for i, name in enumerate(names)]
    for j, verb in enumerate(VERBS):
        yield cell_of(cases[(j + 1) % len(cases)], verb)


def page(found: Sequence[Cell]) -> str:
    """The page of the documentation: a row for each verb, a column for each machine, in the cells the springs."""
    machines, verbs = ({getattr(cell, of): None for cell in found} for of in ("machine", "verb"))
    rows = [["", *machines], ["---"] * (len(machines) + 1)]
    for verb in verbs:
        each = [[cell for cell in found if (cell.verb, cell.machine) == (verb, name)] for name in machines]
        rows.append([f"`{verb}`", *map(_springs_of, each)])
    return "\n".join([HEAD, *(f"| {' | '.join(row)} |" for row in rows), ""])


def _springs_of(row: Sequence[Cell]) -> str:
    """The springs with which a machine takes a verb."""
    taken = [cell.spring for cell in row if cell.stands and not cell.refused]
    return "all" if len(taken) == len(SPRINGS) else ", ".join(taken) or "none"


def main() -> None:
    """Print what each cell does, and write the page of the documentation where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, known in (("machine", MACHINES), ("spring", SPRINGS), ("verb", VERBS)):
        parser.add_argument(f"--{name}", choices=known, action="append", help="only these")
    parser.add_argument("--rows", type=Path, help="file of rows, in which cells are noted and not tried again")
    parser.add_argument("--write", action="store_true", help="write the table of the documentation")
    options = parser.parse_args()
    known, found = read(options.rows), list[Cell]()
    names = options.machine or MACHINES, options.spring or SPRINGS, options.verb or [*VERBS]
    for cell in cells(*names, known):
        found.append(cell)
        off = [f"{each.name} {each.value:.12g}, not {each.other:.12g}" for each in cell.held if not each.agrees]
        text = cell.refused or "; ".join(off) or f"{len(cell.held)} figures agree"
        print(f"{cell.machine:16} {cell.spring:10} {cell.verb:14} {'' if cell.stands else 'WRONG: '}{text}", flush=True)
        if options.rows and cell not in known:
            with options.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(cell) + "\n")
    print(f"{sum(cell.stands for cell in found)} of {len(found)} cells stand")
    if options.write:
        TABLE.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
