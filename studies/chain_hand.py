"""A juggler whose hand is a chain: a ball on a hand, a spring below it, a mass, and a spring to the ground.

The lossless throws of three masses 1 on springs of stiffness 1, along the mass between the springs, the stiffness of
the lower one, and the hardness of the upper one. As the mass between vanishes, there is a throw near the plain
juggler's on both springs in series (dots): its launch speed is larger by the share s^2 m3/(2 m2), with s the share of
the hand's motion that the mass makes. The families of the throws of equal masses do not lead there.
Run: python studies/chain_hand.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import NoOrbit, Orbit, find, find_all, follow, starts
from orbits.show import COLOURS, legend_below, new_row, plot_orbit, save_figure
from orbits.show.style import NO_MOTIONS
from problems import Juggler, chain_hand

LAWS = ["r + b*r**3", "K*r"]
# Where each parameter goes to from the hand of equal masses and linear springs, and what to write under the axis.
WAYS = {
    "m3": ((0.01, 10.0), "mass m3 between the springs"),
    "K": ((0.1, 100.0), "stiffness K of the lower spring"),
    "b": ((0.0, 0.3), "hardness b of the upper spring"),
}


def hand(middle: float = 1.0):
    """The machine with linear springs and a mass between them."""
    return chain_hand((1.0, 1.0, middle), LAWS, {"b": 0.0, "K": 1.0})


def in_series(middle: float) -> tuple[Orbit, float]:
    """The throw with a small mass between the springs, and the launch speed of the juggler on both without it."""
    plain, slowness = find(Juggler()), np.sqrt(2)
    alpha = plain.alpha * slowness
    launch = {"liftoff": -middle, "alpha": alpha, "y3": -middle, "y3'": alpha / 2}
    times = {"duration": plain.flight_time / 2, "contact_duration": plain.contact_time / 2}
    return find(hand(middle), start=launch | {name: time * slowness for name, time in times.items()}), alpha


def throws() -> list[Orbit]:
    """The throws of the hand of equal masses that are motions, the slowest first."""
    return [orbit for orbit in find_all(hand(), starts(hand(), 4.0, 7.0)) if orbit.admissible]


def draw(axes, along: str, machine, orbit: Orbit, colour: str) -> list[str]:
    """Draw the launch speeds of a family both ways along a parameter; how it ends."""
    ends = []
    for stop in WAYS[along][0]:
        if stop == machine.values[along]:
            continue
        family = follow(machine, along, stop, start=orbit)
        good = np.array([point.admissible for point in family])
        speeds = family.column("alpha")
        known = axes.get_legend_handles_labels()[1]
        own, none = (None if name in known else name for name in (f"from {orbit.alpha:.5g}", NO_MOTIONS))
        axes.plot(family.column(along), np.where(good, speeds, np.nan), color=colour, lw=2, label=own)
        if not good.all():
            axes.plot(family.column(along), np.where(good, np.nan, speeds), color=colour, lw=1.2, ls=":", label=none)
        violation = next((point.violations[0] for point in family if not point.admissible), "motions all the way")
        ends.append(f"to {along} = {family[-1].value:.4g}: {family.end.kind}, {violation}")
    return ends


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    numbers = {}
    for middle in (0.01, 0.001) if quick else (0.1, 0.03, 0.01, 0.003, 0.001):
        orbit, alpha = in_series(middle)
        numbers[f"series {middle:g}"] = (orbit.alpha / alpha - 1) / (middle / 8)
        print(f"  m3 = {middle:g}: alpha/alpha_0 - 1 is {numbers[f'series {middle:g}']:.4f} s^2 m3/(2 m2)")
    found = throws()
    numbers["throws"] = len(found)
    print(f"  {len(found)} throws of equal masses, launch speeds " + ", ".join(f"{o.alpha:.8g}" for o in found))
    panels = new_row(2, 0.81, rows=2).ravel()
    plot_orbit(found[0], panels[0]).set_title(f"equal masses, launch speed {found[0].alpha:.5g}")
    for axes, (along, (_, label)) in zip(panels[1:], WAYS.items(), strict=True):
        for orbit, colour in zip(found[:1] if quick else found, COLOURS, strict=False):
            for end in draw(axes, along, hand(), orbit, colour):
                print(f"  from {orbit.alpha:.5g} {end}")
        axes.set(xlabel=label, ylabel="launch speed", ylim=(0, 12), xscale="linear" if along == "b" else "log")
    masses, speeds = np.geomspace(0.01, 1.0, 8 if quick else 60), []
    for middle in masses:
        try:
            speeds.append(in_series(middle)[0].alpha)
        except NoOrbit:
            speeds.append(np.nan)
    numbers["missed"] = int(np.isnan(speeds).sum())
    panels[1].plot(masses, speeds, ".", color="0.4", ms=4, label="near springs in series")
    panels[1].axhline(in_series(0.001)[1], color="0.4", lw=0.8, ls="--", label="springs in series")
    for axes in panels[1:]:
        legend_below(axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'chain_hand.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer masses and families")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
