"""The machines of cases as this toolkit states them: its orbits and its simulations, in the coordinates of the cases.

The equations of a case are written by hand, and those of a machine here follow from its masses, springs and gaps.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import pi
from types import MappingProxyType
from typing import Any

import numpy as np

from orbits import Mechanism, Orbit, Proof, find, prove, simulate, start_from_rest
from orbits.mechanics import Mass, Spring
from problems import (
    Chain,
    HeavyHand,
    Juggler,
    chain_hand,
    inerter_hopper,
    knee_hopper,
    plate_hopper,
    rimless_wheel,
    rocking_block,
    runner,
    shuttle,
)
from studies.exact_orbits.comparison import BOUND, Comparison, compared_motion
from studies.exact_orbits.reader import Case

Coordinates = Mapping[str, Mapping[str, float]]
CHAOS = 1e-6  # bound of the chaotic case, whose bounces make 1e-8 of an error of 1e-16
ANGLES = {"phi": {"phi": 1.0}, "theta": {"theta": 1.0}}
TWO_FEET = Mechanism(
    ("body", "mean", "half"),
    [
        Mass("body", 1.0), Mass("mean + half", "m"), Mass("mean - half", "m"),
        Spring("body - mean - half", "r"), Spring("body - mean + half", "r"),
    ],
    gaps={"left": "mean + half", "right": "mean - half"}, reversor={"half": "-half"}, symmetry={"half": "-half"},
    parameters={"m": 4.0}, launch="body", name="body on two feet",
)  # fmt: skip
# A machine has a spring and a gap: a spring without stiffness does nothing, and a mass that falls from afar lands late.
PASSIVE_WHEEL = Mechanism(
    ("phi", "theta"),
    [Spring("phi", "0*r"), Mass("cos(theta - angle + slope)", 1.0, across="sin(theta - angle + slope)")],
    inertia={"phi": 1.0}, gravity=1.0, angles=("phi", "theta"), parameters={"angle": pi / 8, "slope": 0.08},
    reversor=None, symmetry={"theta": "theta - 2*angle", "phi": "phi - 2*angle"},
    gaps={"rear foot": "theta", "front foot": "2*angle - theta"}, name="wheel down a slope",
)  # fmt: skip
SOLID_BLOCK = Mechanism(
    ("phi", "theta"),
    [Spring("phi"), Mass("h*cos(theta) + b*sin(theta)", 3.0, across="h*sin(theta) - b*cos(theta)")],
    inertia={"phi": 1.0, "theta": "b**2 + h**2"}, gravity=9.80665, angles=("phi", "theta"),
    parameters={"b": 0.05, "h": 0.2}, symmetry={"theta": "-theta", "phi": "-phi"}, gaps={"edge": "theta"},
    name="solid block",
)  # fmt: skip
ARMS = Mechanism(
    ("held", "free", "far"),
    [
        Mass("far", 1.0), Spring("held", "0*r"), Mass("-cos(held)/2", "m", across="sin(held)/2"),
        Mass("-cos(held)", "1 - 2*m", across="sin(held)"),
        Mass("-cos(held) - cos(free)/2", "m", across="sin(held) + sin(free)/2"),
    ],
    inertia={"held": "m/12", "free": "m/12"}, gravity=1.0, angles=("held", "free"), gap="far", parameters={"m": 0.25},
    name="two arms",
)  # fmt: skip
WALKER = Mechanism(
    ("stance", "swing", "torso", "far"),
    [
        Mass("far", 1.0), Mass("cos(stance)", "1 - 2*m", across="sin(stance)"),
        Mass("cos(stance) - cos(swing)", "m", across="sin(stance) - sin(swing)"),
        Spring("torso - stance", "k*r"), Spring("torso - swing", "k*r"),
    ],
    inertia={"torso": "inertia"}, gravity=1.0, angles=("stance", "swing", "torso"), gap="far",
    parameters={"m": 0.1, "inertia": 0.41824193818688386, "k": 0.39402694221511943}, name="two legs",
)  # fmt: skip


def same(*names: str) -> Coordinates:
    """Coordinates that a case calls as the machine does."""
    return {name: {name: 1.0} for name in names}


def _states(x: np.ndarray, names: tuple[str, ...], coordinates: Coordinates) -> dict[str, float]:
    """States of a case by name; a speed of `name` is called `name_speed` or `name_rate`."""
    known, found = dict(zip(names, np.ravel(x).tolist(), strict=False)), {}  # in contact there may be fewer
    for name, parts in coordinates.items():
        if not parts.keys() <= known.keys():
            continue
        found[name] = sum(factor * known[part] for part, factor in parts.items())
        speed = sum(factor * known[f"{part}'"] for part, factor in parts.items())
        found |= {f"{name}_speed": speed, f"{name}_rate": speed}
    return found


def from_mid_contact(
    orbit: Callable[[], Orbit], coordinates: Coordinates, unrolled: bool = False
) -> Callable[[Case], Iterator[Comparison]]:
    """The comparison of a case that starts in mid-contact with an orbit.

    coordinates : of the case, each a sum of the machine's
    unrolled : the case does not count each cycle from the foot that lands
    """

    def compared(case: Case) -> Iterator[Comparison]:
        found = orbit()
        half = found.contact_time / 2
        cycle = [half, half + found.flight_time]
        times = [cycle[k % 2] + k // 2 * found.period for k in range(len(case["events"]))]

        def states_at(time: float) -> dict[str, float]:
            since = (time - half) % ((2 if unrolled else 1) * found.period)
            return _states(found.unrolled(since) if unrolled else found(since), found.flight.names, coordinates)

        return compared_motion(case, times, states_at)

    return compared


def simulated(
    machine: Any, start: Sequence[str], coordinates: Coordinates, added: Mapping[str, str] = MappingProxyType({}), *,
    mirrored: bool = False, first: bool = False, bound: float = BOUND,
) -> Callable[[Case], Iterator[Comparison]]:  # fmt: skip
    """The comparison of a case with a simulation.

    start : (n,) the states of the machine, as formulas of those of the case at its start
    coordinates : of the case, each a sum of the machine's
    added : formulas that are added to these
    mirrored : the machine changes the sign of its coordinates at each event, and the case does not
    first : the simulation has no events of the case, so that the comparison ends at the first one
    """

    def compared(case: Case) -> Iterator[Comparison]:
        x, events = case.at(case["start"]["state"]), [] if first else case["events"]
        end = case["events"][0]["time"] if first else case.at(case["end"])
        run = simulate(machine, state=[case.at(text, 0.0, x) for text in start], time=end)
        more = case.at({**added})

        def states_at(time: float) -> dict[str, float]:
            sign = (-1.0) ** sum(each["time"] <= time for each in events) if mirrored else 1.0
            found = _states(run(time), machine.model.flight.states, coordinates)
            return {name: sign * value + more.get(name, 0.0) for name, value in found.items()}

        samples = [each for each in case["samples"] if each["time"] <= end]
        return compared_motion(
            {"events": events, "samples": samples}, [each.time for each in run.events], states_at, bound
        )

    return compared


def on_table(restitution: float, bound: float = BOUND) -> Callable[[Case], Iterator[Comparison]]:
    """A ball on a vibrating table, which is a heavy hand that is balanced at -1."""
    start = ("ball - 1", "ball_speed", "table - 1", "table_speed")
    return simulated(HeavyHand(restitution=restitution), start, {"ball": {"w1": 1.0}}, {"ball": "1"}, bound=bound)


def _rests(machine: Any, *guess: Any) -> Callable[[], Orbit]:
    """The orbit near a state of rest in mid-contact and the half durations of contact and of flight."""
    return lambda: find(machine, start=start_from_rest(machine, *guess))


BALL = {"ball": {"w1": 1.0}, "hand": {"w2": 1.0}}
# Orbits with the coordinates of their cases.
ORBITS: dict[str, tuple[Callable[[], Orbit], Coordinates]] = {
    "juggler_cubic": (lambda: find(Juggler("r + 0.1*r**3", mass_ratio=0.5)), BALL),
    "chain_three": (
        _rests(Chain(), (-11.15, -3.016), 3.222, 2.46), {"top": {"y1": 1}, "middle": {"y2": 1}, "foot": {"y3": 1}},
    ),
    "chain_hand": (
        _rests(chain_hand(), (-3.479, 8.217), 1.066, 2.889), {**same("ball", "hand"), "base": {"y3": 1.0}},
    ),
    "inerter": (lambda: find(inerter_hopper()), same("body", "foot")),
    "knee": (lambda: find(knee_hopper()), same("foot", "knee")),
    "plate": (
        _rests(plate_hopper(parameters={"plate_stiffness": 10.0}), (-4.7919, 0.26877), 2.0712, 2.4387),
        same("body", "foot", "plate"),
    ),
    "alternating_hopper": (
        lambda: find(TWO_FEET),
        {**same("body"), "left": {"mean": 1.0, "half": 1.0}, "right": {"mean": 1.0, "half": -1.0}},
    ),
    "wheel_small": (lambda: find(rimless_wheel()), ANGLES),
    "wheel": (lambda: find(rimless_wheel(angle=0.3)), ANGLES),
    "rocker_small": (lambda: find(rocking_block()), ANGLES),
    "rocker": (lambda: find(rocking_block(angle=0.3)), ANGLES),
    "shuttle": (lambda: find(shuttle(angle=0.3)), ANGLES),
    "runner": (
        lambda: find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4}),
        {"height": {"z": 1.0}, "leg": {"l": 1.0}, "angle": {"theta": 1.0}, "pitch": {"phi": 1.0}},
    ),
}  # fmt: skip
PROOFS: dict[str, Callable[[], Proof]] = {
    name: lambda orbit=orbit: prove(orbit()) for name, (orbit, _) in ORBITS.items()
}
MACHINES: dict[str, Callable[[Case], Iterator[Comparison]]] = {
    **{
        name: from_mid_contact(orbit, coordinates, unrolled=name == "alternating_hopper")
        for name, (orbit, coordinates) in ORBITS.items()
    },
    "heavy_hand": from_mid_contact(lambda: find(HeavyHand()), BALL),
    "heavy_hand_bounces": simulated(HeavyHand(), ("ball", "ball_speed", "hand", "hand_speed"), BALL),
    **dict.fromkeys(
        ("wheel_down_slope", "wheel_slows_down", "wheel_rocks"),
        simulated(
            PASSIVE_WHEEL, ("0", "0", "theta - slope + half_angle", "theta_rate"), same("theta"),
            {"theta": "slope - half_angle"},
        ),
    ),
    "housner": simulated(SOLID_BLOCK, ("0", "0", "tilt", "tilt_rate"), {"tilt": {"theta": 1.0}}, mirrored=True),
    "brachiator": simulated(
        ARMS, ("held", "held_rate", "free", "free_rate", "100", "0"), same("held", "free"), first=True
    ),
    "walker": simulated(
        WALKER, ("stance", "stance_rate", "swing", "swing_rate", "torso", "torso_rate", "100", "0"),
        same("stance", "swing", "torso"), first=True,
    ),
    "table_period_one": on_table(0.8),
    "table_period_two": on_table(0.8),
    "table_chaos": on_table(0.8, CHAOS),
    "table_sticks": on_table(0.0),
}  # fmt: skip
