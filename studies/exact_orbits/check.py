"""Check the cases: python studies/exact_orbits/check.py [NAME ...]

Every number of a case is computed again from its text and its unknowns with 40 digits, and has to agree to its stated
error; the conditions of the orbit have to vanish, and what is conserved has to stay so. Where the toolkit can state the
machine, its answers are compared as well. The exit code is 1 if a case disagrees.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from flint import arb

from studies.exact_orbits.motion import Problem, conserved
from studies.exact_orbits.series import Options, State, read
from studies.exact_orbits.toolkit import Comparison, compared

CASES = Path(__file__).parent / "cases"
DIGITS = 40
LEFT = 1e-33  # of conditions that vanish, and of differences of what is conserved


def _number(what: str, x: arb, stated: str, error: str) -> Comparison:
    """The comparison of a number with the one in a file."""
    return Comparison(what, float(abs(x - arb(str(stated)))), float(error))


def _state(what: str, x: State, stated: Mapping[str, str], error: str) -> Iterator[Comparison]:
    """The comparisons of states."""
    for name in x.keys() | stated.keys():
        yield _number(f"{name} {what}", x[name], stated[name], error)


def again(document: Mapping[str, Any]) -> Iterator[Comparison]:
    """Compute every number of a case again, by the second program."""
    problem = Problem(document, Options(digits=DIGITS))
    for k, left in enumerate(problem.residuals(), 1):
        yield Comparison(f"condition {k} of the orbit", float(abs(left)), LEFT)
    motion = problem.motion()
    for k, (event, each) in enumerate(zip(motion.events, document["events"], strict=True), 1):
        same = (event.name, event.mode) == (each["event"], each["mode"])
        yield Comparison(f"kind of event {k}", float(not same), 0.0)
        yield _number(f"time of event {k}", event.time, each["time"], each["time_error"])
        yield from _state(f"before event {k}", event.before, each["before"], each["error"])
        yield from _state(f"after event {k}", event.after, each["after"], each["error"])
    for each in document["samples"]:
        mode, state = motion.at(arb(str(each["time"])))
        yield Comparison(f"mode at {each['time']}", float(mode != each["mode"]), 0.0)
        yield from _state(f"at {each['time']}", state, each["state"], document["error"])
    for name, x in problem.numbers(motion).items():
        yield _number(name, x, document["numbers"][name]["value"], document["numbers"][name]["error"])
    for name, spread in conserved(problem, motion):
        yield Comparison(f"conserved {name}", float(spread), LEFT)


def check(path: Path) -> list[list[Comparison]]:
    """Compare the numbers of a case, of both programs, with what its file states."""
    return [[*again(read(path))], [*compared(path)]]


def main(names: list[str]) -> int:
    """Print a table of the named cases, or all; returns the exit code."""
    paths = [CASES / f"{name}.json" for name in names] or sorted(CASES.glob("*.json"))
    print(f"{'case':32} {'numbers':>7} {'largest error':>14}   {'toolkit':>7} {'largest difference':>18}")
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
