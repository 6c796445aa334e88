"""Lossless hops of chains: N masses in a column joined by springs, the lowest landing plastically.

How many hops there are of chains of equal masses and linear springs, and how many of them are motions; two hops of
three masses; what becomes of hops of three masses as the springs harden or soften; and the loss beside a hop, which
goes with the power 4/3 of the distance, as for two masses, and is ten times as large on one side as on the other.
Run: python studies/chain.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find, find_all, follow, simulate
from orbits.show import COLOURS, legend_below, new_row, plot_orbit, save_figure
from orbits.show.style import NO_MOTIONS
from problems import Chain

LONGEST = 10.0
HARDENING = "r + b*r**3"
HIGHEST = 12.0  # launch speed in the figure


def counted(count: int) -> tuple[int, int]:
    """Hops of a chain of equal masses with half times up to `LONGEST` that are found, and how many are motions."""
    chain = Chain([1.0] * count)
    orbits = find_all(chain, chain.starts(LONGEST, LONGEST))
    return len(orbits), sum(orbit.admissible for orbit in orbits)


def losses(orbit, distances, name: str = "alpha") -> np.ndarray:
    """The energy lost in the next hop by launches this far from a lossless one in one of their unknowns."""
    chain, known = Chain(), dict(zip(("y1", "y1'", "liftoff", "alpha"), orbit(0.0)[:4], strict=True))
    runs = [simulate(chain, {**known, name: known[name] + d}, hops=1) for d in distances]
    return np.array([sum(event.loss for event in run.events) for run in runs])


def local_law(orbit, distances) -> np.ndarray:
    """C dE/dalpha d**(4/3) at distances in the speed of the mass above the lowest."""
    return orbit.certificate.loss_coefficient * Chain().masses[1] * orbit.alpha * np.abs(distances) ** (4 / 3)


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    numbers = {}
    for count in (2,) if quick else (2, 3, 4, 5, 6):
        numbers[f"hops {count}"], numbers[f"motions {count}"] = counted(count)
        print(f"  {count} masses: {numbers[f'hops {count}']} hops, of them {numbers[f'motions {count}']} motions")
    chain = Chain()
    first = find(chain, start=chain.start([-11.15, -3.02], 3.222, 2.460))
    second = find(chain, start=chain.start([-17.32, -11.0], 3.105, 4.488))
    numbers["alpha"] = first.alpha
    distances = np.geomspace(1e-6, 1e-3, 4)
    for side, d in (("above", distances), ("below", -distances)):
        ratios = losses(first, d) / local_law(first, d)
        numbers[f"law {side}"] = float(ratios[0])
        print(f"  losses {side} the hop beside C d^(4/3): " + ", ".join(f"{ratio:.4f}" for ratio in ratios))
    for name in ("y1", "y1'"):
        some = losses(first, np.array([1e-8, 1e-6]), name)
        numbers[f"exponent {name}"] = float(np.log10(some[1] / some[0]) / 2)
        print(f"  losses beside the hop in {name} go with the power {numbers[f'exponent {name}']:.4f}")
    one, two, three, four = new_row(2, 0.81, rows=2).ravel()
    for axes, orbit in ((one, first), (two, second)):
        plot_orbit(orbit, axes).set_title(f"three masses, launch speed {orbit.alpha:.5g}")
    hardening = Chain(springs=HARDENING, parameters={"b": 0.0})
    for axes, along, stops in ((three, "b", (0.03, -0.05)), (four, "m1", (3.0, 0.3))):
        for orbit, colour in ((first, COLOURS[0]), (second, COLOURS[1]))[: 1 if quick else 2]:
            for stop in stops[: 1 if quick else 2]:
                family = follow(hardening, along, stop, start=orbit, longest=0.05)
                values, speeds = np.array([(point.value, point.alpha) for point in family]).T
                good = np.array([point.admissible for point in family])
                known = axes.get_legend_handles_labels()[1]
                names = f"from {orbit.alpha:.5g}", NO_MOTIONS
                own, none = (None if name in known else name for name in names)
                none = none if (~good & (speeds < HIGHEST)).any() else None
                axes.plot(values, np.where(good, speeds, np.nan), color=colour, lw=2, label=own)
                if not good.all():
                    axes.plot(values, np.where(good, np.nan, speeds), color=colour, lw=1.2, ls="--", label=none)
                print(f"  from {orbit.alpha:.6g} towards {along} = {stop:g}: {family.end.kind}, {family.end.reason}")
    three.set(xlabel="nonlinearity b of r + b r³", ylabel="launch speed", title="two families", ylim=(0, HIGHEST))
    three.set_xticks([0.0, 0.01, 0.02, 0.03])
    four.set(xlabel="top mass m₁", ylabel="launch speed", title="the same in a mass", ylim=(0, HIGHEST))
    legend_below(three)
    legend_below(four)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(one, folder / 'chain.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer masses")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
