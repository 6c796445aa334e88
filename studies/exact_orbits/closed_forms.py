"""Cases of machines that this toolkit does not state, against their motion between two events in closed form."""

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from math import acosh, atan, cos, cosh, exp, expm1, pi, sin, sinh, sqrt

from studies.exact_orbits.comparison import BOUND, Comparison, compared_motion
from studies.exact_orbits.reader import Case

State = Mapping[str, float]


def between_events(
    flow: Callable[[Case, str, float, State, float], State], times: Callable[[Case], list[float]] | None = None
) -> Callable[[Case], Iterator[Comparison]]:
    """The comparison of each state with the motion in closed form since the event before.

    flow : the states of a mode at a time, of the states at an earlier time
    times : of the events; None where they have no closed form
    """

    def compared(case: Case) -> Iterator[Comparison]:
        start = {"time": case["start"]["time"], "mode": case["start"]["mode"]}
        arcs = [start | {"after": case.at(case["start"]["state"])}, *case["events"]]
        size = max(1.0, *(abs(x) for each in case["samples"] for x in each["state"].values()))
        for k, (last, each) in enumerate(pairwise(arcs), 1):
            reached = flow(case, last["mode"], last["time"], last["after"], each["time"])
            difference = max(abs(reached[name] - x) for name, x in each["before"].items())
            yield Comparison(f"before event {k}", difference, BOUND * size)

        def states_at(time: float) -> State:
            last = [arc for arc in arcs if arc["time"] <= time][-1]
            return flow(case, last["mode"], last["time"], last["after"], time)

        timed = case["events"] if times else []
        known = times(case) if times else []
        yield from compared_motion({"events": timed, "samples": case["samples"]}, known, states_at)

    return compared


def _oscillates(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """A forced oscillator: the steady response, and a damped vibration."""
    damping, frequency = case.at("damping_ratio"), case.at("frequency")
    force = case.at(case["modes"][mode]["derivatives"]["speed"], 0.0, {"place": 0.0, "speed": 0.0})
    stiff, viscous = 1 - frequency**2, 2 * damping * frequency
    share = force / (stiff**2 + viscous**2)

    def steady(t: float) -> tuple[float, float]:
        c, s = cos(frequency * t), sin(frequency * t)
        return share * (stiff * c + viscous * s), share * frequency * (viscous * c - stiff * s)

    (place, speed), (later_place, later_speed) = steady(since), steady(time)
    a, u, own, t = x["place"] - place, x["speed"] - speed, sqrt(1 - damping**2), time - since
    b, c, s, left = (u + damping * a) / own, cos(own * t), sin(own * t), exp(-damping * t)
    return {
        "place": later_place + left * (a * c + b * s),
        "speed": later_speed + left * ((own * b - damping * a) * c - (own * a + damping * b) * s),
    }


def _slender(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """A slender block: from the angle at which it topples its distance grows as a hyperbolic cosine."""
    top, t = 1.0 if mode == "right_edge" else -1.0, time - since
    a, b = x["tilt"] - top, x["tilt_rate"]
    return {"tilt": top + a * cosh(t) + b * sinh(t), "tilt_rate": a * sinh(t) + b * cosh(t)}


def _slender_landings(case: Case) -> list[float]:
    """By Housner's formulas: a quarter of a rock down, and each time the next tilt up and down."""
    tilt, left, time, found = case.at("released"), case.at("rate_left"), 0.0, []
    for _ in case["events"]:
        time += acosh(1 / (1 - tilt))
        found.append(time)
        tilt = 1 - sqrt(1 - left**2 * (1 - (1 - tilt) ** 2))
        time += acosh(1 / (1 - tilt))
    return found


def _steadily(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """Constant accelerations."""
    slopes, t = case["modes"][mode]["derivatives"], time - since
    rates = case.at(slopes, since, x)
    return {name: x[name] + t * rates[name] + t**2 / 2 * rates.get(slopes[name], 0.0) for name in x}


def _shaken(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """A block that sticks moves with the table."""
    if mode != "sticks":
        return _steadily(case, mode, since, x, time)
    moved = -case.at("acceleration") * (sin(time) - sin(since))
    return {"place": x["place"] + moved, "speed": case.at("table_speed", time)}


def _on_a_belt(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """A block that slips swings about the place where the spring balances kinetic friction."""
    if mode == "sticks":
        return _steadily(case, mode, since, x, time)
    middle, c, s = case.at("kinetic"), cos(time - since), sin(time - since)
    a, u = x["place"] - middle, x["speed"]
    return {"place": middle + a * c + u * s, "speed": u * c - a * s}


def _slips_and_sticks(case: Case) -> list[float]:
    excess, belt, time, found = case.at("static - kinetic"), case.at("belt"), case.at("static/belt"), []
    for k in range(len(case["events"])):
        found.append(time)
        time += 2 * excess / belt if k % 2 else 2 * pi - 2 * atan(excess / belt)
    return found


def _dragged(case: Case, mode: str, since: float, x: State, time: float) -> State:
    """A fall through air that drags in proportion to the speed, which tends to -g/c."""
    c, t, final = case.at("c"), time - since, case.at("-g/c")
    lost = -expm1(-c * t)
    return {"y": x["y"] + final * t + (x["v"] - final) * lost / c, "v": x["v"] + (final - x["v"]) * lost}


def _bounces(case: Case) -> list[float]:
    left = case.at("restitution")
    return [sqrt(2.0) * (1 + 2 * sum(left**j for j in range(1, k))) for k in range(1, len(case["events"]) + 1)]


def _in_a_box(case: Case) -> Iterator[Comparison]:
    """Impacts at the odd multiples of pi/2, and a triangular wave between them."""

    def states_at(time: float) -> State:
        phase = (time + pi / 2) % (2 * pi)
        return {"place": pi / 2 - phase if phase < pi else phase - 3 * pi / 2, "velocity": -1.0 if phase < pi else 1.0}

    return compared_motion(case, [pi / 2 + k * pi for k in range(len(case["events"]))], states_at)


CLOSED_FORMS: dict[str, Callable[[Case], Iterator[Comparison]]] = {
    "impact_oscillator": between_events(_oscillates),
    "impact_graze": between_events(_oscillates),
    "housner_slender": between_events(_slender, _slender_landings),
    "body_in_a_box": _in_a_box,
    "dragged_ball": between_events(_dragged),
    "ball_on_a_slope": between_events(_steadily),
    "bouncing_ball": between_events(_steadily),
    "stick_slip": between_events(_on_a_belt, _slips_and_sticks),
    "shaken_block": between_events(_shaken),
    "rolling_ball": between_events(_steadily, lambda case: [case.at("2*(first_speed - first_spin)/(7*friction)")]),
    "spinning_bounces": between_events(_steadily, _bounces),
}
