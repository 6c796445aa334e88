"""The hoppers and jugglers of cases as this toolkit states them, and what it proves of their motions."""

from collections.abc import Callable, Iterator, Mapping
from itertools import groupby
from typing import Any

from orbits import Orbit, Proof, ReturnMap, find, prove, prove_fixed_point, simulate
from problems import Hopper, Juggler, hopper_in_si, springs
from studies.exact_orbits.comparison import BOUND, Comparison, compared_motion
from studies.exact_orbits.reader import Case

STATES = ("y1", "v1", "y2", "v2")  # of the cases, in the order of those of the machines
CUBIC, QUINTIC = "r + beta*r**3", "r + beta*r**3 + delta*r**5"
TABLE = (
    [-4.8, -4.0, -3.2, -2.4, -1.6, -0.8, 0.0, 0.6, 1.2, 1.8, 2.5, 3.4],
    [-16.1, -10.4, -6.45, -3.75, -2.0, -0.85, 0.0, 0.62, 1.38, 2.35, 3.9, 6.6],
)
ROVER = {"force": "k1*r + k3*r**3", "surface_gravity": 1e-4, "rest_length": 0.6, "body_radius": 250.0}

ORBITS: dict[str, Callable[[], Orbit]] = {
    "linear_hop": lambda: find(Hopper(rest_length=20)),
    "ten_hops": lambda: find(Hopper(rest_length=20)),
    "third_family_hop": lambda: find(Hopper(mass_ratio=0.2, rest_length=40), 3),
    "heavy_foot_hop": lambda: find(Hopper(mass_ratio=5, rest_length=20), 2),
    "high_hop": lambda: find(Hopper(rest_length=100), 20),
    "cubic_hop": lambda: find(Hopper(CUBIC, mass_ratio=0.5, rest_length=10, parameters={"beta": 0.3})),
    "softening_hop": lambda: find(Hopper(CUBIC, rest_length=20, parameters={"beta": -0.005})),
    "quintic_hop": lambda: find(
        Hopper(QUINTIC, mass_ratio=2, rest_length=20, parameters={"beta": -0.1, "delta": 0.01})
    ),
    "bilinear_hop": lambda: find(Hopper(springs.bilinear(ratio=3, gap=0.5), rest_length=20)),
    "end_stop_hop": lambda: find(Hopper(springs.end_stops(gap=2, stop=10), mass_ratio=0.5, rest_length=20)),
    "table_hop": lambda: find(Hopper(springs.table(TABLE, noise=0), rest_length=20)),
    "air_spring_hop": lambda: find(Hopper(springs.air(length=10, exponent=1.4), rest_length=10)),
    "exponential_hop": lambda: find(
        Hopper("(exp(b*r) - 1)/b", gravity="exp(-z/H)", mass_ratio=5, rest_length=30, parameters={"b": 0.2, "H": 60})
    ),
    "saturating_hop": lambda: find(
        Hopper("tanh(b*r)/b", gravity="1 - kappa*z", rest_length=25, parameters={"b": 0.2, "kappa": 0.01})
    ),
    "inverse_square_hop": lambda: find(Hopper(gravity="1/(1 + z/R)**2", rest_length=20, parameters={"R": 150})),
    "asteroid_hop": lambda: find(hopper_in_si(2.5, 0.5, parameters={"k1": 0.05, "k3": 0.1}, **ROVER), 15),
    "linear_juggler": lambda: find(Juggler(mass_ratio=0.9)),
}
# Of each case with loss the machine, what an injection adds at each launch, and the bound of differences. Beside a
# graze the time of landing moves by the rounding of the launch speed times the power -2/3 of the distance.
RUNS: dict[str, tuple[Mapping[str, Any], float, float]] = {
    "plastic_hops": ({}, 0.0, BOUND),
    "bounce_and_rest": ({}, 0.0, BOUND),
    "plastic_rest": ({}, 0.0, BOUND),
    "mass_ratio_two": ({"mass_ratio": 2}, 0.0, BOUND),
    "mass_ratio_half": ({"mass_ratio": 0.5}, 0.0, BOUND),
    "forty_four_impacts": ({"mass_ratio": 1000}, 0.0, BOUND),
    "restitution_hop": ({"restitution": 0.3}, 0.0, BOUND),
    "damped_hop": ({"damping": 0.01, "drag": 0.005}, 0.0, BOUND),
    "kept_up_hop": ({}, 0.03, BOUND),
    "alternating_hops": ({}, 0.08, BOUND),
    "graze_above_2": ({}, 0.0, BOUND),
    "graze_above_4": ({}, 0.0, BOUND),
    "graze_above_6": ({}, 0.0, BOUND),
    "graze_above_8": ({}, 0.0, 1e-10),
    "graze_below_4": ({}, 0.0, BOUND),
}


def _lossless(orbit: Callable[[], Orbit]) -> Callable[[Case], Iterator[Comparison]]:
    """The comparison with an orbit."""

    def compared(case: Case) -> Iterator[Comparison]:
        found = orbit()
        ends = (found.flight_time, found.period)
        times = [ends[k % 2] + k // 2 * found.period for k in range(len(case["events"]))]
        return compared_motion(case, times, lambda t: dict(zip(STATES, found(t % found.period).tolist(), strict=True)))

    return compared


def _run(machine: Mapping[str, Any], inject: float, bound: float) -> Callable[[Case], Iterator[Comparison]]:
    """The comparison with a simulation of a hopper, in which a landing with a lift-off at once is one event."""

    def compared(case: Case) -> Iterator[Comparison]:
        launch, end = case.at(case["start"]["state"])["v1"], case.at(case["end"])
        run = simulate(Hopper(**machine), launch, time=end, inject=inject)
        events = [{"time": time} for time, _ in groupby(each["time"] for each in case["events"])]
        motion = {"events": events, "samples": case["samples"]}
        return compared_motion(
            motion, [each.time for each in run.events], lambda t: dict(zip(STATES, run(t).tolist(), strict=True)), bound
        )

    return compared


def _attracts() -> Proof:
    """What is proved of the launches above the lossless one."""
    return prove(find(Hopper(rest_length=20)), attraction=True)


def _comes_back(injection: str, near: float, hops: int) -> Proof:
    """What is proved of hops that an injection keeps up."""
    return prove_fixed_point(Hopper(), ReturnMap(Hopper(), inject=float(injection)).periodic_hop(near, hops), injection)


HOPPERS = {name: _lossless(orbit) for name, orbit in ORBITS.items()} | {
    name: _run(*each) for name, each in RUNS.items()
}
PROOFS: dict[str, Callable[[], Proof]] = {
    **{name: lambda orbit=orbit: prove(orbit()) for name, orbit in ORBITS.items()},
    **dict.fromkeys(("ten_hops", "graze_above_2", "graze_above_4", "graze_above_6", "graze_above_8"), _attracts),
    "kept_up_hop": lambda: _comes_back("0.03", 4.52, 1),
    "alternating_hops": lambda: _comes_back("0.08", 4.57, 2),
}
