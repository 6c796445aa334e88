"""Where a hopper hops on a sprung plate without loss: along the plate's stiffness, and along its mass.

A body and a foot of mass 1 on a spring of stiffness 1, on a plate of mass m3 with stiffness K. At every stiffness that
is tried there are lossless hops that are motions, but no family of them goes all the way. On a stiff plate one of them
is near the plain hop, but not always the same: followed in the stiffness, its times change with the
plate's vibration, it departs from the plain hop, and it ends as a motion where the plate would have to pull the foot.
On softer plates families end where the two frequencies of flight are as 1 : 1 or 1 : 2 (K = 4 and 1 for m3 = 2), with a
launch speed that grows without bound, or where those of contact are as 1 : 2 or 1 : 3, (4 + K)^2 = 3 (n + 1/n)^2 K for
m3 = 2, with a flight that shrinks to nothing.
Run: python studies/plate.py [--output FOLDER] [--quick]
"""

import argparse
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orbits import Family, NoOrbit, Orbit, find, find_all, follow, starts
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper, plate_hopper

ALONG = {"plate_stiffness": (0.1, 200.0), "m3": (0.1, 200.0)}
# Stiffnesses at which hops are taken and followed, with a plate of mass 2, and masses with a plate of stiffness 10.
FROM = {"plate_stiffness": (0.3, 3.0, 10.0, 30.0, 100.0), "m3": (0.3, 2.0, 10.0, 50.0)}
MOST_POINTS = 1500


class Plain(NamedTuple):
    """The plain hopper of two masses 1 on a stiffness 1: its launch speed and half times, and x0 = tan x0."""

    alpha: float
    half_flight: float
    half_contact: float
    x0: float


@cache
def plain() -> Plain:
    """The plain hopper, whose own units are those of mass, stiffness and gravity 1 but for the clock."""
    orbit, clock = find(Hopper()), np.sqrt(2)
    return Plain(orbit.alpha * clock, orbit.flight_time / 2 / clock, orbit.contact_time / 2 / clock, orbit.alpha)


def plate(stiffness: float = 10.0, mass: float = 2.0):
    """The hopper on a plate."""
    return plate_hopper((1.0, 1.0, mass), parameters={"plate_stiffness": stiffness})


def near_plain(stiffness: float, mass: float, sink: float) -> Orbit:
    """The hop on a stiff or heavy plate to which the plain one leads, on a plate that rests so low."""
    guess = {"liftoff": 1 + sink, "alpha": plain().alpha, "plate": sink, "plate'": 0.0}
    times = {"duration": plain().half_flight, "contact_duration": plain().half_contact}
    return find(plate(stiffness, mass), start=guess | times)


def stiff_limit(n: int) -> tuple[float, float]:
    """How far alpha is from the plain hopper's, as a share, and what the law for stiff plates gives, where the plate
    vibrates about n/2 + 1/8 times in the plain hopper's flight, and n/4 + 1/8 times in its contact."""
    flown, stood = (n + 0.25) * np.pi / plain().half_flight, (n / 2 + 0.25) * np.pi / plain().half_contact
    mass = stood**2 / (flown**2 - stood**2)
    orbit = near_plain(mass * flown**2, mass, -1 / flown**2)
    phases = np.tan([flown * orbit.flight_time / 2, stood * orbit.contact_time / 2])
    law = plain().alpha / (plain().x0 ** 2 * mass * flown * (phases[0] + np.sqrt(1 + 1 / mass) * phases[1]))
    return orbit.alpha / plain().alpha - 1, law


def motions(stiffness: float, mass: float, longest: float) -> list[Orbit]:
    """The lossless hops that are motions, with times up to so many of the plain hopper's."""
    machine = plate(stiffness, mass)
    found = starts(machine, longest * plain().half_contact, longest * plain().half_flight)
    try:
        return [orbit for orbit in find_all(machine, found) if orbit.admissible]
    except NoOrbit:
        return []


def both_ways(along: str, value: float, orbit: Orbit, most: int) -> list[Family]:
    """The family of a hop towards both bounds of a parameter, as long as it is one of motions."""
    machine = plate(**{"stiffness" if along == "plate_stiffness" else "mass": value})
    return [
        follow(machine, along, stop, start=orbit, stop_inadmissible=True, most=most, longest=0.02)
        for stop in ALONG[along]
    ]


def shares(items) -> np.ndarray:
    """The times (2, m) of flight and of contact of orbits or points, in those of the plain hopper."""
    each = np.array([(item.flight_time / 2, item.contact_time / 2) for item in items]).reshape(-1, 2)
    return (each / (plain().half_flight, plain().half_contact)).T


def draw_map(panels, quick: bool) -> dict[str, float]:
    """Draw the times of all motions against the plate's stiffness; the fewest motions at a stiffness, and how far the
    nearest to the plain hop is on stiff plates."""
    fewest, farthest, marks = np.inf, 0.0, {axes: [] for axes in panels}
    for stiffness in np.geomspace(*((0.1, 50.0) if quick else ALONG["plate_stiffness"]), 8 if quick else 80):
        found = motions(stiffness, 2.0, 3.0 if stiffness < 5 else 1.5)
        fewest, times = min(fewest, len(found)), shares(found)
        if stiffness > 10:
            farthest = max(farthest, np.abs(times - 1).max(axis=0).min())
        for axes, row in zip(panels, times, strict=True):
            marks[axes] += [(stiffness, share) for share in row]
    for axes, places in marks.items():
        axes.plot(*np.transpose(places), ".", color="0.6", ms=3, label="motions")
    return {"fewest motions": fewest, "farthest from the plain hop": farthest}


def draw_families(panels, along: str, quick: bool) -> dict[str, int]:
    """Draw the families of the hops nearest to the plain one; how many of them end for which reason."""
    reasons: dict[str, int] = {}
    for value, colour in zip(FROM[along][-1:] if quick else FROM[along], COLOURS, strict=False):
        found = motions(*((value, 2.0) if along == "plate_stiffness" else (10.0, value)), 1.5)
        found.sort(key=lambda orbit: np.abs(shares([orbit]) - 1).max())
        for orbit in found[:1]:
            for family in both_ways(along, value, orbit, 200 if quick else MOST_POINTS):
                for axes, row in zip(panels, shares(family), strict=True):
                    label = f"from {value:g}"
                    known = axes.get_legend_handles_labels()[1]
                    axes.plot(family.column(along), row, color=colour, lw=1.2, label=None if label in known else label)
                reason = family.end.reason.split(" at ")[0].split(" near ")[0]
                reasons[reason] = reasons.get(reason, 0) + 1
                print(f"  from {along} = {value:g} to {family[-1].value:.5g}: {family.end.kind}, {family.end.reason}")
    return reasons


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    numbers = {}
    for n in (16, 64) if quick else (16, 32, 64, 128, 256):
        found, law = stiff_limit(n)
        numbers[f"stiff {n}"] = found / law
        print(f"  stiff plate, n = {n}: alpha/alpha_0 - 1 = {found:.4e}, {found / law:.5f} of the law")
    for mass in (100.0, 1e4) if quick else (10.0, 100.0, 1e3, 1e4):
        orbit = near_plain(5.0, mass, -(mass + 2) / 5)
        numbers[f"heavy {mass:g}"] = (orbit.alpha / plain().alpha - 1) * mass
        print(f"  heavy plate, m3 = {mass:g}: alpha/alpha_0 - 1 = {numbers[f'heavy {mass:g}']:.5f} m2/m3")
    panels = new_row(2, 0.81, rows=2)
    numbers |= draw_map(panels[0], quick)
    print(f"  at every stiffness at least {numbers['fewest motions']} motions; on stiff plates times of one of them")
    print(f"  are within {numbers['farthest from the plain hop']:.1%} of the plain hopper's")
    labels = {"plate_stiffness": "stiffness K, m3 = 2", "m3": "mass m3, K = 10"}
    for row, (along, label) in zip(panels, labels.items(), strict=True):
        reasons = draw_families(row, along, quick)
        numbers |= {f"{along}: {reason}": count for reason, count in reasons.items()}
        for axes, what in zip(row, ("flight", "contact"), strict=True):
            axes.axhline(1.0, color="0.4", lw=0.8, ls=":")
            axes.set(xscale="log", xlabel=f"the plate's {label}", ylim=(0, 1.6), ylabel=f"{what} time, plain hop: 1")
            legend_below(axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0][0], folder / 'plate.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer stiffnesses and families")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
