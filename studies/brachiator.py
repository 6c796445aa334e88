"""Swings from hold to hold that cost nothing: for which arms, how fast, and by what forces of the hands.

Two equal arms meet at a shoulder that has the rest of the mass 1; lengths are in arms and gravity is 1. A family of
swings leads from the fastest one to lighter arms, to a fold, back to a slower branch with shorter steps, and over a
second fold to arms without mass. There the shoulder swings as a pendulum of small amplitude, and half a swing takes
three quarters of its period, 3 pi/2. To heavier arms the steps grow until the arms are level at release; beyond, the
shoulder starts above the bar.
Run: python studies/brachiator.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import Swing, SwingFamily, find, find_all, follow
from orbits.result import Axes
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import brachiator
from studies.walker import in_few_colours

ARM_MASS, LIGHTEST, HEAVIEST = 0.25, 0.002, 0.48
CENTRES = (0.4, 0.5, 0.6)  # of an arm's mass, from the shoulder
# A machine with a body, and the place of its swing.
WITH_BODY = {"arm_mass": 0.15, "body_inertia": 0.02, "body_centre": 0.2}
NEAR = {"angle": 0.6, "body'": 0.6, "half_swing": 1.7}


def whole_family(arm_centre: float) -> list[SwingFamily]:
    """The family of the fastest swing along the arms' mass, in parts: to heavier arms, and to lighter ones through two
    folds, each part from where the one before it comes back."""
    machine = brachiator(ARM_MASS, arm_centre)
    parts = [follow(machine, "arm_mass", HEAVIEST), follow(machine, "arm_mass", LIGHTEST)]
    for stop in (HEAVIEST, LIGHTEST):
        parts.append(follow(machine, "arm_mass", stop, parts[-1].start(-1)))
    return parts


def draw_families(axes: Axes, families: dict[float, list[SwingFamily]], quantity: str) -> None:
    """Draw a quantity of the families against the arms' mass, dashed where the shoulder starts above the bar."""
    for (centre, parts), colour in zip(families.items(), COLOURS, strict=False):
        for i, part in enumerate(parts):
            x, y, label = part.column("arm_mass"), part.column(quantity), f"arm centre {centre:g}" if i == 0 else None
            axes.plot(x, np.where(part.admissible, y, np.nan), color=colour, label=label)
            axes.plot(x, np.where(part.admissible, np.nan, y), "--", color=colour, lw=1.2)
            for fold in (event.point for event in part.events if event.kind == "fold"):
                axes.plot(fold["arm_mass"], fold[quantity], "o", color=colour, mfc="white", ms=5)
    axes.set_xlabel("mass of an arm")


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    families = {centre: whole_family(centre) for centre in (CENTRES[1:2] if quick else CENTRES)}
    for centre, parts in families.items():
        folds = [event.point for part in parts for event in part.events if event.kind == "fold"]
        level = next(event.point for event in parts[0].events if event.kind == "parts touch")
        fastest = max(part.column("mean_speed")[part.admissible].max() for part in parts)
        print(
            f"  arm centre {centre:g}: folds at the masses {folds[0]['arm_mass']:.5f} and {folds[1]['arm_mass']:.5f};"
        )
        print(f"    arms level at release at {level['arm_mass']:.5f}; speeds up to {fastest:.4f}")
    swings, body = find_all(brachiator(ARM_MASS)), find(brachiator(**WITH_BODY), start=NEAR)
    for swing in (*swings, body):
        if swing.admissible:
            words = ", ".join(f"{name} {value:.5f}" for name, value in swing.start.items())
            print(f"  {words}: speed {swing.mean_speed:.4f}, force {swing.smallest_grip_force:.3f}", end="")
            print(f" to {swing.largest_grip_force:.3f}")
    panels = new_row(2, 0.7, rows=2)
    drawn: list[Swing] = [swings[0], body]
    for axes, swing in zip(panels[0], drawn, strict=True):
        swing.plot(axes)
    draw_families(panels[1, 0], families, "mean_speed")
    panels[1, 0].set(ylabel="mean speed", ylim=(0, None))
    draw_families(panels[1, 1], families, "smallest_grip_force")
    panels[1, 1].set(ylabel="smallest force of the bar")
    for axes in panels[1]:
        legend_below(axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(panels[0, 0], folder / 'brachiator.png')}")
    frames = 4 if quick else 96
    print(f"  animation: {in_few_colours(swings[0].animate(folder / 'brachiator.gif', frames=frames))}")
    return {"families": families, "swings": swings, "body": body}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="one family and few frames")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
