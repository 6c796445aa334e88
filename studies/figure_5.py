"""Fig. 5 of the paper: the return map of the linear hopper for mass ratios from light to heavy feet.

(a) M = 1. (b) Its first fixed point, enlarged: it attracts from above only, and the loss below is ten times as large.
(c) A light foot, whose map is close to the identity. (d) A heavy foot, whose map is close to the identity too, except
for throws from pi on, which end in long bouncing. The second curve counts the impacts of these throws, up to 102 for M
= 1000; their number grows without bound with M. On a hand of infinite mass, bouncing with one period is stable for
throws up to sqrt(pi^2 + 3) = 3.587. For larger throws every other bounce is higher, up to throws of 3.72496. There the
lower bounce comes when the hand accelerates downwards at g, and the hand catches the ball.
Run: python studies/figure_5.py [--output FOLDER] [--quick]
"""

import argparse
from functools import cache
from pathlib import Path

import numpy as np

from orbits import ReturnMap, find
from orbits.show import COLOURS, new_row, save_figure
from problems import HeavyHand, Hopper

LIGHT, HEAVY = 0.02, 1e3
# Where linear theory ends stable bouncing on a hand of infinite mass (Schaal and Atkeson 1993, as cited in the paper).
EDGE = np.sqrt(np.pi**2 + 3)


def right_edge(machine) -> float:
    """The throw between 3.6 and 3.8 beyond which there is no long bouncing any more."""
    step, low, high = ReturnMap(machine, cap=20), 3.6, 3.8
    while high - low > 1e-10:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if step(middle).status == "cap" else (low, middle)
    return low


@cache
def worst_loss(mass_ratio: float) -> float:
    """The largest share of the launch energy that one hop from 4.5 to 20 loses."""
    hops = ReturnMap(Hopper(mass_ratio=mass_ratio))(np.linspace(4.5, 20, 5000))
    return float((hops.loss / hops.alpha**2).max())


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    panels = new_row(2, 0.92, rows=2)
    samples, more = (100, 400) if quick else (1200, 4000)
    orbit = find(Hopper())
    ReturnMap(Hopper()).plot(1.0, 12.0, panels[0, 0], samples=more)
    near = 0.02
    ReturnMap(Hopper()).plot(orbit.alpha - near, orbit.alpha + near, panels[0, 1], samples=more)
    panels[0, 1].set_ylim(orbit.alpha - 6 * near, orbit.alpha + near)
    ReturnMap(Hopper(mass_ratio=LIGHT)).plot(1.0, 12.0, panels[1, 0], samples=more)
    heavy = ReturnMap(Hopper(mass_ratio=HEAVY))
    heavy.plot(2.9, 3.8, panels[1, 1], samples=samples)
    panels[1, 1].set_ylim(2.4, 3.8)
    other = panels[1, 1].twinx()
    alpha = np.linspace(2.9, 3.8, samples)
    other.plot(alpha, heavy(alpha).impacts, color=COLOURS[1], lw=0.8)
    other.set_ylabel("impacts", color=COLOURS[1])
    for axes, words in zip(
        panels.flat, ("(a) M = 1", "(b) M = 1, enlarged", f"(c) M = {LIGHT:g}", f"(d) M = {HEAVY:g}"), strict=True
    ):
        axes.set_title(words)
    numbers = {
        "next at 4": float(ReturnMap(Hopper())(4.0).next),
        "impacts at 3.4": int(heavy(3.4).impacts),
        **{f"edge {M:g}": right_edge(Hopper(mass_ratio=M)) for M in ((1e3,) if quick else (1e3, 1e4))},
        "edge inf": right_edge(HeavyHand()),
        "light loss": worst_loss(LIGHT) / LIGHT,
        "lighter loss": worst_loss(1e-4) / 1e-4,
    }
    print(
        f"\n  M = 1: 4 goes to {numbers['next at 4']:.12g}; M = {HEAVY:g}: 3.4 has {numbers['impacts at 3.4']} impacts"
    )
    for name, edge in numbers.items():
        if name.startswith("edge"):
            print(f"  M = {name[5:]}: bouncing up to {edge:.8f}; sqrt(pi^2 + 3) = {EDGE:.8f}")
    print(f"  light feet: a hop loses at most {numbers['lighter loss']:.4f} M of its energy, M = 1e-4")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels.flat[0], folder / 'figure_5.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer launches")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
