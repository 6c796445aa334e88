"""Fig. 3 of the paper: a lossless orbit of the hopper, and of the juggler, over flight and contact, M = 1.

With equal masses the ball moves twice as far as the hopper's centre of mass, in flight and in contact (eq. 6).
Run: python studies/figure_3.py [--output FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find
from orbits.show import new_row, plot_orbit, save_figure
from problems import Hopper, Juggler


def main(folder: Path) -> dict[str, float]:
    hopper, juggler = find(Hopper()), find(Juggler())
    t = np.linspace(0, hopper.period, 2001)
    centre, ball = hopper(t) @ [0.5, 0, 0.5, 0], juggler(t)[:, 0]
    ratio = np.ptp(ball) / np.ptp(centre)
    difference = float(np.abs((ball - ball[0]) / ratio - (centre - centre[0])).max())
    print(f"\n  alpha = {hopper.alpha:.15g} and {juggler.alpha:.15g}, period {hopper.period:.12g}")
    print(f"  the ball's path is {ratio:.12g} times the centre of mass's, but for {difference:.1e}")
    for axes, orbit in zip(new_row(2, 0.79), (hopper, juggler), strict=True):
        plot_orbit(orbit, axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(axes, folder / 'figure_3.png')}")
    return {"ratio": float(ratio), "difference": difference, "periods": (hopper.period, juggler.period)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    main(parser.parse_args().output)
