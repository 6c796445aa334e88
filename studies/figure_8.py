"""Fig. 8 of the paper: energy added or taken at every hop, M = 1; and what happens after the fixed point loses
stability.

An injection eps lifts the map through the identity line: there is a stable fixed point above the lossless launch speed,
and an unstable one below it. The upper fixed point loses its stability when the map's slope is -1, curve (d). Its basin
reaches from the unstable fixed point to the other launch that maps onto that point. This basin grows with eps to both
sides; among the injections with a stable fixed point it is widest at (d).

The paper does not study larger injections. The right panel shows hops that repeat every second time, stable up to eps =
0.113429. Their further doubling differs from that of smooth maps, because the map's tip at the lossless launch has
unbounded curvature. From eps = 0.11155 on hops of period four coexist with them, double in turn, become chaotic and
vanish at 0.11295. From 0.113429 on the hops are chaotic, with windows, up to eps = 0.138812. There the highest launch
falls onto the unstable fixed point. Beyond it no launch stays above this point: launches come to rest or to slow hops.
Run: python studies/figure_8.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import NoOrbit, ReturnMap, find, multiplier
from orbits.numerics import bracketed_root
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper
from studies.period_four import crisis

MACHINE = Hopper()
LOW, HIGH = 4.3, 5.3


@cache
def pair(eps: float) -> tuple[float, float]:
    """The unstable and the stable fixed point of an injection."""
    low, high = ReturnMap(MACHINE, inject=eps).fixed_points(LOW, HIGH)
    return low.alpha, high.alpha


@cache
def marginal() -> float:
    """The injection at which the slope at the upper fixed point is -1."""
    return slope_is(-1.0, 0.02, 0.12)


def slope_is(value: float, low: float, high: float) -> float:
    """The injection between two at which the slope at the upper fixed point has a value."""

    def excess(eps: float) -> float:
        return multiplier(MACHINE, pair(eps)[1]) - value

    return bracketed_root(excess, low, high, excess(low), excess(high), width=1e-13)


def basin(eps: float) -> tuple[float, float]:
    """The launches round the stable fixed point that stay between it and the unstable one's other preimage."""
    low, high = pair(eps)
    step = ReturnMap(MACHINE, inject=eps)
    far = lambda alpha: float(step(alpha).next) - low  # noqa: E731
    return low, bracketed_root(far, high, HIGH, far(high), far(HIGH))


def visited(injections, start: float, settle: int, keep: int = 64) -> np.ndarray:
    """The launch speeds (keep, m) that are visited in the long run from `start` with injections (m,), NaN where it
    comes to rest."""
    step, alpha = ReturnMap(MACHINE), np.full(len(injections), start)
    found = []
    for hop in range(settle + keep):
        alive = np.isfinite(alpha) & (alpha > 0)
        alpha = np.where(alive, alpha, np.nan)
        alpha[alive] = step(alpha[alive]).next + injections[alive]
        if hop >= settle:
            found.append(alpha.copy())
    return np.array(found)


def cycle(eps: float, alpha: float) -> tuple[float, float]:
    """The launch near `alpha` that comes back after two hops, and the multiplier of the two, by Newton's method."""
    step = ReturnMap(MACHINE, inject=eps)
    for _ in range(30):
        middle = float(step(alpha).next)
        slope = multiplier(MACHINE, alpha) * multiplier(MACHINE, middle)
        change = (float(step(middle).next) - alpha) / (slope - 1)
        alpha -= change
        if abs(change) < 1e-13:
            return alpha, slope
    raise NoOrbit(f"no hops of period two near {alpha:.6g} at eps = {eps:.6g}")


@cache
def last_cycle(low: float = 0.1, high: float = 0.1135) -> float:
    """The injection between two at which the hops of period two lose their stability, their multiplier -1."""
    alpha, excess = 4.5, {}
    for eps in np.linspace(low, high, 10):
        alpha, slope = cycle(eps, alpha)
        excess[eps] = slope + 1
    return bracketed_root(lambda eps: cycle(eps, alpha)[1] + 1, low, high, excess[low], excess[high], width=1e-13)


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    eps = marginal()
    unstable, stable = pair(eps)
    low, high = basin(eps)
    numbers = {"eps": eps, "stable": stable, "unstable": unstable, "basin": high - low}
    numbers |= {"last cycle": last_cycle(), "crisis": crisis()}
    print(f"\n  (d): eps = {eps:.12g}, fixed points {unstable:.12f} and {stable:.12f}, basin {low:.6f} to {high:.6f}")
    print(f"  hops of period two are stable up to eps = {numbers['last cycle']:.12g}")
    print(f"  no hops go on beyond eps = {numbers['crisis']:.12g}")
    injections = np.linspace(0.02, 0.15, 66 if quick else 1301)
    starts = {4.52: COLOURS[0], 4.494: COLOURS[1]}
    visits = {start: visited(injections, start, 200 if quick else 1000) for start in starts}
    numbers["stays"] = float(injections[np.isfinite(visits[4.52]).all(0) & (visits[4.52] > LOW).all(0)][-1])
    left, right = new_row(2, 0.92)
    alpha = np.linspace(LOW, 5.0, 2000)
    plain = ReturnMap(MACHINE)(alpha).next
    left.plot(alpha, alpha, color="0.6", lw=0.8)
    for name, lift in (("a", -0.05), ("b", 0.0), ("c", 0.03), ("d", eps), ("e", 0.11)):
        left.plot(alpha, plain + lift, lw=1.6, label=f"({name}) ε = {lift:.3g}")
    left.plot([low, high], [low, low], ":", color="0.3", lw=1.2)
    marks = [stable, pair(0.03)[1], find(MACHINE).alpha]
    left.plot(marks, marks, "o", color="0.2", ms=4)
    left.set(xlabel="launch speed", ylabel="next launch speed", ylim=(4.0, 4.75), title="injections at M = 1")
    legend_below(left)
    for start, colour in starts.items():
        look = {"marker": ".", "ms": 1.2, "ls": "", "mew": 0, "color": colour, "label": f"from {start:g}"}
        right.plot(np.tile(injections, (64, 1)).ravel(), visits[start].ravel(), **look, rasterized=True)
    for line in (eps, numbers["last cycle"], numbers["crisis"]):
        right.axvline(line, color="0.6", lw=0.8, ls="--", zorder=0)
    for mark in legend_below(right).get_legend().legend_handles:
        mark.set_markersize(8)
    right.set_ylim(4.44, 4.68)
    right.set(xlabel="injection ε", ylabel="launch speeds in the long run", title="beyond (d)")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'figure_8.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer injections")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
