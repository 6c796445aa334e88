"""Fig. 4 of the paper: possible paths of the foot where it meets the ground, and which of them lose nothing.

(a) An impact with a speed. (b) No speed, but an upward acceleration: the foot would bounce off again. (c) No speed, but
a downward acceleration: the foot has come from below the ground. (d) Neither speed nor acceleration, but an upward
jerk: the foot has come from below too, and leaves. (e) Neither, with a downward jerk: the lossless landing. Each path
is a flight of the linear hopper, integrated backwards from its landing.
Run: python studies/figure_4.py [--output FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find
from orbits.flow import flow_of
from orbits.show import COLOURS, new_row, save_figure
from problems import Hopper

ALPHA = 4.493409457909064
# Landing states y1, y1', y2, y2'; the foot's acceleration is (y1 - 1)/2 and its jerk then y1'/2, for equal masses.
LANDINGS = {
    "(a) impact": (0.5, -3.0, 0.0, -1.0),
    "(b) acceleration up": (2.5, -3.0, 0.0, 0.0),
    "(c) acceleration down": (-0.5, -3.0, 0.0, 0.0),
    "(d) jerk up": (1.0, ALPHA, 0.0, 0.0),
    "(e) lossless": (1.0, -ALPHA, 0.0, 0.0),
}


def foot_path(landing, times) -> np.ndarray:
    """Heights of the foot at `times` (m,), from 0 backwards to negative ones, before a landing state at time 0."""
    machine = Hopper()
    mirrored = np.array(landing) * [1, -1, 1, -1]
    path, _ = flow_of(machine.model.flight, tuple(machine.values)).run(
        mirrored, list(machine.values.values()), -times[0]
    )
    return path(-times)[:, 2]


def main(folder: Path) -> dict[str, float]:
    times, lowest = np.linspace(-2.0, 0.0, 201), {}
    for axes, (name, landing) in zip(new_row(5, 1.27), LANDINGS.items(), strict=True):
        heights = foot_path(landing, times)
        lowest[name] = float(heights.min())
        axes.axhline(0, color="0.4", lw=0.8)
        axes.plot(times, heights, color=COLOURS[1], lw=2)
        axes.plot(0, 0, "o", color="0.2", ms=4)
        axes.set(title=name, xlabel="time to landing", ylabel="foot y₂", ylim=(-1.2, 2.4), xticks=(-2, -1, 0))
        print(f"  {name}: lowest {lowest[name]:.3g} before")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(axes, folder / 'figure_4.png')}")
    return {**lowest, "launch speed": find(Hopper()).alpha}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    main(parser.parse_args().output)
