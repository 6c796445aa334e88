"""Which launches converge to a lossless hop, for mass ratios from 1e-3 to 1e3; and how accurate must a hand be?

A launch is attracted if one of its hops starts in an interval [alpha*, beta] above a lossless launch speed in which
every launch maps closer to alpha* from above; beta is the launch that maps back to alpha*. At M = 1 these intervals are
narrow and most launches come to rest. For very light and very heavy feet nearly all launches beyond the first lossless
one end in one of these intervals. The second question is that of the table-top experiment. A hand gives energy at every
hop, with an error: how large may this error be for eight smooth catches in a row?
Run: python studies/attraction.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import ReturnMap
from orbits.show import COLOURS, new_row, save_figure
from problems import Hopper

LAUNCHES = (4.5, 20.0)
HOPS = 4000
# Mass ratios at which the basin is computed instead.
NEAR_ONE = (0.4, 2.5)
# Of the experiment: foot over body; the injection per hop, in launch speed; a smooth catch loses less of alpha^2.
MASS_RATIO, CATCHES, SMOOTH = 0.909, 8, 0.05


def attracted(mass_ratio: float, count: int) -> float:
    """The share of launches that come to a lossless hop: exactly near M = 1, where they lie in few narrow intervals,
    else of so many, evenly spread."""
    step = ReturnMap(Hopper(mass_ratio=mass_ratio))
    if NEAR_ONE[0] <= mass_ratio <= NEAR_ONE[1]:
        return float(np.diff(step.basin(*LAUNCHES)).sum() / np.diff(LAUNCHES)[0])
    intervals = step.basin(1.0, LAUNCHES[1], hops=0)
    alpha, caught = np.linspace(*LAUNCHES, count), np.zeros(count, bool)
    going = np.arange(count)
    for _ in range(HOPS):
        inside = np.zeros(len(going), bool)
        for low, high in intervals:
            inside |= (alpha[going] >= low) & (alpha[going] <= high)
        caught[going[inside]] = True
        going = going[~inside]
        if not len(going):
            break
        alpha[going] = step(alpha[going]).next
        going = going[np.isfinite(alpha[going]) & (alpha[going] > 1.0)]
    return float(caught.mean())


def tolerance(inject: float, trials: int, seed: int = 3) -> float:
    """The largest error of the injection, uniform to either side, with which eight catches in a row are smooth in nine
    of ten trials."""
    step = ReturnMap(Hopper(mass_ratio=MASS_RATIO))
    start = ReturnMap(Hopper(mass_ratio=MASS_RATIO), inject=inject).fixed_points(4.3, 5.0)[-1].alpha
    errors = np.random.default_rng(seed).uniform(-1, 1, (CATCHES, trials))

    def share(size: float) -> float:
        alpha, smooth = np.full(trials, start), np.ones(trials, bool)
        for error in errors:
            hops = step(alpha)
            smooth &= (hops.loss < SMOOTH * alpha**2) & np.isfinite(hops.next)
            alpha = np.where(smooth, hops.next + inject + size * error, start)
        return float(smooth.mean())

    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle) >= 0.9 else (low, middle)
    return low


def main(folder: Path, quick: bool = False) -> dict[str, list]:
    ratios = np.logspace(-3, 3, 5 if quick else 25)
    shares = [attracted(M, 60 if quick else 300) for M in ratios]
    injections = np.array([0.01, 0.03]) if quick else np.geomspace(0.002, 0.07, 12)
    errors = [tolerance(eps, 200 if quick else 1000) for eps in injections]
    for M, share in zip(ratios, shares, strict=True):
        print(f"  M = {M:8.3g}: {100 * share:5.1f}% of the launches from {LAUNCHES[0]} to {LAUNCHES[1]} are attracted")
    for eps, error in zip(injections, errors, strict=True):
        print(f"  injection {eps:.4f} of launch speed at every hop: eight smooth catches need it to +-{error:.4f}")
    left, right = new_row(2, 0.79)
    left.semilogx(ratios, shares, "o-", color=COLOURS[0], ms=4)
    left.set(xlabel="mass ratio M", ylabel="share of launches attracted", ylim=(0, 1.05), title="launches that stay")
    right.loglog(injections, errors, "o-", color=COLOURS[1], ms=4)
    right.set(xlabel="injection at every hop", ylabel="error allowed", title=f"eight catches, M = {MASS_RATIO:g}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'attraction.png')}")
    return {"ratios": list(ratios), "shares": shares, "injections": list(injections), "errors": errors}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer mass ratios and launches")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
