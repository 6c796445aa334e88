"""A hopping rover on a small asteroid: which lossless hops are near 10 m, and how far off is constant gravity?

A 3 kg rover, body 2.5 kg and foot 0.5 kg, hops on a sphere of radius 250 m with surface gravity 1e-4 m/s^2. Its leg
spring is a soft coil: 50 mN/m, hardening with stroke, 0.6 m long. One oscillation takes 18 s and a hop takes a quarter
of an hour. So the hops belong to families near 50, and gravity decreases by 8 % on the way up.
Run: python studies/asteroid.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import hopper_in_si

ROVER = {"body_mass": 2.5, "foot_mass": 0.5, "surface_gravity": 1e-4, "rest_length": 0.6}
SPRING = "k1*r + k3*r**3"  # N, of the extension in m
STIFFNESS = {"k1": 0.05, "k3": 0.1}
RADIUS = 250.0  # m
WANTED = 10.0  # m


def rover(radius: float | None = RADIUS):
    """The rover on a sphere of that radius, or under constant gravity."""
    return hopper_in_si(force=SPRING, parameters=STIFFNESS, body_radius=radius, **ROVER)


def rise(orbit) -> float:
    """How far the centre of mass rises, m."""
    return orbit.si()["centre_of_mass_rise_m"]


def hops(families, radius: float | None = RADIUS) -> list:
    return [find(rover(radius), family) for family in families]


def nearest(families=range(44, 60)) -> tuple[list, list]:
    """The hops of these families on the asteroid, and under constant gravity."""
    return hops(families), hops(families, None)


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    families = range(50, 54) if quick else range(44, 60)
    real, flat = nearest(families)
    best = min(real, key=lambda orbit: abs(rise(orbit) - WANTED))
    columns = f"  {'family':>6}{'launch m/s':>12}{'rise m':>10}{'flight s':>10}{'stroke m':>10}"
    print(columns + "   constant gravity: rise m, off")
    for orbit, other in zip(real, flat, strict=True):
        si = orbit.si()
        stroke = ROVER["rest_length"] - si["smallest_separation_m"]
        mark = "  <- nearest 10 m" if orbit is best else ""
        print(
            f"  {orbit.family:>6}{si['alpha_m_per_s']:>12.6f}{rise(orbit):>10.4f}{si['flight_time_s']:>10.2f}"
            f"{stroke:>10.3f}   {rise(other):>10.4f}{rise(other) / rise(orbit) - 1:>8.1%}{mark}"
        )
    print("\n", best, sep="")

    path, zoom, families_axes = new_row(1, 0.36, rows=3)
    si = best.si()
    t = np.linspace(0, best.period, 6001)
    states = best(t)
    colours = dict(zip(("body", "foot"), COLOURS, strict=False))
    for name, colour in colours.items():
        path.plot(t / 60, best.shape.heights[name](states), color=colour, lw=1.1, label=name)
    path.axhline(0, color="0.4", lw=0.8)
    path.set(xlabel="time (min)", ylabel="height (m)", xlim=(0, best.period / 60))
    path.set_title(
        f"family {best.family}: {rise(best):.2f} m in {si['flight_time_s'] / 60:.1f} min, nothing lost",
    )
    legend_below(path)
    first = t < 0.08 * best.flight_time
    for name, colour in colours.items():
        zoom.plot(t[first], best.shape.heights[name](states[first]), color=colour, lw=1.2)
    zoom.set(title="after lift-off", xlabel="time (s)", ylabel="height (m)")
    n = [orbit.family for orbit in real]
    families_axes.plot(n, [rise(orbit) for orbit in real], "o", color=COLOURS[2], label=f"radius {RADIUS:.0f} m")
    families_axes.plot(n, [rise(orbit) for orbit in flat], "o", mfc="none", color="0.4", label="constant gravity")
    families_axes.axhline(WANTED, color="0.7", lw=0.8)
    families_axes.set(xlabel="family", ylabel="rise of the centre of mass (m)")
    families_axes.set_xticks(n)
    legend_below(families_axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(path, folder / 'asteroid.png')}")
    if not quick:
        print(f"  animation: {best.animate(folder / 'asteroid.gif', frames=150)}")
    off = {o.family: rise(f) / rise(o) - 1 for o, f in zip(real, flat, strict=True)}
    return {"family": best.family, "alpha": best.alpha, "rise": rise(best), "constant_gravity_off": off[best.family]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for figure and animation")
    parser.add_argument("--quick", action="store_true", help="four families, no animation")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
