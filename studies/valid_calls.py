"""A valid call of every verb, every builder of machines, every law, the methods of every result and the live page.

`crafted_calls.py` replaces their arguments. A verb, method or law that is added to the project is added here, which a
test checks.
"""

import json
import random
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from inspect import Parameter, signature
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import casadi
import numpy as np

import orbits
import problems
from orbits import Family, Mechanism, Orbit, ReturnMap, follow
from orbits.control import Guess, Input, Stage
from orbits.model import Phase
from problems import Hopper, gravity, recordings, springs, steering


def _machines() -> dict[str, Callable[[], Any]]:
    """Machines of every kind, by name."""
    r, b = casadi.SX.sym("r"), casadi.SX.sym("b")
    table = [(0.25 * i, 0.25 * i + 0.02 * (0.25 * i) ** 3) for i in range(-60, 61)]
    return {
        "hopper": Hopper,
        "cubic": lambda: Hopper("cubic", rest_length=20, parameters={"beta": 0.3}),
        "damped": lambda: Hopper("cubic", damping=0.01, parameters={"beta": 0.3}),
        "juggler": lambda: problems.Juggler("r + beta*r**3", parameters={"beta": 0.3}),
        "in_si": lambda: problems.hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8),
        "function": lambda: Hopper(
            casadi.Function("f", [r, b], [r + b * r**3], ["r", "b"], ["f"]), parameters={"b": 0.3}
        ),
        "table": lambda: Hopper(springs.table(tuple(np.transpose(table)))),
        "asteroid": lambda: Hopper(gravity="1/(1 + z/R)**2", rest_length=20, parameters={"R": 150}),
        "hand": lambda: problems.HeavyHand("r + beta*r**3", parameters={"beta": 0.3}),
        "chain": lambda: problems.Chain(),
        "chain_hand": lambda: problems.chain_hand(),
        "knee": lambda: problems.knee_hopper(stiffness=3000.0),
        "inerter": lambda: problems.inerter_hopper(),
        "plate": lambda: problems.plate_hopper(parameters={"plate_stiffness": 50.0}),
        "wheel": lambda: problems.rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5),
        "rocker": lambda: problems.rocking_block(inertia_ratio=1.0, gravity_ratio=0.5),
        "shuttle": lambda: problems.shuttle(inertia_ratio=1.0),
        "runner": problems.runner,
        "two_feet": problems.alternating_hopper,
        "brachiator": problems.brachiator,
    }


MACHINES = _machines()
BUILDERS: dict[str, dict[str, Any]] = {
    "Hopper": {"spring": "r + beta*r**3", "mass_ratio": 1.0, "rest_length": 20.0, "parameters": {"beta": 0.3}},
    "Juggler": {"spring": "tanh", "mass_ratio": 1.0, "parameters": {"b": 0.2}},
    "HeavyHand": {"spring": "r + beta*r**3", "parameters": {"beta": 0.3}},
    "hopper_in_si": {"body_mass": 60.0, "foot_mass": 3.0, "stiffness": 8000.0, "rest_length": 0.8},
    "juggler_in_si": {"ball_mass": 0.1, "hand_mass": 1.0, "stiffness": 50.0},
    "Chain": {"masses": (1.0, 1.0, 1.0)},
    "chain_hand": {"masses": (1.0, 1.0, 1.0)},
    "plate_hopper": {"masses": (1.0, 1.0, 1.0), "parameters": {"plate_stiffness": 50.0}},
    "knee_hopper": {"stiffness": 3000.0},
    "inerter_hopper": {"inertance": 0.2},
    "rimless_wheel": {"inertia_ratio": 1.0, "gravity_ratio": 0.5, "angle": 0.3},
    "rocking_block": {"inertia_ratio": 1.0, "gravity_ratio": 0.5},
    "shuttle": {"inertia_ratio": 1.0},
    "runner": {"foot_mass": 0.1, "rest_length": 3.7},
    "walker": {"leg_mass": 0.1, "torso_inertia": 0.42},
    "alternating_hopper": {"foot_mass": 3.0, "rest_length": 45.0},
    "brachiator": {"arm_mass": 0.25},
}  # fmt: skip


@cache
def machine(name: str) -> Any:
    return MACHINES[name]()


@cache
def orbit(name: str = "cubic") -> Orbit:
    tuned: Any = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": 0.4}} if name == "runner" else {}
    start = orbits.starts(machine(name))[0] if name == "chain" else None
    return orbits.find(machine(name), start=start, **tuned)


@cache
def family() -> Family:
    return follow(Hopper("cubic"), "beta", stop=-0.02, start=0.0)


def fold() -> Any:
    return next(event.point for event in family().events if event.kind == "fold")


@cache
def best() -> Any:
    over = {"beta": (0.1, 0.5), "mass_ratio": (0.5, 2.0)}
    return orbits.optimize(machine("cubic"), minimise="alpha + period", over=over)


@cache
def held() -> Any:
    return steering.keep_hopping(Hopper(damping=0.01), intervals=8)


def exported(t: Any = None) -> Path:
    """The folder of an orbit for simulators, which is gone after the call."""
    with tempfile.TemporaryDirectory() as name:
        return orbit().export(name, t)


@cache
def energies() -> dict[str, Any]:
    """The arguments of a machine stated by its energies in SymPy, whose spring has a length."""
    from sympy import symbols
    from sympy.physics.mechanics import dynamicsymbols

    (y, z), (k, length) = dynamicsymbols("y z"), symbols("k length")
    T = sum(each.diff(dynamicsymbols._t) ** 2 for each in (y, z)) / 2
    V = k * (y - z - length) ** 2 / 2 + y + z
    stated = {"coordinates": (y, z), "gap": z, "parameters": {"k": 1.0, "length": 10.0}, "rest": {"y": length}}
    return {"T": T, "V": V, **stated}


# Machines that the live page shows under these names.
SCENES = ("juggler", "wheel", "rocker", "shuttle", "runner", "alternating-hopper")
# What a tab of the page sends.
ACTS = """
number spring gravity machine family floating rows rows-away branch noise along launch lowest undo stop place leave
""".split()  # noqa: SIM905


# ---- verbs


def calls(name: str, rng: random.Random) -> dict[str, Callable[[], tuple[Callable, dict[str, Any]]]]:
    """Valid calls of every verb with a machine of this name: functions that return the function and its arguments."""
    own, cubic, linear = machine(name), machine("cubic"), machine("hopper")
    p = next(iter(own.values), "mass_ratio")
    value = own.values.get(p, 1.0)
    over = {p: (value, 1.1 * value)}
    tuned = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": 0.4}} if name == "runner" else {}
    return {
        "find": lambda: (orbits.find, {"machine": own, **tuned}),
        "find_all": lambda: (orbits.find_all, {"machine": own, "fastest": 9.0, "limit": 5.0}),
        "follow": lambda: (follow, {"machine": own, "along": p, "stop": 1.05 * value, "longest": 0.5}),
        "trace": lambda: (
            lambda **a: [*islice(orbits.trace(**a), 50)], {"machine": own, "along": p, "stop": 1.05 * value},
        ),
        "follow_event": lambda: (
            orbits.follow_event,
            {"family": family(), "event": "fold", "second": "mass_ratio", "stop": 1.2, "longest": 0.5},
        ),
        "follow_fold": lambda: (
            orbits.follow_fold,
            {"machine": Hopper("cubic"), "fold": fold(), "along": "beta", "across": "mass_ratio", "stop": 1.2},
        ),
        "orbit_at": lambda: (
            orbits.orbit_at, {"machine": Hopper("cubic"), "point": family().points[0], "along": "beta"},
        ),
        "sweep": lambda: (orbits.sweep, {"machine": own, "over": over, "samples": 4}),
        "existence": lambda: (
            orbits.existence,
            {"machine": cubic, "along": "beta", "between": (-0.02, 0.1), "across": "rest_length", "values": [6.0, 9.0],
             "samples": 4},
        ),
        "uncertainty": lambda: (orbits.uncertainty, {"machine": own, "over": over, "samples": 8}),
        "optimize": lambda: (orbits.optimize, {"machine": cubic, "minimise": "alpha", "over": {"beta": (0.1, 0.5)}}),
        "design.follow": lambda: (best().follow, {"what": "mass_ratio <= 2", "to": 3.0}),
        "pareto": lambda: (
            orbits.pareto,
            {"machine": cubic, "minimise": ("alpha", "mass_ratio*period"), "points": 3,
             "over": {"beta": (0.1, 0.5), "mass_ratio": (0.5, 2.0)}},
        ),
        "quantities": lambda: (orbits.quantities, {"machine": cubic, "orbit": orbit(), "names": "period"}),
        "sensitivities": lambda: (orbits.sensitivities, {"machine": own}),
        "orbit_function": lambda: (orbits.orbit_function, {"machine": cubic, "over": "beta"}),
        "simulate": lambda: (orbits.simulate, {"machine": own, "alpha": 4.0, "hops": 2}),
        "multiplier": lambda: (orbits.multiplier, {"machine": own, "alpha": 4.6}),
        "multipliers": lambda: (orbits.multipliers, {"machine": own, "launch": 4.6}),
        "map": lambda: (ReturnMap, {"machine": own, "inject": 0.01}),
        "map.call": lambda: (ReturnMap(linear, 0.03).__call__, {"alpha": np.array([4.0, 5.0])}),
        "map.fixed_points": lambda: (ReturnMap(linear, 0.03).fixed_points, {"low": 4.0, "high": 5.0}),
        "map.periodic_hops": lambda: (ReturnMap(linear, 0.03).periodic_hops, {"period": 2, "low": 4.3, "high": 5.0}),
        "map.basins": lambda: (ReturnMap(linear).basins, {"low": 4.0, "high": 5.0}),
        "map.upkeep": lambda: (ReturnMap(linear).upkeep, {"alpha": 4.6}),
        "map.preimages": lambda: (ReturnMap(linear).preimages, {"edges": [(4.2, 4.4)], "low": 3.0, "high": 5.0}),
        "map.plot": lambda: (ReturnMap(linear, 0.03).plot, {"low": 4.0, "high": 5.0, "samples": 50}),
        "bifurcations": lambda: (
            orbits.bifurcations,
            {"machine": linear, "along": "inject", "span": (0.02, 0.03), "between": (4.3, 5.0), "samples": 40},
        ),
        "period_diagram": lambda: (
            orbits.period_diagram,
            {"machine": linear, "over": {"inject": (0.02, 0.03), "mass_ratio": (1.0, 1.1)}, "between": (4.3, 5.0),
             "samples": (2, 2), "hops": 64, "grid": 40},
        ),
        "hold": lambda: (orbits.hold, {"orbit": orbit("runner"), "along": "x"}),
        "keep_hopping": lambda: (steering.keep_hopping, {"machine": machine("damped"), "intervals": 6}),
        "control.follow": lambda: (held().follow, {"name": "damping", "to": 0.02}),
        "recover": lambda: (steering.recover, {"machine": linear, "short": 0.1, "intervals": 6}),
        "start_up": lambda: (steering.start_up, {"machine": linear, "pumps": 2, "stroke": 2.0, "intervals": 6}),
        "prove": lambda: (orbits.prove, {"orbit": orbit(), "digits": 12}),
        "prove_absence": lambda: (
            orbits.prove_absence, {"machine": Hopper("tanh", parameters={"b": 0.9}), "family": 1},
        ),
        "prove_fixed_point": lambda: (orbits.prove_fixed_point, {"machine": linear, "point": 4.6, "inject": "0.03"}),
        "check": lambda: (orbits.check, {"machine": own}),
        "starts": lambda: (orbits.starts, {"machine": own, "limit": 5.0}),
        "branch_points": lambda: (
            orbits.find_branch_points, {"machine": own, "over": over, "designs": 4, "limit": 5.0},
        ),
        "orbit.call": lambda: (orbit().__call__, {"t": [0.0, 1.0]}),
        "orbit.plot": lambda: (orbit().plot, {}),
        "orbit.page": lambda: (orbit().page, {"path": "new.html"}),
        "family.at": lambda: (family().at, {"value": -0.005}),
        "table": lambda: (springs.table, {"source": ([-9.0, -4.0, 0.0, 4.0, 9.0], [-9.0, -4.0, 0.0, 4.0, 9.0])}),
        "fit": lambda: (springs.fit, {"table": (np.arange(-9.0, 10.0), np.arange(-9.0, 10.0)), "formula": "k*r"}),
        "recordings.fit": lambda: (recordings.fit, record()),
        "export": lambda: (exported, {"t": [0.0, 1.0]}),
        "from_lagrangian": lambda: (lambda **a: orbits.find(Mechanism.from_lagrangian(**a), limit=5.0), energies()),
        "formula": lambda: (springs.formula, {"text": "r + beta*r**3"}),
        "follow.multipliers": lambda: (
            follow, {"machine": own, "along": p, "stop": 1.05 * value, "longest": 0.5, "multipliers": True},
        ),
        "follow.energy": lambda: (
            follow, {"machine": own, "along": "energy", "stop": (0.01, 0.1), "family": 1, "at": [0.05], "longest": 0.5},
        ),
        "find.energy": lambda: (
            orbits.find, {"machine": replace(own, restitution=1.0) if name == "cubic" else own, "at": {"energy": 0.1}},
        ),
        "follow.tuned": lambda: (
            follow, {"machine": machine("runner"), "along": "speed", "stop": 0.41, "start": orbit("runner"),
                     "tune": ("inertia", "hip_stiffness"), "longest": 0.5},
        ),
        "follow_branch": lambda: (
            orbits.follow_branch, {"machine": Hopper("cubic"), "branch": fold(), "along": "beta", "stop": -0.005},
        ),
        "actuator": lambda: (actuated, {"along": "y1 - y2", "kind": "force"}),
        "follow_branch_points": lambda: (
            orbits.follow_branch_points, {"point": branch_point(), "along": "rest_length", "values": [3.75]},
        ),
        "start_from_rest": lambda: (
            orbits.start_from_rest, {"machine": own, "positions": [0.0], "half_contact": 1.0, "half_flight": 4.0},
        ),
        "steer": lambda: (orbits.steer, cart()),
        "time_limit": lambda: (limited, {"seconds": 5.0, "machine": own}),
        "prove_fold": lambda: (orbits.prove_fold, {"machine": Hopper("cubic"), "fold": fold(), "along": "beta"}),
        "prove_doubling": lambda: (
            orbits.prove_doubling, {"machine": linear, "flip": flip(), "limit": 5.0},
        ),
        "page.link": lambda: (
            shown_by_link, {"spring": "cubic", "gravity": "1", "p.beta": "0.3", "family": "1"},
        ),
        "page.request": lambda: (
            requested,
            {"scene": name if name in SCENES else "hopper", "act": rng.choice(ACTS),
             "name": p, "value": rng.choice((2.0, 2, "cubic", True))},
        ),
        "method": lambda: method_of(rng),
        "law": lambda: law_of(rng),
    }  # fmt: skip


@cache
def _two_hops() -> dict[str, np.ndarray]:
    """Two recorded hops of a damped hopper."""
    run, t = orbits.simulate(Hopper(mass_ratio=0.4, damping=0.05), 6.0, hops=2), np.linspace(0.0, 20.0, 100)
    return {"time": t, "body height": run(t)[:, 0], "foot height": run(t)[:, 2]}


def record() -> dict[str, Any]:
    """The arguments of a fit of recorded hops."""
    start = Hopper(mass_ratio=0.5, damping=0.04)
    return {"machine": start, "source": dict(_two_hops()), "unknown": ("mass_ratio", "damping")}


# ---- methods of results

RESULTS: dict[str, Callable[[], Any]] = {
    "orbit": orbit,
    "orbit in SI": lambda: orbit("in_si"),
    "run": lambda: orbit("runner"),
    "family": family,
    "event curve": lambda: orbits.follow_event(family(), "fold", "mass_ratio", 1.1, longest=0.5),
    "design": best,
    "designs": lambda: best().follow("mass_ratio <= 2", 2.2, points=3),
    "front": lambda: orbits.pareto(
        machine("cubic"), minimise=("alpha", "mass_ratio*period"), points=3,
        over={"beta": (0.1, 0.5), "mass_ratio": (0.5, 2.0)},
    ),
    "control": held,
    "controls": lambda: held().follow("damping", 0.011),
    "sweep": lambda: orbits.sweep(machine("cubic"), {"beta": (0.1, 0.2)}, 4, progress=False),
    "existence": lambda: orbits.existence(
        machine("cubic"), "beta", (-0.02, 0.1), "rest_length", [6.0, 9.0], samples=4, progress=False
    ),
    "uncertainty": lambda: orbits.uncertainty(machine("cubic"), {"beta": (0.1, 0.2)}, samples=8, progress=False),
    "simulation": lambda: orbits.simulate(machine("damped"), 4.0, hops=2),
    "multipliers": lambda: orbits.multipliers(Hopper(), 4.6, inject=0.03),
    "periodic hop": lambda: ReturnMap(Hopper(), 0.03).periodic_hop(4.5),
    "hops": lambda: ReturnMap(Hopper(), inject=0.12).periodic_hops(2, 4.48, 4.63),
    "many hops": lambda: ReturnMap(Hopper(), inject=0.03)(np.linspace(4.4, 5.0, 20)),
    "diagram": lambda: orbits.bifurcations(Hopper(), "inject", (0.0, 0.1), (4.4, 4.7), sections=2, attractor=0),
    "periods": lambda: orbits.period_diagram(
        Hopper(), {"inject": (0.02, 0.03), "mass_ratio": (1.0, 1.1)}, (4.3, 5.0), samples=(2, 2), hops=64, grid=40
    ),
    "basins": lambda: ReturnMap(Hopper()).basins(4.0, 5.0, samples=50),
    "proof": lambda: orbits.prove(orbit("hopper")),
    "fit": lambda: springs.fit((np.arange(-9.0, 10.0), np.arange(-9.0, 10.0)), "k*r"),
    "hop fit": lambda: recordings.fit(**record()),
    "checked": lambda: orbits.check(Hopper()),
    "mechanism": lambda: machine("inerter"),
}  # fmt: skip
# The methods of these that are called, and arguments, by their names, of those that need some.
METHODS = """
__call__ animate at basins column contact_force dataframe disturbed export follow follow_event followed_by
force forces in_contact in_order inputs_at load members motions multipliers of_family orbit page periodic plot
plot_phase_portrait power prove quantiles quantity row save schedule sensitivity spring_forces statuses stretches
summary table unknown unrolled values_at verify with_values
""".split()  # noqa: SIM905
ARGUMENTS: Mapping[str, Any] = {
    "t": [0.0, 1.0], "path": "new.json", "folder": "new", "value": 0.1, "index": 0, "row": 0, "member": 0, "to": 0.011,
    "family": 1, "event": "flip", "second": "mass_ratio", "stop": 1.1, "what": "mass_ratio <= 2", "name": "alpha",
    "alpha": 4.6, "machine": Hopper("cubic"), "workers": 1,
}  # fmt: skip
OF_METHODS: Mapping[str, Mapping[str, Any]] = {
    "animate": {"path": "new.gif", "frames": 2}, "page": {"path": "new.html"}, "load": {"path": "orbit.json"},
    "follow": {"name": "damping"},
}  # fmt: skip


@cache
def result(name: str) -> Any:
    return RESULTS[name]()


def method_of(rng: random.Random) -> tuple[Callable, dict[str, Any]]:
    """A method of a result, and its arguments."""
    of = result(rng.choice([*RESULTS]))
    name = rng.choice([each for each in METHODS if callable(getattr(of, each, None))])
    method, known = getattr(of, name), {**ARGUMENTS, **OF_METHODS.get(name, {})}
    needed = [each.name for each in signature(method).parameters.values() if each.default is Parameter.empty]
    return method, {each: known[each] for each in (*needed, *OF_METHODS.get(name, ())) if each in known}


# ---- laws

LAWS = [
    *(springs.NAMED[name] for name in springs.NAMED), *(gravity.NAMED[name] for name in gravity.NAMED),
    springs.potential, springs.hysteretic, springs.lossy, springs.function, gravity.formula, gravity.function,
]  # fmt: skip


def law_of(rng: random.Random) -> tuple[Callable, dict[str, Any]]:
    """A hopper with a law, whose arguments are those of the law."""
    law = rng.choice(LAWS)
    parameters, stated = signature(law).parameters, {"extending": "r", "shortening": "0.9*r", "mean": "r"}
    named = {name for name, each in parameters.items() if each.kind is each.KEYWORD_ONLY}
    stated |= {"text": "r**2/2"} if law is springs.potential else {"text": "1"}
    stated |= {"force": lambda r: r, "ratio": lambda z: 1.0}
    known = {name: stated[name] for name in parameters if name in stated and name not in named}
    known |= {name: each.default for name, each in parameters.items() if isinstance(each.default, float)}

    def built(**arguments: Any) -> Orbit:
        first = [arguments.pop(name) for name in parameters if name in arguments and name not in named]
        made = law(*first, **arguments)
        pulls = law.__module__ == gravity.__name__
        return orbits.find(Hopper(gravity=made, rest_length=20) if pulls else Hopper(made), limit=5.0)

    return built, known


# ---- what has more than arguments


@cache
def branch_point() -> Any:
    over = {"inertia": (6.0, 8.0), "hip_stiffness": (5.0, 6.0)}
    return orbits.find_branch_points(machine("runner"), over, designs=6)[0]


def flip() -> Any:
    return next(event for event in result("diagram").events if event.kind == "flip")


def cart() -> dict[str, Any]:
    """The arguments of a cart that is steered over a unit of length."""
    phase = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - p["d"], x[1]]}
    stage = Stage(phase, 4, (1, 1), {"f": Input(degree=1)}, **ends, running=lambda x, p, q: p["f"] ** 2)
    return {"stages": [stage], "parameters": {"d": 1.0}, "guess": [Guess(1.0, lambda t: [t, 1.0])]}


def actuated(**stated: Any) -> Any:
    driven = problems.Actuated(Hopper(damping=0.01), problems.Actuator(**stated))
    return steering.keep_hopping(driven.machine, actuator=driven.actuator, intervals=6)


def limited(seconds: Any, machine: Any) -> Orbit:
    with orbits.time_limit(seconds):
        return orbits.find(machine)


def shown_by_link(**words: Any) -> list:
    """What the live page computes first for a link with these words."""
    from problems.explorer.forms import scene_of_link
    from problems.explorer.results import hop_results

    query = {name: [str(each).encode(errors="surrogateescape")] for name, each in words.items()}
    return list(hop_results(None, scene_of_link(query), True))


def requested(scene: str, **message: Any) -> str:
    """The state of the live page of a scene after a message from its tab, its hops computed in this process."""
    from bokeh.document import Document

    from problems.explorer import beginning
    from problems.explorer.page import Explorer
    from problems.explorer.worker import COMPUTATIONS, Done, Failure

    def in_this_process(page: Explorer, receive: Callable[[Any, object], None], calm: bool = False) -> Any:
        def ask(task: Any) -> None:
            try:
                for each in COMPUTATIONS[task.name](None, *task.arguments):
                    receive(task, each)
                receive(task, Done())
            except orbits.OrbitsError as error:
                receive(task, Failure(str(error)))

        return SimpleNamespace(ask=ask, stop=lambda: None)

    with mock.patch.object(Explorer, "_worker", in_this_process):
        page = Explorer(Document(), beginning(scene))
        page._receive(json.dumps({"n": 1, **message}, default=str))
        page._compute_surroundings()
    state = json.loads(page._bridge.page_state)
    if state["problems"]:
        raise orbits.InputError(str(state["problems"]))
    return page._bridge.page_state
