"""Lossless hops against the variation of gravity: on ever smaller bodies, and in a linear gradient.

Gravity decreases with the radius R of the body as 1/(1 + z/R)^2; the families are followed along 1/R, starting from a
plane. Hopper and juggler are one machine under constant gravity (1/R = 0) and two machines on a small body. The hopper
hops on the smallest bodies. The juggler's spring carries its hand up into ever weaker gravity, and its throws shrink.
In a linear gradient the hopper ends where the tide alone stretches the spring to lift-off, k = (1 + M)/(rest length +
rho), and the juggler ends where gravity vanishes at the height of the hand, k = 1/(rest length).
Run: python studies/gravity_families.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

from orbits import Family, follow
from orbits.show import label_of, new_row, save_figure
from problems import Hopper, Juggler

REST_LENGTH = 12.0
# Gravity law, its parameter, the last value, and what to write under the axis.
LAWS = (
    ("1/(1 + z*k)**2", "k", 1.5, "1/R, the body's curvature"),
    ("1 - k*z", "k", 0.3, "linear gradient k"),
)


def main(folder: Path, quick: bool = False) -> dict[tuple, Family]:
    numbers = (1,) if quick else (1, 2, 3)
    panels, found = new_row(2, 0.81, rows=2), {}
    for row, (law, along, stop, label) in zip(panels, LAWS, strict=True):
        for axes, machine in zip(row, (Hopper, Juggler), strict=True):
            print(f"\n  {machine.kind}, gravity {law}")
            start = machine("r", law, rest_length=REST_LENGTH, parameters={along: 0.0})
            families = follow(start, along, stop, families=numbers)
            families.plot(axes=axes)
            for number in families:
                family = found[machine.kind, law, number] = families[number]
                limit = f", {along} tends to {family.end.limit:.6g}" if family.end.limit is not None else ""
                print(f"    family {number}: {family.end.kind}, {family.end.reason}{limit}")
                for event in family.events:
                    print(f"      {event.kind} at {along} = {event.point.value:.8g}, alpha = {event.point.alpha:.8g}")
            axes.set(title=f"{machine.kind}, gravity {label_of(law)}", xlabel=label, ylim=(0, None))
            if stop > 1:
                axes.set_xscale("symlog", linthresh=1e-3)
            axes.set_xlim(left=0)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels.flat[0], folder / 'gravity_families.png')}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="family 1 only")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
