"""Beyond curve (d) of the paper's Fig. 8: hops of period two and four, a cascade, the crisis, and what attracts where.

The paper does not study what follows when its upper fixed point loses stability (M = 1, injection eps = 0.0716). Hops
of period two follow, stable up to 0.113429. Their flip there is subcritical: unstable hops of period four end at it.
These hops begin together with stable ones in a fold at 0.111550, so both periods attract over some range. The stable
hops of period four double in turn, by Feigenbaum's ratio, because the map's maximum is smooth: it lies above the
lossless launch, the tip with unbounded curvature. The cascade ends in a crisis at eps = 0.138812. There the maximum c
of the map reaches the unstable fixed point u in two hops:

    f'(c) = 0,    f(f(c) + eps) + eps = u,    f(u) + eps = u.

Flips, folds and the crisis are then followed as the mass ratio changes, over the periods that attract there.
Run: python studies/period_four.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import ReturnMap, bifurcations, find, multiplier, period_diagram
from orbits.numerics import bracketed_root
from orbits.show import COLOURS, STYLE, legend_below, new_axes, new_row, save_figure
from problems import Hopper

INJECT, LAUNCHES = (0.0, 0.15), (4.3, 4.8)
MASS_RATIOS = (1.0, 2.0)
DOUBLINGS = 4  # of period four
FEIGENBAUM = 4.669201609


def crisis(mass_ratio: float = 1.0) -> float:
    """The injection at which the map's maximum comes to the unstable fixed point u in two hops. That fixed point
    determines the injection, eps = u - f(u), so that one equation is left for u."""
    machine = Hopper(mass_ratio=mass_ratio)
    star, plain = find(machine).alpha, ReturnMap(machine)
    slope = lambda alpha: multiplier(machine, alpha)  # noqa: E731
    ends = star + 1e-5, star + 0.3
    highest = float(plain(bracketed_root(slope, *ends, *map(slope, ends))).next)
    added = lambda u: u - float(plain(u).next)  # noqa: E731
    excess = lambda u: float(plain(highest + added(u)).next) + added(u) - u  # noqa: E731
    ends = star - 0.2, star - 1e-6
    return added(bracketed_root(excess, *ends, *map(excess, ends)))


def cycle(launches: np.ndarray, eps: float) -> tuple[np.ndarray, float]:
    """Launches (n,) of hops near some that come back, and their multiplier, by Newton's method on all of them."""
    step = ReturnMap(Hopper(), inject=eps)
    for _ in range(20):
        slopes = [multiplier(Hopper(), alpha) for alpha in launches]
        missing = np.roll(launches, -1) - step(launches).next
        change = np.linalg.solve(np.diag(slopes) - np.roll(np.eye(len(launches)), 1, axis=1), missing)
        launches = launches + change
        if np.abs(change).max() < 1e-13:
            break
    return launches, float(np.prod(slopes))


def settled(eps: float, period: int, hops: int = 200) -> np.ndarray:
    """The launches (period,) that hops come to in the long run."""
    step, alpha = ReturnMap(Hopper(), inject=eps), np.array([4.4925])
    for _ in range(hops):
        alpha = step(alpha).next
    path = [alpha]
    for _ in range(period - 1):
        path.append(step(path[-1]).next)
    return np.concatenate(path)


def doublings(first: float, count: int) -> list[float]:
    """The injections at which hops of period four double, from the first of them on: each where the multiplier of the
    hops that began at the one before has fallen to -1."""
    found, period, gap = [first], 4, 1.3e-3
    for _ in range(count):
        period, gap = 2 * period, gap / FEIGENBAUM
        eps = found[-1] + 0.4 * gap
        launches, value = cycle(settled(eps, period), eps)
        before, last = (eps, value), found[-1] + 0.8 * gap
        for _ in range(30):
            launches, value = cycle(launches, last)
            if abs(value + 1) < 1e-9:
                break
            before, last = (last, value), last - (value + 1) * (last - before[0]) / (value - before[1])
        found.append(last)
    return found


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    visits = 60 if quick else 1200
    options = {"sections": 3, "doublings": 2, "attractor": visits}
    diagram = bifurcations(Hopper(), "inject", INJECT, LAUNCHES, **options)
    events = {(event.kind, len(event.alphas)): event for event in diagram.events}
    flips = [events["flip", period] for period in (1, 2)]
    doubled, fold = events["flip", 4], events["fold", 4]
    cascade = doublings(doubled.value, 2 if quick else DOUBLINGS)
    gaps = np.diff(cascade)
    numbers = {"flip of one": flips[0].value, "flip of two": flips[1].value, "fold of four": fold.value}
    numbers |= {"flip of four": doubled.value, "crisis": crisis(), "ratio": float(gaps[-2] / gaps[-1])}
    for name, value in numbers.items():
        print(f"  {name:14} {value:.13g}")
    ratios = ", ".join(f"{value:.4f}" for value in gaps[:-1] / gaps[1:])
    print(f"  period four doubles at {', '.join(f'{value:.10f}' for value in cascade)}: ratios {ratios}")

    left, right = new_row(2, 0.89)
    diagram.plot(left)
    for axes in (left, right):
        for value in (fold.value, *cascade[:1], numbers["flip of two"], numbers["crisis"]):
            axes.axvline(value, color="0.6", lw=0.7, ls="--", zorder=0)
    zoom = (0.1112, 0.1138)
    for branch in diagram.branches:
        for first, last, stable in branch.parts():
            look = {"color": COLOURS[branch.period - 1], "ls": "-" if stable else "--", "lw": 1.4 if stable else 1.0}
            right.plot(branch.values[first : last + 1], branch.alphas[first : last + 1], **look)
    for start, colour in ((4.52, COLOURS[4]), (4.4925, COLOURS[5])):
        _draw_visits(right, start, colour, zoom, visits, 100 if quick else 400)
    right.set(xlim=zoom, ylim=(4.489, 4.511), xlabel="inject", ylabel="launch speed", title="two periods attract")
    left.set(ylim=(4.44, 4.68), title="injections at M = 1")
    legend_below(left)
    for mark in legend_below(right).get_legend().legend_handles:
        mark.set_markersize(8)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'period_four.png')}")

    samples = (16, 3) if quick else (240, 61)
    over = {"inject": (0.05, 0.24), "mass_ratio": MASS_RATIOS}
    periods = period_diagram(Hopper(), over, (4.2, 5.4), samples=samples, starts=(4.52, 4.4925))
    print(f"\n{periods}")
    axes = periods.plot(new_axes(0.76, STYLE.page))
    longest = 0.05 if quick else 0.02
    for event in flips if quick else (*flips, doubled, fold):
        curve = diagram.follow_event(event, "mass_ratio", MASS_RATIOS[1], longest=longest)
        numbers[f"{event.kind} of {len(event.alphas)} at M = 2"] = curve.at(MASS_RATIOS[1])[0]
        curve.plot(axes)
        print(f"\n{curve}")
    masses = np.linspace(*MASS_RATIOS, 2 if quick else 21)
    line = np.column_stack([[crisis(mass) for mass in masses], masses])
    axes.plot(*line.T, color="black", lw=2.6, alpha=0.55, label="crisis")
    axes.set(xlim=over["inject"], title="the periods that attract, with curves of bifurcations and the crisis")
    legend_below(axes)
    print(f"\n  figure: {save_figure(axes, folder / 'periods.png')}")
    return numbers


def _draw_visits(axes, start: float, colour: str, span: tuple[float, float], count: int, hops: int) -> None:
    """Draw the launches that follow so many hops from a start, at `count` values of the injection."""
    injections = np.linspace(*span, count)
    step, alpha, found = ReturnMap(Hopper()), np.full(count, start), list[np.ndarray]()
    for hop in range(hops + 40):
        alpha = step(alpha).next + injections
        found += [alpha] if hop >= hops else []
    look = {"marker": ".", "ls": "", "ms": 1.2, "mew": 0, "color": colour, "zorder": 1, "rasterized": True}
    axes.plot(np.tile(injections, len(found)), np.concatenate(found), **look, label=f"in the long run from {start:g}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="fewer values of the parameters")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
