"""Where lossless hops exist in two parameters, and where they are motions.

On the left the first family of the spring r + beta r^3 + delta r^5: a softening spring ends it at a fold, beyond which
there is no hop; with delta > 0 the spring hardens again, a second fold appears, and the two meet in a cusp, beyond
which the family goes on. On the right the saturating spring tanh(b r)/b with a second spring c r beside it. The exact
fold curve is drawn over the rows of the diagram.
Run: python studies/existence.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import Existence, existence, follow, follow_fold
from orbits.plot import new_row, plot_existence, save_figure
from problems import Hopper

REST_LENGTH = 30.0
QUINTIC = Hopper("r + beta*r**3 + delta*r**5", rest_length=REST_LENGTH, parameters={"beta": 0.0, "delta": 0.0})
SATURATING = Hopper("tanh(b*r)/b + c*r", rest_length=REST_LENGTH, parameters={"b": 0.2, "c": 0.02})


def cusp() -> tuple[np.ndarray, tuple[float, float]]:
    """The fold curve (m, 2) of the quintic spring both ways from delta = 0, and its cusp."""
    (fold,) = [event.point for event in follow(QUINTIC, "beta", -0.02).events if event.kind == "fold"]
    ways = [follow_fold(QUINTIC, fold, "beta", "delta", stop) for stop in (-1e-4, 1e-4)]
    below, above = (np.column_stack([way.column("beta"), way.column("delta")]) for way in ways)
    (point,) = [event.point for event in ways[1].events if event.kind == "fold"]
    return np.vstack([below[::-1], above]), (point.also["beta"], point.value)


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    rows = 6 if quick else 33
    panels = new_row(2, 5.4, 4.4)
    quintic = existence(QUINTIC, "beta", (-0.03, 0.01), "delta", np.linspace(-1e-4, 1.5e-4, rows), longest=0.05)
    saturating = existence(SATURATING, "c", (-0.1, 0.1), "b", np.linspace(0.05, 0.6, rows), longest=0.05)
    curve, place = cusp()
    for axes, diagram in zip(panels, (quintic, saturating), strict=True):
        plot_existence(diagram, axes)
    panels[0].plot(*curve.T, color="0.15", lw=1, zorder=3)
    panels[0].set_title("$r + \\beta r^3 + \\delta r^5$")
    panels[1].set_title("$\\tanh(b r)/b + c r$")
    print(f"\n  cusp at beta = {place[0]:.8g}, delta = {place[1]:.8g}")
    for diagram in (quintic, saturating):
        _report(diagram)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'existence.png')}")
    return {"cusp": place, "quintic": quintic, "saturating": saturating}


def _report(diagram: Existence):
    """Where every row has motions, in words."""
    print(f"\n  {diagram.across:>10}   motions for {diagram.along} in")
    for row, value in enumerate(diagram.values):
        print(f"  {value:10.3g}   " + (", ".join(f"({a:.4g}, {b:.4g})" for a, b in diagram.motions(row)) or "none"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer rows")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
