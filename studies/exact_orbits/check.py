"""Check the cases: python studies/exact_orbits/check.py [NAME ...]

`build.py` computes the numbers with Taylor series. This program shares no code with it: it reads a text by `reader.py`
and integrates by SciPy's DOP853 in doubles, from the recorded states after each event to the next recorded event. These
have to agree to 1e-12 of the largest number:

- all samples, and the states before all events; those after them are the resets of those before
- guards are zero at the recorded times of their events, and no guard is past its zero earlier
- what is conserved stays constant along all steps of the integration
- the conditions of the orbit are zero for the recorded unknowns
- the named numbers have the values of their formulas of recorded times and states

Doubles cannot check later digits: on these the two computations of `build.py` agree. Then the times of events and the
samples are compared with those of the toolkit, or with closed forms. The exit code is 1 if a case disagrees.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from studies.exact_orbits.comparison import BOUND, Comparison
from studies.exact_orbits.doubles import Arc, Doubles, State
from studies.exact_orbits.reader import Case
from studies.exact_orbits.toolkit import compared

CASES = Path(__file__).parent / "cases"
PAST_ZERO = {"falling": -1, "rising": 1}  # the sign of a guard that is past its zero
# Relative bounds of numbers that are small differences of large ones, so that doubles have fewer digits of them: speeds
# of 4.5 lose 2e-4, 2e-5, 4e-8 or 8e-11 near a graze, and the impact speed has the factor sqrt(1 - (1 - 1e-6)**2).
WIDER = {
    **{("graze_below_4", name): 1e-10 for name in ("lost", "ratio")},
    **{("graze_above_4", name): 1e-10 for name in ("lost", "ratio")},
    **{("graze_above_6", name): 1e-7 for name in ("lost", "ratio")},
    **{("graze_above_8", name): 1e-5 for name in ("lost", "ratio")},
    ("impact_graze", "first_speed_in_closed_form"): 1e-10,
}


def _state(what: str, x: State, stated: State, size: float) -> Comparison:
    """The comparison of states with those in a file, of the same names."""
    same = x.keys() == stated.keys()
    return Comparison(what, max(abs(x[name] - stated[name]) for name in x) if same else float("inf"), BOUND * size)


def _rates(case: Case, motion: Doubles, arc: Arc, k: int) -> Comparison:
    """The comparison of the integrated derivatives, where arc k begins, with those that the reader evaluates."""
    (field, _), mode, (time, x) = motion.mode(arc.begin["mode"]), case["modes"][arc.begin["mode"]], arc.steps[0]
    found = zip(mode["states"], field(time, [x[name] for name in mode["states"]]), strict=True)
    read = case.at(mode["derivatives"], time, x)
    return Comparison(f"derivatives in arc {k}", max(abs(rate - read[name]) for name, rate in found), 0.0)


def _ending(case: Case, arc: Arc, k: int, size: float) -> Iterator[Comparison]:
    """Compare event k, with which an arc ends, with its statement."""
    event, (time, x) = arc.event, arc.steps[-1]
    stated = next(each for each in case["modes"][arc.begin["mode"]]["events"] if each["event"] == event["event"])
    yield Comparison(f"mode after event {k}", float(event["mode"] != stated["next"]), 0.0)
    yield _state(f"before event {k}", x, event["before"], size)
    known = event["before"] | case.at(stated.get("reset", {}), time, event["before"])
    after = {name: known[name] for name in case["modes"][stated["next"]]["states"]}
    yield _state(f"after event {k}", after, event["after"], size)
    if time == arc.begin["time"]:
        past = PAST_ZERO[stated["direction"]] * case.at(stated["guard"], time, x)
        yield Comparison(f"guard of event {k}, which is past its zero", float(past <= 0), 0.0)


def _guards(case: Case, arc: Arc, k: int) -> Iterator[Comparison]:
    """Compare the guards in arc k with 0: at the event that ends it, and wherever they are past it."""
    for each in case["modes"][arc.begin["mode"]]["events"]:
        values = [PAST_ZERO[each["direction"]] * case.at(each["guard"], time, x) for time, x in arc.steps]
        bound = BOUND * max(1.0, *map(abs, values))
        yield Comparison(f"guard of {each['event']} in arc {k}", max(0.0, *values), bound)
        if arc.event and each["event"] == arc.event["event"]:
            yield Comparison(f"guard of event {k}", abs(values[-1]), bound)


def _conserved(case: Case, arcs: list[Arc]) -> Iterator[Comparison]:
    """How far each conserved quantity varies between the events at which it may change."""
    for name, stated in case.get("conserved", {}).items():
        values = []
        for arc in arcs:
            text = stated["text"] if isinstance(stated["text"], str) else stated["text"].get(arc.begin["mode"])
            values += [case.at(text, time, x) for time, x in arc.steps] if text else []
            if values and (arc.event is None or arc.event["event"] in stated.get("changes_at", ())):
                yield Comparison(f"conserved {name}", max(values) - min(values), BOUND * max(1.0, *map(abs, values)))
                values = []


def again(case: Case) -> Iterator[Comparison]:
    """Compare every number of a case with those integrated in doubles."""
    motion = Doubles(case)
    arcs = list(motion.arcs())
    states = [each["state"] for each in case["samples"]] + [each["before"] for each in case["events"]]
    size = max(1.0, *(abs(x) for each in states for x in each.values()))
    for k, arc in enumerate(arcs, 1):
        yield _rates(case, motion, arc, k)
        for sample, x in arc.samples:
            yield Comparison(f"mode at {sample['time']}", float(sample["mode"] != arc.begin["mode"]), 0.0)
            yield _state(f"at {sample['time']}", x, sample["state"], size)
        if arc.event:
            yield from _ending(case, arc, k, size)
        if not arc.event or arc.event["time"] > arc.begin["time"]:
            yield from _guards(case, arc, k)
    yield Comparison("number of samples", float(sum(len(arc.samples) for arc in arcs) != len(case["samples"])), 0.0)
    yield from _conserved(case, arcs)
    for k, leg in enumerate(case.get("orbit", {}).get("legs", ()), 1):
        time, x = motion.leg(leg)
        for text in leg["conditions"]:
            yield Comparison(f"condition {text} of leg {k}", abs(case.at(text, time, x)), BOUND * size)
    for name, each in case["numbers"].items():
        difference = abs(motion.number(each["formula"], arcs[-1].steps[-1]) - each["value"])
        yield Comparison(name, difference, WIDER.get((case["name"], name), BOUND) * abs(each["value"]))


def check(path: Path) -> list[list[Comparison]]:
    """Compare a case with its motion in doubles, and with the toolkit's or its closed form."""
    return [[*again(Case(path))], [*compared(path)]]


def main(names: list[str]) -> int:
    """Print a table of the named cases, or all; returns the exit code."""
    paths = [CASES / f"{name}.json" for name in names] or sorted(CASES.glob("*.json"))
    print(f"{'case':32} {'numbers':>7} {'of doubles':>14}   {'numbers':>7} {'of the toolkit':>18}")
    agreeing = 0
    for path in paths:
        both = check(path)
        wrong = [each for comparisons in both for each in comparisons if not each.agrees]
        worst = [max((each.difference for each in comparisons), default=0.0) for comparisons in both]
        counts = [len(comparisons) for comparisons in both]
        print(f"{path.stem:32} {counts[0]:7} {worst[0]:14.1e}   {counts[1]:7} {worst[1]:18.1e}")
        for each in wrong:
            print(f"    {each.what}: differs by {each.difference:.2e}, more than {each.bound:.1e}")
        agreeing += not wrong
    print(f"{agreeing} of {len(paths)} cases agree")
    return int(agreeing < len(paths))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="of cases; all by default")
    sys.exit(main(parser.parse_args().names))
