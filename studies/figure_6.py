"""Fig. 6 of the paper: the foot's path with an impact at landing, and the symmetric path without one.

Played backwards, the first path would need an impulse at lift-off, which the ground does not exert. The second path is
its own mirror image, in flight and in contact.
Run: python studies/figure_6.py [--output FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find, simulate
from orbits.show import new_row, save_figure
from orbits.show.plot import plot_gap
from problems import Hopper

TYPICAL = 4.0


def asymmetry(run, first: float, end: float) -> float:
    """How far the foot's path from a time to another is from its mirror image, beside its height."""
    t = np.linspace(0, end - first, 400)
    path = run(first + t)[:, 2]
    return float(np.abs(path - path[::-1]).max() / path.max())


def main(folder: Path) -> dict[str, float]:
    machine, panels, numbers = Hopper(), new_row(2, 0.75), {}
    for axes, (name, alpha) in zip(panels, (("typical", TYPICAL), ("lossless", find(machine).alpha)), strict=True):
        run = simulate(machine, alpha, hops=2)
        flight = run.events[0]
        plot_gap(run, axes).set(title=f"{name}: launch speed {alpha:.4g}", ylabel="foot y₂")
        numbers[f"{name} speed"] = float(abs(flight.before[3]))
        numbers[f"{name} asymmetry"] = asymmetry(run, 0.0, flight.time)
        speed, other = (numbers[f"{name} {what}"] for what in ("speed", "asymmetry"))
        print(f"\n  {name}: the foot lands at speed {speed:.3g}; its path and the mirror image differ by {other:.1e}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'figure_6.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    main(parser.parse_args().output)
