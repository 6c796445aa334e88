"""Where lossless hops exist in two parameters, and where they are motions: a hopper and a juggler, 200 by 200 machines.

On the left the first family of the spring r + beta r^3 + delta r^5: a softening spring ends it at a fold, beyond which
there is no hop; with delta > 0 the spring hardens again, a second fold appears, and the two meet in a cusp, beyond
which the family goes on. On the right the saturating spring tanh(b r)/b with a second spring c r beside it. Above is
the hopper, whose foot also has to stay below its body, below the juggler. Colours are launch speeds. The exact curve of
folds, which `follow_fold` follows, lies on the edge of the diagram.
Run: python studies/existence.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

from orbits import Existence, existence, follow, follow_fold
from orbits.show import COLOURS, label_of, legend_below, new_row, save_figure
from problems import Hopper, Juggler

REST_LENGTH = 30.0
QUINTIC = "r + beta*r**3 + delta*r**5", {"beta": 0.0, "delta": 0.0}
SATURATING = "tanh(b*r)/b + c*r", {"b": 0.2, "c": 0.02}
MACHINES = {
    "hopper": lambda spring, values: Hopper(spring, rest_length=REST_LENGTH, parameters=values),
    "juggler": lambda spring, values: Juggler(spring, parameters=values),
}
RANGES = {
    QUINTIC[0]: ("beta", (-0.03, 0.01), "delta", (-1e-4, 1.5e-4)),
    SATURATING[0]: ("c", (-0.1, 0.1), "b", (0.05, 0.6)),
}


def cusp() -> tuple[np.ndarray, tuple[float, float]]:
    """The fold curve (m, 2) of the hopper's quintic spring both ways from delta = 0, and its cusp."""
    machine = MACHINES["hopper"](*QUINTIC)
    (fold,) = [event.point for event in follow(machine, "beta", -0.02, most=60).events if event.kind == "fold"]
    ways = [follow_fold(machine, fold, "beta", "delta", stop) for stop in (-1e-4, 1e-4)]
    below, above = (np.column_stack([way.column("beta"), way.column("delta")]) for way in ways)
    (point,) = [event.point for event in ways[1].events if event.kind == "fold"]
    return np.vstack([below[::-1], above]), (point.also["beta"], point.value)


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    found: dict[str, object] = {}
    machines, springs = ({"hopper": MACHINES["hopper"]}, (SATURATING,)) if quick else (MACHINES, (QUINTIC, SATURATING))
    panels = np.reshape(new_row(len(springs), 0.88, rows=len(machines)), (-1, len(springs)))
    for row, (kind, machine) in zip(panels, machines.items(), strict=True):
        for axes, (spring, values) in zip(row, springs, strict=True):
            began = perf_counter()
            diagram = existence(machine(spring, values), *RANGES[spring], samples=3 if quick else 200, both_ways=True)
            seconds = perf_counter() - began
            _report(kind, diagram, seconds)
            diagram.plot("alpha", axes)
            axes.set_title(f"{kind}, {label_of(spring)}")
            found[f"{kind}, {spring}"] = diagram
    if not quick:
        curve, found["cusp"] = cusp()
        print(f"\n  cusp at beta = {found['cusp'][0]:.8g}, delta = {found['cusp'][1]:.8g}")
        panels[0, 0].plot(*curve.T, color=COLOURS[3], lw=1.4, ls=(0, (4, 3)), zorder=4, label="folds, followed")
        legend_below(panels[0, 0])
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0, 0], folder / 'existence.png')}")
    return found


def _report(kind: str, diagram: Existence, seconds: float):
    """How many machines have an orbit, and what it took."""
    counts = ", ".join(f"{number} {status}" for status, number in diagram.grid.statuses().items())
    edges = f"{len(diagram.orbit_edges)} points on the edge of the orbits, {len(diagram.motion_edges)} on the motions'"
    print(f"  {kind:8} over {diagram.along}, {diagram.across}: {counts}; {edges}; {seconds:.1f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="hoppers with the saturating spring, and fewer of them")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
