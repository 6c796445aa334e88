"""Families of springs of random shape, each followed twice, the second time with half the step: is it the same curve?

The springs soften, so that most families fold, run off or lose their contact somewhere. The two curves must end in the
same way unless rounding ended one of them, have the same events at the same places and the same orbits at the same
values of the parameter, and every orbit must be of the family that was asked for.
Run: python studies/random_families.py [--count 200] [--seed 7]
"""

import argparse
from collections import Counter
from collections.abc import Iterator

import numpy as np

from orbits import Family, NoOrbit, find, follow
from problems import Hopper

LAWS = ("r + a*r**2 - s*c*r**3", "r + s*(tanh(b*r)/b - r)", "r + a*r**2 + s*c*r**5 - s*b*r**3/9")
ENDS = ("reached", "escaped", "degenerate", "homoclinic", "stuck")
# Where rounding ends a curve, half the step may bring it further.
LOST = "stuck"
# Values of s at which the two curves are compared.
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)


def random_springs(count: int, seed: int) -> Iterator[tuple[str, dict[str, float], int]]:
    """Formulas with their parameters and families: linear or nearly so at s = 0, softening as s grows."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        values = {"a": rng.normal(0, 0.05), "b": rng.uniform(0.1, 0.4), "c": rng.uniform(0.0, 0.02)}
        text = LAWS[rng.integers(len(LAWS))]
        yield text, {**{k: v for k, v in values.items() if f"{k}*" in text}, "s": 0.0}, int(rng.integers(1, 4))


def twice(text: str, parameters: dict[str, float], family: int) -> tuple[Family, Family] | None:
    """The family with a step and with half of it, None where it does not begin, which `find` must say too."""
    machine = Hopper(text, parameters=parameters)
    try:
        one, two = (follow(machine, "s", 1.0, family=family, at=PLACES, longest=step) for step in (0.05, 0.025))
        return one, two
    except NoOrbit:
        try:
            find(machine, family)
        except NoOrbit:
            return None
        raise


def differences(one: Family, two: Family, family: int) -> list[str]:
    """What is wrong with two curves that should be one, in words."""
    found = []
    ends = {one.end.kind, two.end.kind}
    if not ends <= set(ENDS) or (len(ends) > 1 and LOST not in ends):
        found.append(f"ends: {one.end} and {two.end}")
    if {point.family for point in (*one, *two)} != {family}:
        found.append("an orbit of another family")
    kinds = [[event.kind for event in curve.events] for curve in (one, two)]
    shared = min(map(len, kinds))  # where a curve that runs off is lost is a matter of rounding
    if kinds[0][:shared] != kinds[1][:shared] or (len(kinds[0]) != len(kinds[1]) and ends == {"reached"}):
        found.append(f"events: {kinds[0]} and {kinds[1]}")
        return found
    for a, b in zip(one.events, two.events, strict=False):
        if abs(a.point.value - b.point.value) > 1e-9 * (1 + abs(a.point.value)):
            found.append(f"{a.kind} at s = {a.point.value:.15g} and {b.point.value:.15g}")
        share = abs(a.point.alpha - b.point.alpha) / a.point.alpha
        if share > (1e-6 if a.kind in ("fold", "branch point") else 1e-9) + 2 * (a.point.error + b.point.error):
            found.append(f"{a.kind} with alpha = {a.point.alpha:.15g} and {b.point.alpha:.15g}")
    return found


def main(count: int, seed: int) -> int:
    """The number of families with which something is wrong."""
    ends, wrong, folds = Counter(), 0, 0
    for number, (text, parameters, family) in enumerate(random_springs(count, seed)):
        curves = twice(text, parameters, family)
        if curves is None:
            ends["none to begin with"] += 1
            continue
        ends[curves[0].end.kind] += 1
        folds += any(event.kind == "fold" for event in curves[0].events)
        for difference in differences(*curves, family):
            wrong += 1
            print(f"  {number}: family {family} of {text} with {parameters}: {difference}")
    print("  " + ", ".join(f"{kind}: {number}" for kind, number in ends.most_common()) + f"; with folds: {folds}")
    print(f"  {wrong} wrong of {count}")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="families")
    parser.add_argument("--seed", type=int, default=7, help="of the random springs")
    arguments = parser.parse_args()
    raise SystemExit(main(arguments.count, arguments.seed) > 0)
