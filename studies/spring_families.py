"""Lossless hops against the nonlinearity of the spring: families 1 to 4 of eight springs, under constant gravity.

Each panel follows launch speed and nonlinearity from the linear spring on. Dashed orbits are no motions: the spring
collapses in contact, or the masses, whose spring is 30 lengths long, pass through each other.
Run: python studies/spring_families.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

from orbits import Family, follow
from orbits.show import new_row, plot_family, save_figure, small_type
from problems import Hopper

# Title, spring, the parameter followed, from, to, and the others' values.
SPRINGS = (
    ("hardening cubic, r + β·r³", "cubic", "beta", 0.0, 3.0, {}),
    ("softening cubic, r + β·r³", "cubic", "beta", 0.0, -0.02, {}),
    ("saturating, tanh(b·r)/b", "tanh", "b", 0.02, 0.9, {}),
    ("hardening, sinh(b·r)/b", "sinh", "b", 0.01, 2.0, {}),
    ("Toda, hard in compression", "toda", "b", 0.01, 0.9, {}),
    ("Toda, hard in tension", "toda", "b", -0.01, -1.2, {}),
    ("bilinear, from r = 0.5 on", "bilinear", "ratio", 1.0, 8.0, {"gap": 0.5}),
    ("air spring, by 1/length", "L*(1 - (1 + r/L)**(-1.4))/1.4", "L", 60.0, 2.0, {}),
)
REST_LENGTH = 30.0


def families(law: str, along: str, start: float, stop: float, others: dict, numbers) -> list[Family]:
    """The families of these numbers along a parameter of a law."""
    machine = Hopper(law, rest_length=REST_LENGTH, parameters={**others, along: start})
    return [*follow(machine, along, stop, families=numbers).families.values()]


def fate(family: Family) -> str:
    """What becomes of a family, in a line."""
    words = [
        f"{event.kind} at {family.name} = {event.point.value:.6g}" for event in family.events if event.kind != "value"
    ]
    limit = f" to {family.name} = {family.end.limit:.6g}" if family.end.limit is not None else ""
    return "; ".join([*words, f"{family.end.kind}{limit or f' at {family.name} = {family[-1].value:.6g}'}"])


def main(folder: Path, quick: bool = False) -> dict[str, list[Family]]:
    numbers = (1,) if quick else (1, 2, 3, 4)
    panels, found, entries = new_row(3, 0.84, rows=3).ravel(), {}, {}
    for axes, (title, law, along, start, stop, others) in zip(panels, SPRINGS, strict=False):
        found[title] = families(law, along, start, stop, others, numbers)
        print(f"\n  {title}")
        for number, family in zip(numbers, found[title], strict=True):
            plot_family(family, axes, label=f"family {number}")
            print(f"    family {number}: {fate(family)}; alpha {family[0].alpha:.6g} to {family[-1].alpha:.6g}")
        top = 30.0 if any(family.end.kind == "escaped" for family in found[title]) else None
        axes.set(ylim=(0, top))
        axes.set_title(title)
        entries |= {text: handle for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
        axes.get_legend().remove()
    panels[-1].set_axis_off()  # one legend for all panels takes the place of a ninth
    names = sorted(entries, key=lambda name: not name.startswith("family"))
    panels[-1].legend([entries[name] for name in names], names, frameon=False, loc="center", fontsize=small_type(axes))
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'spring_families.png')}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="family 1 only")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
