"""How many hops of random springs are proved, how fast and how narrowly, and is a false claim ever proved?

Springs are drawn as in `stress`, families 1 to 3 in turn. An admissible hop counts as proved where the whole theorem
is: it exists, is unique nearby, is of its family, and is a motion. For an inadmissible one a condition has to be
refuted. False claims are those of `false_claims`, of ten kinds. Last, the spring's parameter is an interval, and the
width of the enclosure of alpha is compared with that of the range of alpha.
Run: python studies/theorems.py [--output FOLDER] [--quick]"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import NoOrbit, Orbit, Proof, find, prove, time_limit
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper
from studies.false_claims import KINDS, OUT_OF_TIME, PROVED, REFUSED, false_claims
from studies.stress import random_laws

REST_LENGTH = 30.0
CUBIC = Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": 0.3})
FALLING = Hopper("sinh(r)", "1/(1 + z/R)**2", rest_length=8.0, parameters={"R": 50.0})
HALF_WIDTHS = np.logspace(-9, -2, 8)
# The most seconds of all false claims together.
LONGEST = 1e6
# The index of the half width for which the ratio of widths is printed.
NARROW = 3


def hops(count: int, seed: int = 20) -> Iterator[Orbit]:
    """Hops of random springs; families that a spring does not have are left out."""
    for index, (text, parameters) in enumerate(random_laws(count, seed)):
        try:
            yield find(Hopper(text, rest_length=REST_LENGTH, parameters=parameters), 1 + index % 3)
        except NoOrbit:
            continue


def is_right(orbit: Orbit, proof: Proof) -> bool:
    """Whether an admissible orbit is proved, or a condition of an inadmissible one refuted."""
    return proof.proved if orbit.admissible else "refuted" in proof.conditions.values()


def fastest(orbit: Orbit, repeats: int = 5, **options) -> float:
    """The least processor time of several proofs, in ms; others are longer where further processes run."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        prove(orbit, **options)
        times.append(time.process_time() - began)
    return 1e3 * min(times)


def widths(half_widths: np.ndarray) -> list[tuple[float, float]]:
    """The width of the enclosure of alpha, 0 where it is not proved, and that of the range of alpha, for each relative
    half width of the interval of beta."""
    orbit, found = find(CUBIC), []
    for half in half_widths:
        low, high = float(0.3 * (1 - half)), float(0.3 * (1 + half))
        proof = prove(orbit, parameters={"beta": (low, high)}, motion=False)
        ends = [prove(find(CUBIC.with_values(beta=beta)), motion=False).alpha for beta in (low, high)]
        true = abs(float(ends[0].low) - float(ends[1].low)) if half > 1e-8 else half * _slope() * 0.6
        found.append((proof.alpha.width if proof.alpha else 0.0, true))
    return found


def _slope() -> float:
    """The derivative of alpha by beta, by differences."""
    up, down = (find(CUBIC.with_values(beta=0.3 * (1 + sign * 1e-4))).alpha for sign in (1, -1))
    return abs(up - down) / (2 * 0.3 * 1e-4)


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    count, wrong, repeats = (5, 3, 1) if quick else (1000, 3000, 5)
    half_widths = HALF_WIDTHS[NARROW : NARROW + 1] if quick else HALF_WIDTHS
    cubic = find(CUBIC)
    numbers: dict[str, object] = {
        "existence_ms": fastest(cubic, repeats, motion=False),
        "motion_ms": fastest(cubic, repeats),
        "falling_ms": fastest(find(FALLING), min(repeats, 2)),
        "digits_ms": fastest(cubic, min(repeats, 2), digits=50, motion=False),
    }
    orbits = list(islice(hops(2 * count), count))
    proofs = [prove(orbit) for orbit in orbits]
    right = [is_right(orbit, proof) for orbit, proof in zip(orbits, proofs, strict=True)]
    numbers |= {"hops": len(orbits), "admissible": sum(orbit.admissible for orbit in orbits), "proved": sum(right)}
    with time_limit(LONGEST):  # Orbits have more than the usual time: the limits are those of the proofs.
        false = [(claim, claim.verdict()) for claim in false_claims(wrong)]
    made = Counter((claim.kind, verdict) for claim, verdict in false)
    believed = [claim for claim, verdict in false if verdict == PROVED]
    late = sum(verdict == OUT_OF_TIME for _, verdict in false)
    numbers |= {"wrong": len(false), "wrong_proved": len(believed), "out_of_time": late}
    enclosed, true = np.array(widths(half_widths)).T
    numbers["width_ratio"] = float(np.divide(enclosed, true)[half_widths == HALF_WIDTHS[NARROW]][0])
    print(f"cubic spring: existence {numbers['existence_ms']:.0f} ms, a motion {numbers['motion_ms']:.0f} ms,", end=" ")
    print(f"50 digits {numbers['digits_ms']:.0f} ms; sinh under inverse square gravity {numbers['falling_ms']:.0f} ms")
    print(f"random springs: {sum(right)} of {len(orbits)} proved or refuted, of {len(false)} false claims", end=" ")
    print(f"{len(believed)}; enclosure over true range {numbers['width_ratio']:.2f}")
    for kind in KINDS:
        print(f"  {kind}: " + ", ".join(f"{made[kind, each]} {each}" for each in (PROVED, REFUSED, OUT_OF_TIME)))
    for claim in believed:
        print(f"  proved, and false: {claim.kind}, {claim.what}")
    for orbit, proof, fine in zip(orbits, proofs, right, strict=True):
        if not fine:
            print(f"  {orbit!r}: {'; '.join(proof.reasons)}")
    panels = new_row(2, 0.81)
    milliseconds = [1e3 * proof.seconds for proof in proofs]
    bins = np.geomspace(0.9 * min(milliseconds), 1.1 * max(milliseconds), 30)
    panels[0].hist(milliseconds, bins=bins, color=COLOURS[0])
    panels[0].set(xscale="log", xlabel="time of a proof (ms)", ylabel="hops of random springs")
    ticks = [tick for tick in (100, 200, 500, 1000, 2000, 5000, 10000) if bins[0] <= tick <= bins[-1]]
    panels[0].set_xticks(ticks, [str(tick) for tick in ticks])
    panels[0].set_xticks([], minor=True)
    proved = enclosed > 0
    panels[1].loglog(half_widths, true, color=COLOURS[1], label="range of α")
    panels[1].loglog(half_widths[proved], enclosed[proved], "o", color=COLOURS[0], label="proved enclosure")
    panels[1].set(xlabel="half width of the interval of β, relative", ylabel="width")
    panels[0].set_title("what a proof takes")
    panels[0].locator_params(axis="y", integer=True)
    panels[1].set_title("how wide an enclosure is")
    legend_below(panels[1])
    print(save_figure(panels[0], folder / "theorems.png"))
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="a few springs")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
