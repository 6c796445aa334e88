"""What becomes of a hopper's fixed points as energy is added at every hop: folds, flips, and hops of period two.

The stable fixed point of curve (c) of the paper's Fig. 8 begins at the lossless hop, together with an unstable one, and
loses its stability at curve (d), where its multiplier is -1; the paper leaves open whether the period doubles there
(section 9). It does, for the paper's equal masses: from eps = 0.071587384137 on the machine repeats every second hop.
A damper takes back what is added. With eps = 0.1 at every hop and a growing damper the same happens the other way
round: hops of period two become one, and that meets the unstable one in a fold, beyond which every launch comes to
rest.

With --compare diagrams are held against brute force: at some values of the parameter, and beside the ends of branches,
all launches of a fine grid are mapped. Each launch that returns after one hop or two must lie on one branch, with its
multiplier by differences, and each place of a branch must be one of them.
Run: python studies/bifurcations.py [--output FOLDER] [--quick] [--compare NUMBER]
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orbits import BifurcationDiagram, ReturnMap, bifurcations
from orbits.numerics import enclosed_sign_changes
from orbits.returns.launch_cycles import MapsAlong
from orbits.show import new_row, save_figure
from problems import Hopper, hopper_in_si, springs

LAUNCHES = (4.4, 4.7)
INJECT, DAMPED_INJECT = (0.0, 0.15), 0.1
CUBIC, FAR = "r + 0.3*r**3", {"gravity": "1/(1 + z/50)**2", "rest_length": 9.0}


@dataclass(frozen=True)
class Case:
    """A diagram: the machine, the parameter, its range, that of launch speeds, and the injection."""

    machine: Any
    along: str
    span: tuple[float, float]
    between: tuple[float, float]
    inject: float = 0.0


CASES = (
    Case(Hopper(), "inject", (0.0, 0.05), (4.2, 4.8)),
    Case(Hopper("r + r**3"), "inject", (0.0, 0.05), (2.2, 2.8)),
    Case(Hopper(), "inject", (0.1, 0.12), (4.3, 5.0)),
    Case(Hopper(CUBIC), "inject", (0.0, 0.1), (2.5, 6.0)),
    Case(Hopper(), "inject", (0.0, 0.001), (4.2, 4.8)),
    Case(Hopper(), "inject", (0.0, 0.1), (4.2, 4.8)),
    Case(Hopper(), "inject", (0.0, 0.15), (4.3, 5.0)),
    Case(Hopper(), "inject", (0.0, 0.4), (3.6, 6.0)),
    Case(Hopper(), "inject", (0.0, 0.1), (7.2, 8.4)),
    Case(Hopper(mass_ratio=3.0), "inject", (0.0, 0.1), (4.0, 5.0)),
    Case(Hopper(mass_ratio=3.0), "inject", (0.0, 0.3), (3.0, 6.0)),
    Case(Hopper(mass_ratio=0.5), "inject", (0.0, 0.1), (4.0, 5.0)),
    Case(Hopper("r + 0.01*r**3"), "inject", (0.0, 0.05), (4.0, 4.8)),
    Case(Hopper("r + 0.1*r**3"), "inject", (0.0, 0.05), (3.2, 4.2)),
    Case(Hopper(CUBIC), "inject", (0.0, 0.05), (2.8, 3.2)),
    Case(Hopper("tanh(0.1*r)/0.1"), "inject", (0.0, 0.1), (4.2, 5.2)),
    Case(Hopper(damping=0.01), "inject", (0.05, 0.4), (4.3, 5.5)),
    Case(Hopper(CUBIC, **FAR), "inject", (0.0, 0.06), (2.7, 3.5)),
    Case(Hopper(restitution=0.1), "inject", (0.0, 0.1), (4.2, 5.0)),
    Case(Hopper(restitution=0.3), "inject", (0.0, 0.1), (4.2, 5.0)),
    Case(Hopper(CUBIC, restitution=0.1), "inject", (0.0, 0.06), (2.7, 3.3)),
    Case(hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8), "inject", (0.0, 0.1), (2.7, 3.6)),
    Case(Hopper(springs.bilinear(gap=1.0, ratio=3.0)), "inject", (0.0, 0.06), (3.0, 4.5)),
    Case(Hopper(springs.lossy("r", loss_factor=0.01)), "inject", (0.2, 0.6), (4.3, 5.2)),
    Case(Hopper(), "damping", (0.0, 0.007), (4.4, 4.7), 0.1),
    Case(Hopper(), "damping", (0.0, 0.03), (4.2, 5.0), 0.2),
    Case(Hopper(), "mass_ratio", (0.8, 1.6), (4.3, 4.8), 0.08),
    Case(Hopper(), "restitution", (0.0, 0.15), (4.3, 4.8), 0.08),
    Case(Hopper("cubic", parameters={"beta": 0.1}), "beta", (0.05, 0.4), (2.7, 4.2), 0.03),
    Case(Hopper(drag=0.001), "drag", (0.0, 0.003), (4.3, 4.8), 0.06),
)
SECTIONS, GRID, BESIDE, BESIDE_END = 5, 700, 50, 2e-3
# Places agree up to these shares of the range of launch speeds: at the diagram's own values, and between two points.
SAME, INTERPOLATED, SAME_SLOPE = 1e-8, 1e-5, 1e-3


class Returning(NamedTuple):
    """A launch that returns: its speed and its multiplier."""

    alpha: float
    multiplier: float


def returning(step: Callable, lossless: list[float], between: tuple[float, float], period: int) -> list[Returning]:
    """The launches that return after one hop, or after two and not after one, by a grid that is denser toward lossless
    launches and the launches before these."""
    low, high = between

    def last(x: np.ndarray) -> np.ndarray:
        for _ in range(period):
            inside = (x >= low) & (x <= high)
            following = np.full(x.shape, np.nan)
            following[inside] = step(x[inside]).next
            x = following
        return x

    away = np.geomspace(1e-9, 1.0, BESIDE) * (high - low)
    away, grid = np.concatenate([-away, away]), np.linspace(low, high, GRID)
    centres, following = [np.array(lossless)], step(grid).next
    for star in lossless if period == 2 else []:
        above = following - star
        i = np.flatnonzero(above[1:] * above[:-1] < 0)
        centres.append(
            enclosed_sign_changes(
                lambda x, _, star=star: step(x).next - star, grid[i], grid[i + 1], above[i], above[i + 1]
            )[0]
        )
    grid = np.unique(np.concatenate([grid, (np.concatenate(centres)[:, None] + away).ravel()]))
    grid = grid[(grid >= low) & (grid <= high)]
    excess = last(grid) - grid
    i = np.flatnonzero(excess[1:] * excess[:-1] < 0)
    a, b, fa, fb = enclosed_sign_changes(lambda x, _: last(x) - x, grid[i], grid[i + 1], excess[i], excess[i + 1])
    continuous = np.maximum(np.abs(fa), np.abs(fb)) <= 1e-7 * (high - low)
    found = np.where(np.abs(fa) <= np.abs(fb), a, b)[continuous]
    if period == 2 and len(found):
        found = found[np.abs(step(found).next - found) > 1e-6 * (high - low)]
    near = np.min([np.abs(found - star) for star in lossless], axis=0, initial=1e-5 * high)
    slopes = (last(found + 1e-2 * near) - last(found - 1e-2 * near)) / (2e-2 * near)
    return [Returning(*each) for each in zip(found.tolist(), slopes.tolist(), strict=True)]


def places(diagram: BifurcationDiagram, period: int, value: float) -> list[tuple[float, float, float]]:
    """The launches of a diagram at a value: (launch speed, multiplier, distance of the points between which it is)."""
    found = []
    for branch in (each for each in diagram.branches if each.period == period):
        ahead = branch.values - value
        for i in np.flatnonzero(ahead == 0):
            found += [(alpha, branch.multipliers[i], 0.0) for alpha in branch.alphas[i]]
        for i in np.flatnonzero(ahead[1:] * ahead[:-1] < 0):
            share = ahead[i] / (ahead[i] - ahead[i + 1])
            alphas, slopes = (c[i] + share * (c[i + 1] - c[i]) for c in (branch.alphas, branch.multipliers))
            apart = float(np.abs(branch.alphas[i + 1] - branch.alphas[i]).max())
            found += [(alpha, slopes, apart) for alpha in alphas]
    return found


def faults(case: Case) -> list[str]:
    """What is wrong with a diagram, branch by branch."""
    (low, high), width = case.span, case.between[1] - case.between[0]
    own = {"inject": case.inject} if case.inject else {}
    diagram = bifurcations(case.machine, case.along, case.span, case.between, sections=SECTIONS, attractor=0, **own)
    values = [*np.linspace(low, high, SECTIONS)[1:-1], *np.random.default_rng(1).uniform(low, high, 4)]
    ends = [(branch.values[k], branch.ends[k]) for branch in diagram.branches for k in (0, -1)]
    beside = [value + s * BESIDE_END * (high - low) for value, end in ends if end.kind != "reached" for s in (-1, 1)]
    maps, wrong = MapsAlong(case.machine, case.along, low, high, case.inject, 10_000), list[str]()
    for value in sorted([*values, *(each for each in beside if low < each < high)]):
        step, plain = maps.at(value), ReturnMap(maps.machine_at(value))
        energy_is_lost_by_impacts_alone = plain.impacts.model.conservative
        lossless = [each.alpha for each in plain.fixed_points(*case.between)] if energy_is_lost_by_impacts_alone else []
        for period in (1, 2):
            left = places(diagram, period, value)
            for alpha, slope in returning(step, lossless, case.between, period):
                where = f"{case.along} = {value:.9g}, alpha = {alpha:.9g}, period {period}"
                nearest = min(left, key=lambda each: abs(each[0] - alpha), default=(np.inf, np.nan, 0.0))
                enough = SAME * width if nearest[2] == 0 else INTERPOLATED * width + 0.5 * nearest[2]
                if abs(nearest[0] - alpha) > enough:
                    wrong.append(f"missing: {where}")
                    continue
                left.remove(nearest)
                if nearest[2] == 0 and abs(nearest[1] - slope) > SAME_SLOPE * (1 + abs(slope)):
                    wrong.append(f"multiplier: {where}: {nearest[1]:.6g} and {slope:.6g}")
            wrong += [
                f"false or double: {case.along} = {value:.9g}, alpha = {a:.9g}, period {period}" for a, *_ in left
            ]
    return wrong


def compare(cases: tuple[Case, ...]) -> list[str]:
    """Compare diagrams with brute force."""
    wrong = []
    for case in cases:
        found = faults(case)
        print(
            f"  {case.machine}, along {case.along} {case.span}, {case.between}: {len(found)} wrong",
            *found[:9],
            sep="\n    ",
        )
        wrong += found
    print(f"\n  {len(cases)} diagrams against brute force: {len(wrong)} branches wrong, missing or double")
    return wrong


def main(folder: Path, quick: bool = False) -> dict[str, BifurcationDiagram]:
    """Draw both diagrams; the quick mode has the first alone."""
    sections = 3 if quick else 5
    visits = 60 if quick else 600
    found = {"inject": bifurcations(Hopper(), "inject", INJECT, LAUNCHES, sections=sections, attractor=visits)}
    if not quick:
        found["damping"] = bifurcations(
            Hopper(), "damping", (0.0, 0.007), LAUNCHES, inject=DAMPED_INJECT, sections=sections
        )
    panels = np.atleast_1d(new_row(len(found), 0.85))
    for axes, (name, diagram) in zip(panels, found.items(), strict=True):
        print(f"\n{diagram}")
        diagram.plot(axes)
        axes.set_title(f"along the {'injection' if name == 'inject' else 'damping'}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'bifurcations.png')}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="the injection alone, with fewer of its values")
    parser.add_argument(
        "--compare", type=int, metavar="NUMBER", help="compare so many diagrams with brute force instead"
    )
    arguments = parser.parse_args()
    if arguments.compare:
        raise SystemExit(bool(compare(CASES[: arguments.compare])))
    main(arguments.output, arguments.quick)
