"""Families of springs of random shape, each followed twice, the second time with half the step: is it the same curve?
And families of cubic, quintic and septic springs up to their barrier: is every launch speed within its error?

The random springs soften, so that most families fold, run off or lose their contact somewhere. The two curves must end
in the same way unless rounding ended one of them, have the same events at the same places and the same orbits at the
same values of the parameter, and every orbit must be of the family that was asked for.

The others, r + d r**power, harden first and then soften. Each family folds, turns back towards d = 0 and escapes, while
its motions stay ever longer near the barrier of the spring. Their launch speeds are held against quadrature in 40
digits; no event may happen that cannot, and no orbit may be of another family.
Run: python studies/random_families.py [--count 200] [--seed 7] [--quick]
"""

import argparse
from collections import Counter
from collections.abc import Iterator

import mpmath as mp
import numpy as np

from orbits import Family, NoOrbit, find, follow
from problems import Hopper

LAWS = ("r + a*r**2 - s*c*r**3", "r + s*(tanh(b*r)/b - r)", "r + a*r**2 + s*c*r**5 - s*b*r**3/9")
ENDS = ("reached", "escaped", "degenerate", "homoclinic", "stuck")
# Where rounding ends a curve, half the step may bring it further.
LOST = "stuck"
# Values of s at which the two curves are compared.
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
# The families of springs with a barrier, by the power, and those of the quick run.
WITH_BARRIER = {
    3: (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24, 30),
    5: (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24),
    7: (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20),
}
QUICK = {5: (10,), 7: (1,)}
# What happens to such a family: its contact is lost, the masses meet, and it folds once.
EVENTS = {"collapse", "masses touch", "fold"}
DIGITS = 40


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


def late(power: int, d: float, family: int, alpha: mp.mpf) -> mp.mpf:
    """How much later than after half a flight a spring r + d r**power has the last turn of a family.

    The extension turns at the amplitude a. With r = a sin(x), and 2 (E - V) = (a**2 - r**2) q, the time is the integral
    of q**-0.5 over x, which has no singularity.
    """
    m, c = (power + 1) // 2, 2 * mp.mpf(d) / (power + 1)
    liftoff = mp.findroot(lambda r: r + d * r**power - 1, 1)
    energy = alpha**2 + liftoff**2 + c * liftoff ** (power + 1)  # twice the energy
    # From this side of the square of the amplitude Newton's method comes to it without a step beyond.
    excess, slope = lambda s: s + c * s**m - energy, lambda s: 1 + m * c * s ** (m - 1)
    square = mp.findroot(excess, energy, solver="newton", df=slope, maxsteps=200)
    # With s = sin(x)**2, (1 - s**m)/(1 - s) is a sum of powers.
    size = c * square ** (m - 1)

    def time(begin: mp.mpf, end: mp.mpf) -> mp.mpf:
        q = lambda x: 1 + size * mp.fsum(mp.sin(x) ** (2 * i) for i in range(m))  # noqa: E731
        return mp.quad(lambda x: 1 / mp.sqrt(q(x)), [begin, end])

    begun = mp.asin(liftoff / mp.sqrt(square))
    first = time(begun, mp.pi / 2)
    return first + 2 * family * (time(mp.mpf(0), begun) + first) - alpha


def share_of_error(power: int, family: int, d: float, alpha: float, error: float) -> float:
    """How far the launch speed of an orbit is off, as a share of its stated error."""
    with mp.workdps(DIGITS):
        # A faster launch may pass the barrier.
        here, beside = (late(power, d, family, mp.mpf(alpha) - step) for step in (0.0, error))
        return float(abs(here / (beside - here)))


def to_the_barrier(power: int, family: int) -> Family:
    """A family of the spring r + d r**power, from d = 1e-3 to its end."""
    machine = Hopper(f"r + d*r**{power}", rest_length=90.0, parameters={"d": 1e-3})
    return follow(machine, "d", -0.1, family=family)


def faults_at_the_barrier(families: dict[int, tuple[int, ...]], every: int = 1) -> int:
    """The number of faults of families by power; of their orbits, `every` one is checked, and the last ten are."""
    faults, checked, largest = 0, 0, 0.0
    for power, numbers in families.items():
        for number in numbers:
            found = to_the_barrier(power, number)
            points = [*found][:-10:every] + [*found][-10:]
            shares = [share_of_error(power, number, point.value, point.alpha, point.error) for point in points]
            kinds = [event.kind for event in found.events]
            faults += sum(share > 1 for share in shares) + len({*kinds} - EVENTS) + max(kinds.count("fold") - 1, 0)
            faults += sum(point.family != number for point in found) + (found.end.kind != "escaped")
            checked, largest = checked + len(shares), max(largest, *shares)
            print(f"  power {power}, family {number}: {len(found)} points, off by {max(shares):.2g} of the error")
    print(f"  {checked} launch speeds in {DIGITS} digits: off by at most {largest:.2g} of their error; {faults} faults")
    return faults


def main(count: int, seed: int, quick: bool = False) -> int:
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
    return wrong + (faults_at_the_barrier(QUICK, every=20) if quick else faults_at_the_barrier(WITH_BARRIER))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="families")
    parser.add_argument("--seed", type=int, default=7, help="of the random springs")
    parser.add_argument("--quick", action="store_true", help="two families up to a barrier, and not forty")
    arguments = parser.parse_args()
    raise SystemExit(main(arguments.count, arguments.seed, arguments.quick) > 0)
