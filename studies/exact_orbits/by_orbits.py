"""The cases by this toolkit, which simulates those that its machines are; it has no tolerance to sweep."""

from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from inspect import signature
from typing import Any

from orbits import Mechanism, simulate
from orbits.mechanics import Damper, Inerter, Mass, Spring
from problems import HeavyHand, Hopper, gravity, knee_hopper, rimless_wheel, rocking_block, shuttle, springs
from studies.exact_orbits.automaton import Automaton, Found
from studies.exact_orbits.blocks import Block
from studies.exact_orbits.bodies import EXPRESSIONS, bodies_of
from studies.exact_orbits.reader import Case

try:
    VERSION = f"persistent-orbits {version('persistent-orbits')}"
except PackageNotFoundError:
    VERSION = "persistent-orbits"
WAYS = {"simulate": (0.0,)}
TURNS, HAND = ("phi", "phi_rate", "theta", "theta_rate"), ("ball", "ball_speed", "hand", "hand_speed")
NAMED = {
    **dict.fromkeys(("wheel", "wheel_small"), (rimless_wheel, TURNS)),
    **dict.fromkeys(("rocker", "rocker_small"), (rocking_block, TURNS)),
    **dict.fromkeys(("heavy_hand", "heavy_hand_bounces"), (HeavyHand, HAND)),
    "shuttle": (shuttle, TURNS), "knee": (knee_hopper, ("foot", "foot_speed", "knee", "knee_rate")),
}  # fmt: skip
RENAMED = {"gravity": "surface_gravity"}
HOPS = ("y1", "v1", "y2", "v2")


def prepared(case: Case, way: str) -> Callable[[float], Callable[[], Found]]:
    """A function of nothing that returns the simulation of a case."""
    start = {name: float(x) for name, x in case.at(case["start"]["state"]).items()}
    times = [each["time"] for each in case["samples"]]
    begin = float(case["start"]["time"])
    machine, names, how = _named(case, start) or _hopper(case, start) or _of_bodies(case, start)

    def run() -> Found:
        motion = simulate(machine, **how, time=(times[-1] - begin) * 1.0001)
        states = motion([t - begin for t in times]).tolist()
        found, times_of_events = (
            Found(),
            [each.time + begin for each in motion.events if each.time + begin <= times[-1]],
        )
        found.states = [dict(zip(names, state, strict=True)) for state in states]
        if times_of_events and case["events"]:
            name = case["events"][-1]["event"]
            found.last = name, sum(each["event"] == name for each in case["events"]), times_of_events[-1]
        return found

    run()  # compiles
    return lambda setting: run


def _named(case: Case, start: dict[str, float]) -> tuple[Any, tuple[str, ...], dict[str, Any]] | None:
    """A machine with a name, the names of its states in the case, and the start for `simulate`; None for another."""
    if case["name"] not in NAMED:
        return None
    machine, names = NAMED[case["name"]]
    p = {name: float(case.at(text)) for name, text in case["parameters"].items()}
    known = signature(machine).parameters
    own = {RENAMED.get(name, name): x for name, x in p.items() if RENAMED.get(name, name) in known}
    missing = {"theta": 0.0, "theta_rate": 0.0, "foot": 0.0, "foot_speed": 0.0}
    missing |= {"ball": start.get("hand"), "ball_speed": start.get("hand_speed")}
    return machine(**own), names, {"state": [start.get(name, missing.get(name)) for name in names]}


def _hopper(case: Case, start: dict[str, float]) -> tuple[Any, tuple[str, ...], dict[str, Any]] | None:
    """A hopper, the names of its states in the case, and the start for `simulate`; None for another machine."""
    p = {name: float(case.at(text)) for name, text in case["parameters"].items()}
    states, formulas = next(iter(case["modes"].values()))["states"], case["formulas"]
    if case["units"] == "SI" or tuple(states) != HOPS or "force" not in formulas:
        return None
    symbols = Automaton(case, EXPRESSIONS)
    force, others = symbols.function("force"), {"y2": 0.0, "v1": 0.0, "v2": 0.0}
    own: dict[str, Any] = {name: p[name] for name in ("damping", "drag") if name in p}
    own |= {"restitution": p["e"]} if "e" in p else {}
    if "gravity2" in formulas:
        weight = symbols.function("gravity2")
        own |= {"gravity": gravity.function(lambda z: weight({"y2": z})), "rest_length": p["ell"]}
    how = {"alpha": start["v1"]} | ({"inject": p["injection"]} if "injection" in p else {})
    return Hopper(springs.function(lambda r: force({**others, "y1": r})), mass_ratio=p["M"], **own), HOPS, how


def _of_bodies(case: Case, start: dict[str, float]) -> tuple[Any, tuple[str, ...], dict[str, Any]]:
    """A machine of bodies on one line with one contact, its names and its start, likewise."""
    try:
        bodies = bodies_of(case)
    except NotImplementedError:
        raise NotImplementedError("not in this script") from None
    if isinstance(bodies, Block) or len(bodies.contacts) > 1 or len(bodies.joints) < 2 or bodies.moving:
        raise NotImplementedError("not in this script")
    (above, below), names = bodies.contacts[0], tuple(bodies.masses)
    elements: list[Any] = [Mass(name, mass) for name, mass in bodies.masses.items()]
    elements += [Damper(name, drag) for name, drag in bodies.drag.items() if drag]
    for each in bodies.springs:
        extension = f"{each.above} - {each.below}" if each.below else each.above
        for place, coefficients, side in each.cubics:
            if side or place:
                raise NotImplementedError("not in this script")
            a, b, c = coefficients
            elements.append(Spring(extension, f"{a!r}*r + {b!r}*r**2 + {c!r}*r**3" if b or c else f"{a!r}*r"))
        elements += [Inerter(extension, each.inertance)] if each.inertance else []
        elements += [Damper(extension, each.damping)] if each.damping else []
    gap = f"{above} - {below}" if below else above
    machine = Mechanism(names, elements, gap=gap, surface_gravity=bodies.gravity, restitution=bodies.restitution)
    state = [x for name in names for x in bodies.start(start)[name]]
    return machine, tuple(each for name in names for each in bodies.states[name]), {"state": state}
