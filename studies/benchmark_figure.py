"""The figure of a benchmark, from the JSON file that `benchmark` leaves.

Run: python studies/benchmark_figure.py FILE [--output FOLDER]
"""

import argparse
import json
from itertools import cycle
from pathlib import Path

import numpy as np

from orbits.result import Axes
from orbits.shooting import METHODS
from orbits.show import COLOURS, legend_below, new_row, save_figure

OURS = (*METHODS, "warm", "Taylor", "Runge-Kutta of order 8")
LOOKS = {way: ("o", colour) for way, colour in zip(OURS, cycle(COLOURS), strict=False)}
LOOKS |= {"lanes, 4 columns": ("*", COLOURS[0]), "Opti, RK4": ("^-", "0.6"), "rockit, RK4": ("v-", "0.75")}
LOOKS |= {"heyoka + Newton": ("D", "0.2"), "heyoka": ("D", "0.2"), "heyoka, batch": ("d", "0.2")}
LOOKS |= {"heyoka, batch, fast": ("d", "0.5"), "heyoka, batch, recorded": ("d", "0.75")}
LOOKS |= {"scipy DOP853 + root": ("s-", "0.35"), "scipy DOP853": ("s-", "0.35")}


def draw(results: dict) -> Axes:
    """The cubic scene's work against precision, cold starts, and how an orbit's time grows; the table has the rest."""
    panels = new_row(2, 0.9, rows=2).ravel()
    flights = results["lanes"].get("half a flight and its slopes", [])
    _scatter(panels[0], results["orbits"]["cubic"], "an orbit", "an orbit")
    _scatter(panels[1], [*results["flows"]["cubic"], *flights], "half a flight and its slopes", "a flight")
    scenes, base = list(results["cold"]), np.zeros(len(results["cold"]))
    for part, colour in zip(("import", "build", "solve", "certify"), COLOURS, strict=False):
        values = np.array([1e3 * results["cold"][scene][part] for scene in scenes])
        panels[2].barh(range(len(scenes)), values, left=base, color=colour, label=part)
        base = base + values
    names = [scene.replace(", ", ",\n").replace("inverse-square", "falling") for scene in scenes]
    panels[2].set(yticks=range(len(scenes)), yticklabels=names, xlabel="ms", title="a new process")
    for name, found in results["scaling"].items():
        label = f"{name}: power {found['exponent']:.2f}"
        panels[3].loglog(found["values"], 1e3 * np.array(found["seconds"]), "o-", ms=4, label=label)
    panels[3].set(ylabel="ms an orbit", xlabel="number, or stiffness", title="what makes an orbit longer")
    for axes in panels:
        legend_below(axes)
    return panels[0]


def _scatter(axes: Axes, rows: list[dict], title: str, unit: str) -> None:
    """Time against true error of each way, joined where it was measured at several settings."""
    for way in dict.fromkeys(row["way"] for row in rows if row["way"] in LOOKS):
        points = np.array([(row["error"], row["seconds"]) for row in rows if row["way"] == way])
        style, colour = LOOKS[way]
        axes.loglog(np.maximum(points[:, 0], 1e-16), 1e3 * points[:, 1], style, color=colour, label=way)
    axes.set(title=title, xlabel="true error", ylabel=f"ms {unit}", xlim=(3e-17, 1))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file", type=Path, help="benchmark.json of a run")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    found = draw(json.loads(arguments.file.read_text(encoding="utf-8")))
    print(f"  figure: {save_figure(found, arguments.output / 'benchmark.png')}")
