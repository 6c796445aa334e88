"""A wheel without a rim that walks over level ground and loses nothing: how fast, on what ground, and how forgivingly.

A wheel of 2 kg has spokes of 0.4 m and a body on a torsion spring inside. Its lossless steps are followed in the number
of spokes and in the inertia of the inner body. Beside them stands the same wheel without the spring: at the same speed
it loses 1 - rho^2 of the energy of its turning at each step, rho = 1 - 2 M l^2 sin(a)^2/A. Then the walk is disturbed:
a launch that is off by d loses C d^(4/3) below the lossless one and K C d^(4/3) above it, an injection or a slope pays
for that, and the walk goes on only in a narrow range, which is measured.
Run: python studies/walker.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from math import pi, sin
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence
from scipy.optimize import brentq
from scipy.special import ellipkinc

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import Orbit, find, follow, simulate
from orbits.show import COLOURS, legend_below, new_row, save_figure
from orbits.units import STANDARD_GRAVITY
from problems import rimless_wheel
from studies.disturbed_steps import draw_disturbed

MASS, LENGTH, INERTIA, GRAVITY = 2.0, 0.4, 0.4, STANDARD_GRAVITY
NUMBERS = {"mass": MASS, "length": LENGTH, "inertia": INERTIA, "body_inertia": 0.4, "stiffness": 20.0}
SPOKES, FEWEST, MOST = 8, 5, 20
FAMILIES = (1, 2, 3)
SLOPES = (1e-7, 1e-6, 1e-5, 1e-4)


def wheel(spokes: int = SPOKES, slope: float = 0.0):
    """The wheel with so many spokes."""
    return rimless_wheel(spokes=spokes, slope=slope, **NUMBERS)


def speed(angle, period):
    """The walking speed from half the angle between spokes and the time of a step."""
    return 2 * LENGTH * np.sin(angle) / period


def froude(velocity):
    """The Froude number v^2/(g l)."""
    return np.square(velocity) / (GRAVITY * LENGTH)


def cost_without_spring(velocity: float, spokes: int) -> float:
    """The energy that the wheel without the spring loses for its weight and the distance, at this speed on level
    ground, which is the sine of the slope that pays for it.

    The square of its rate is e + 4 c sin(theta/2)^2, with theta from the vertical, c = M g l/A and the least value
    e, so that a step takes 4/sqrt(e) F(a/2 | -4 c/e), with the elliptic integral of the first kind."""
    angle, c = pi / spokes, MASS * GRAVITY * LENGTH / INERTIA

    def lasts(lg_e: float) -> float:
        return 4 * np.exp(-lg_e / 2) * ellipkinc(angle / 2, -4 * c * np.exp(-lg_e))

    lg_e = brentq(lambda x: velocity * lasts(x) - 2 * LENGTH * sin(angle), -60.0, 20.0, xtol=1e-14)
    left = 1 - 2 * MASS * LENGTH**2 * sin(angle) ** 2 / INERTIA
    energy = INERTIA * (np.exp(lg_e) + 4 * c * sin(angle / 2) ** 2) / 2
    return (1 - left**2) * energy / (MASS * GRAVITY * 2 * LENGTH * sin(angle))


def draw_families(panels, quick: bool) -> dict[str, object]:
    """Draw speed against spokes and inertia, friction against spokes, and costs; the orbits with 8 spokes."""
    by_spokes, by_inertia, grip, costs = np.ravel(panels)
    orbits: dict[int, Orbit] = {}
    for family, colour in zip(FAMILIES[:1] if quick else FAMILIES, COLOURS, strict=False):
        curve = follow(wheel(FEWEST), "angle", pi / MOST, family=family)
        spokes, v = pi / curve.column("angle"), speed(curve.column("angle"), curve.column("period"))
        by_spokes.plot(spokes, v, color=colour, lw=1.6, label=f"family {family}")
        whole = np.arange(FEWEST, MOST + 1, 5 if quick else 1)
        found = [find(wheel(n), family) for n in whole]
        by_spokes.plot(whole, [speed(pi / n, orbit.period) for n, orbit in zip(whole, found, strict=True)], "o",
                       color=colour, ms=4)  # fmt: skip
        grip.plot(whole, [o.certificate.friction_needed for o in found], "o-", color=colour, ms=4, lw=0.8,
                  label=f"family {family}")  # fmt: skip
        curve = follow(wheel().with_values(body_inertia=2.0), "body_inertia", 0.05, family=family)
        v, moves = speed(pi / SPOKES, curve.column("period")), curve.column("admissible").astype(bool)
        for mask, style in ((moves, "-"), (~moves, ":")):
            by_inertia.plot(curve.column("body_inertia") / INERTIA, np.where(mask, v, np.nan), style, color=colour,
                            label=f"family {family}" if style == "-" else None)  # fmt: skip
        orbits[family] = orbit = find(wheel(), family)
        v, friction = speed(pi / SPOKES, orbit.period), orbit.certificate.friction_needed
        print(f"  family {family}, {SPOKES} spokes: {v:.4f} m/s, Froude number {froude(v):.4f}, friction", end="")
        print(f" {friction:.4f}; without the spring it costs {cost_without_spring(v, SPOKES):.4f}")
    velocities = np.linspace(0.1, 1.5, 15 if quick else 60)
    for n, style in zip((6, 8, 12, 20), ("-", "--", "-.", ":"), strict=True):
        costs.plot(velocities, [cost_without_spring(v, n) for v in velocities], style, color="0.3", lw=1.4,
                   label=f"{n} spokes, no spring")  # fmt: skip
    costs.plot([speed(pi / SPOKES, o.period) for o in orbits.values()], [0.0] * len(orbits), "*", ms=11,
               color=COLOURS[1], clip_on=False, zorder=5, label=f"{SPOKES} spokes, lossless")  # fmt: skip
    by_spokes.set(xlabel="number of spokes", title=f"J/A = {NUMBERS['body_inertia'] / INERTIA:g}")
    by_inertia.set(xlabel="inertia ratio J/A", xscale="log", title=f"{SPOKES} spokes; dotted: no motion")
    by_inertia.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    by_inertia.set_xticks([], minor=True)
    grip.set(xlabel="number of spokes", ylabel="friction needed", title="tangential over normal force", ylim=(0, None))
    costs.set(xlabel="speed (m/s)", ylabel="cost of transport", title="energy for weight and distance", ylim=(0, None))
    for axes in (by_spokes, by_inertia):
        axes.set(ylabel="speed (m/s)", ylim=(0, None))
        right = axes.secondary_yaxis("right", functions=(froude, lambda f: np.sqrt(np.abs(f) * GRAVITY * LENGTH)))
        right.set(ylabel="Froude number", yticks=[0.02, 0.05, 0.1, 0.2])
    for axes in np.ravel(panels):
        legend_below(axes)
    return orbits


def in_few_colours(path: Path) -> Path:
    """An animation with one palette of 32 colours for all frames, which takes half the room."""
    with Image.open(path) as animation:
        frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(animation)]
        pause = animation.info["duration"]
    first, *others = (frame.quantize(palette=frames[0].quantize(32), dither=Image.Dither.NONE) for frame in frames)
    first.save(path, save_all=True, append_images=others, duration=pause, loop=0)
    return path


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    panels = new_row(2, 0.81, rows=2)
    orbits = draw_families(panels, quick)
    walk = orbits[1]
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(panels[0, 0], folder / 'walker.png')}\n")
    row = new_row(2, 0.81)
    numbers = draw_disturbed(row, wheel(), walk, quick, 2e-4)
    print(f"  figure: {save_figure(row[0], folder / 'walker_injection.png')}\n")
    hops = 4 if quick else 12
    for slope in SLOPES:
        run = simulate(wheel(slope=slope), walk.alpha, hops=hops)
        numbers[f"slope {slope:g}"] = steps = len(run.launches) - 1
        paid = 2 * MASS * GRAVITY * LENGTH * sin(pi / SPOKES) * sin(slope) / (NUMBERS["body_inertia"] * walk.alpha)
        print(f"  slope {slope:g}, an injection of {paid:.2g} rad/s: {steps} of {hops} steps, {run.status};", end="")
        print(f" last launches {', '.join(f'{off:.2g}' for off in run.launches[-3:] - walk.alpha)} rad/s above")
    print(f"  animation: {in_few_colours(walk.animate(folder / 'walker.gif', frames=4 if quick else 84))}")
    return numbers | {"orbits": orbits}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="fewer wheels, launches and steps")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
