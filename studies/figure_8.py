"""Fig. 8 of the paper: energy added or taken at every hop, M = 1; and what comes after the fixed point loses stability.

An injection eps lifts the map through the identity line: a stable fixed point above the lossless launch speed, an
unstable one below. The upper one loses its stability where the map's slope is -1, curve (d); its basin, from the
unstable fixed point to the launch that maps onto it, is largest there. The paper leaves open what follows. On the
right: the period doubles, again and again, up to chaos, until the hops fall out of the basin and come to rest.
Run: python studies/figure_8.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import ReturnMap, find, multiplier
from orbits.plot import COLOURS, new_row, save_figure
from orbits.roots import bracketed_root
from problems import Hopper

MACHINE = Hopper()
LOW, HIGH = 4.3, 5.3


def pair(eps: float) -> tuple[float, float]:
    """The unstable and the stable fixed point of an injection."""
    low, high = ReturnMap(MACHINE, inject=eps).fixed_points(LOW, HIGH)
    return low.alpha, high.alpha


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


def visited(injections, settle: int, keep: int) -> np.ndarray:
    """The launch speeds (keep, m) that are visited in the long run with injections (m,), NaN where it comes to rest."""
    step, alpha = ReturnMap(MACHINE), np.full(len(injections), 4.52)
    found = []
    for hop in range(settle + keep):
        alive = np.isfinite(alpha) & (alpha > 0)
        alpha = np.where(alive, alpha, np.nan)
        alpha[alive] = step(alpha[alive]).next + injections[alive]
        if hop >= settle:
            found.append(alpha.copy())
    return np.array(found)


def period(values, tolerance: float = 1e-6) -> int:
    """The period of a sequence of visits, 0 when it has none up to 32."""
    return next((n for n in (1, 2, 4, 8, 16, 32) if np.abs(values[n:] - values[:-n]).max() < tolerance), 0)


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    eps = marginal()
    unstable, stable = pair(eps)
    low, high = basin(eps)
    injections = np.linspace(0.02, 0.16, 141 if quick else 1401)
    visits = visited(injections, 1500 if quick else 3000, 64)
    stays = np.isfinite(visits).all(0) & (np.where(np.isfinite(visits), visits, 0).min(0) > LOW)
    periods = np.array([period(column) if stay else -1 for column, stay in zip(visits.T, stays, strict=True)])
    numbers = {"eps": eps, "stable": stable, "unstable": unstable, "basin": high - low}
    numbers["last"] = float(injections[stays][-1])
    print(f"\n  (d): eps = {eps:.12g}, fixed points {unstable:.12f} and {stable:.12f}, basin {low:.6f} to {high:.6f}")
    for n in (4, 8):
        if (beyond := injections[(periods == n) & (injections > eps)]).size:
            numbers[f"period {n}"] = float(beyond[0])
            print(f"  period {n} from eps = {beyond[0]:.4f}")
    print(f"  the last hops that go on have eps = {numbers['last']:.4f}")
    left, right = new_row(2, 5.2, 4.4)
    alpha = np.linspace(LOW, 5.0, 2000)
    plain = ReturnMap(MACHINE)(alpha).next
    left.plot(alpha, alpha, color="0.6", lw=0.8)
    for name, lift in (("a", -0.05), ("b", 0.0), ("c", 0.03), ("d", eps), ("e", 0.11)):
        left.plot(alpha, plain + lift, lw=1.6, label=f"({name}) eps = {lift:.3g}")
    left.plot([low, high], [low, low], ":", color="0.3", lw=1.2)
    marks = [stable, pair(0.03)[1], find(MACHINE).alpha]
    left.plot(marks, marks, "o", color="0.2", ms=4)
    left.set(xlabel="launch speed", ylabel="next launch speed", ylim=(4.0, 4.75), title="injections at M = 1")
    left.legend(frameon=False, fontsize="small")
    right.plot(np.tile(injections, (len(visits), 1)), visits, ",", color=COLOURS[0])
    right.axvline(eps, color="0.5", lw=0.8, ls="--")
    right.set_ylim(4.44, 4.68)
    right.set(xlabel="injection eps", ylabel="launch speeds in the long run", title="beyond (d) the period doubles")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'figure_8.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer injections")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
