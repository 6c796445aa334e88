"""A hopper with two springs in series and an unsprung mass between: how it departs from the hopper on one spring.

Body and foot of mass 1 on springs of stiffness 3/2 above and 3 below, whose compliances add to 1. A small mass e
between moves with body and foot by the shares 1/3 and 2/3, so that to first order it adds to their masses, less an
inertance of 2/9 e between them; what is left is its own vibration, of order e^(3/2), which grows where it turns as the
hop does. With a heavier mass there are hops near the plain one at most masses, but each ends as a motion nearby: the
ground would have to pull.
Run: python studies/series.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import NoOrbit, Orbit, find, find_all, follow
from orbits.show import COLOURS, legend_below, new_row, plot_orbit, save_figure
from problems import Chain
from studies.plate import plain

FOLLOWED_FROM = (0.05, 0.2, 1.0)


def series(mass: float) -> Chain:
    """The hopper with a mass between its springs."""
    return Chain((1.0, mass, 1.0), ["3/2*r", "3*r"])


def near_plain(mass: float) -> Orbit:
    """The hop to which that on one spring leads."""
    alpha, flight, contact, _ = plain()
    launch = {"y1": 1.0, "y1'": alpha, "liftoff": 1 / 3, "alpha": alpha / 3}
    return find(series(mass), start=launch | {"duration": flight, "contact_duration": contact})


def first_order(mass: float) -> tuple[float, float]:
    """The body's launch speed and half the flight, without the vibration of the mass."""
    body, foot = 1 + mass / 3, 1 + 2 * mass / 3
    flight = plain().x0 * np.sqrt(body * foot / (body + foot) - 2 / 9 * mass)
    return flight * (body + foot) / body, flight


def departures(masses) -> np.ndarray:
    """The body's launch speed (m,) over that on one spring, less 1, at each mass; NaN where no hop is found near."""
    alpha, found = plain().alpha, []
    for mass in masses:
        try:
            found.append(near_plain(mass)(0.0)[1] / alpha - 1)
        except NoOrbit:
            found.append(np.nan)
    return np.array(found)


def motions(mass: float) -> list[Orbit]:
    """The hops that are motions, with times up to 1.3 of those on one spring."""
    chain = series(mass)
    try:
        found = find_all(chain, chain.starts(1.3 * plain().half_contact, 1.3 * plain().half_flight))
        return [orbit for orbit in found if orbit.admissible]
    except NoOrbit:
        return []


def draw_map(axes, quick: bool) -> dict[str, float]:
    """Draw the flight times of all motions against the unsprung mass, and the families of those nearest to the plain
    hop from some masses; the heaviest mass to which each was followed as a motion."""
    half_flight, heaviest = plain().half_flight, {}
    masses = np.geomspace(*((0.2, 5.0, 2) if quick else (0.02, 10.0, 50)))
    marks = [(mass, orbit.flight_time / 2 / half_flight) for mass in masses for orbit in motions(mass)]
    axes.plot(*np.transpose(marks), ".", color="0.6", ms=3, label="motions")
    for mass, colour in zip(FOLLOWED_FROM[1:2] if quick else FOLLOWED_FROM, COLOURS, strict=False):
        orbit = min(motions(mass), key=lambda orbit: abs(orbit.flight_time / 2 / half_flight - 1))
        label = f"from e = {mass:g}"
        for stop in (10.0, 0.02):
            family = follow(series(mass), "m2", stop, start=orbit, stop_inadmissible=True)
            times = family.column("flight_time") / 2 / half_flight
            axes.plot(family.column("m2"), times, color=colour, label=label if stop > mass else None)
            print(f"  from e = {mass:g} to {family[-1].value:.5g}: {family.end.kind}, {family.end.reason}")
            heaviest[f"end {mass:g} {stop:g}"] = family[-1].value
    axes.set(xscale="log", xlabel="unsprung mass e", ylabel="flight time, plain hop: 1")
    axes.set(xlim=(0.015, 12.0), ylim=(0, 1.35), title="motions and families")
    legend_below(axes)
    return heaviest


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    numbers, (one, two, three) = {}, new_row(3, 1.25)
    masses = np.geomspace(1e-4, 0.1, 12 if quick else 120)
    off, law = departures(masses), np.array([first_order(mass)[0] for mass in masses]) / plain().alpha - 1
    numbers["largest vibration"] = float(np.nanmax(np.abs(off - law) / masses**1.5))
    numbers["missed"] = int(np.isnan(off).sum())
    print(f"  beside the first order at most {numbers['largest vibration']:.3g} e^(3/2), {numbers['missed']} not found")
    one.loglog(masses, law, color="0.4", lw=0.8, ls="--", label="first order")
    one.loglog(masses, off, ".", color=COLOURS[0], ms=4, label="hops")
    one.set(xlabel="unsprung mass e", ylabel="α/α₀ - 1", title="a small mass between")
    legend_below(one)
    numbers |= draw_map(two, quick)
    plot_orbit(near_plain(0.03), three).set_title("e = 0.03")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(one, folder / 'series.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer masses")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
