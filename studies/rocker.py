"""A block that rocks from edge to edge forever: how far it tilts, beside Housner's block, and what injections do.

A solid block of 3 kg, 0.1 m wide and 0.4 m high, has a body on a torsion spring inside. Its lossless rocking is
followed in the inertia of that body. Housner's block, the same one without the spring, has rho = 1 - 3/2 sin(a)^2 of
its rate left at each landing and comes to rest. A launch that is off by d loses C d^(4/3) above the lossless one and
K C d^(4/3) below it. So an injection at each rock leads to one launch speed, unlike that of a wheel that walks.
Run: python studies/rocker.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from collections.abc import Sequence
from math import acosh, atan2, hypot, sin
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import Orbit, find, follow
from orbits.result import Axes
from orbits.show import COLOURS, legend_below, new_row, save_figure
from orbits.units import STANDARD_GRAVITY
from problems import rocking_block
from studies.disturbed_steps import draw_disturbed

MASS, HALF_WIDTH, HALF_HEIGHT, GRAVITY = 3.0, 0.05, 0.2, STANDARD_GRAVITY
RADIUS, ANGLE = hypot(HALF_WIDTH, HALF_HEIGHT), atan2(HALF_WIDTH, HALF_HEIGHT)
INERTIA = 4 / 3 * MASS * RADIUS**2  # of a solid block about an edge
LEFT = 1 - 1.5 * sin(ANGLE) ** 2  # of the rate at a landing
FAMILIES = (1, 2, 3)


def block(body_inertia: float = 0.2):
    """The block with a body of this inertia inside."""
    return rocking_block(MASS, HALF_WIDTH, HALF_HEIGHT, INERTIA, body_inertia, stiffness=40.0)


def largest_tilt(rise):
    """The angle by which a block tilts where its other edge has risen so far, over the angle a."""
    return np.arcsin(rise / (2 * HALF_WIDTH)) / ANGLE


def housner(tilted: float, rocks: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Times and angles, signed by the edge, of Housner's block released at an angle: of its fall and of its rocks."""

    def rates(t, y):
        return y[1], MASS * GRAVITY * RADIUS / INERTIA * np.sin(y[0] - ANGLE)

    def lands(t, y):
        return y[0] if t > 0 else 1.0

    lands.terminal, lands.direction = True, -1
    state, now, side, found = [tilted, 0.0], 0.0, 1, []
    for _ in range(rocks):
        run = solve_ivp(rates, (0, 10), state, "DOP853", events=lands, rtol=1e-11, atol=1e-13, dense_output=True)
        t = np.linspace(0, run.t[-1], 60)
        found.append((now + t, side * run.sol(t)[0]))
        state, now, side = [1e-15, -LEFT * run.y[1, -1]], now + run.t[-1], -side
    return found


def tilt_after(tilted: float, landings: int) -> float:
    """The angle to which Housner's block tilts after so many landings, in closed form: M g R (cos(a - theta) - cos(a))
    falls by rho^2 at each of them."""
    left = LEFT ** (2 * landings) * (np.cos(ANGLE - tilted) - np.cos(ANGLE))
    return float(ANGLE - np.arccos(np.cos(ANGLE) + left))


def draw_families(axes: Axes, families: Sequence[int]) -> None:
    """Draw the largest tilt of the lossless families against the inertia of the inner body."""
    for family, colour, style in zip(families, COLOURS, ("-", "--", "-."), strict=False):
        curve = follow(block(2.0), "body_inertia", 0.02, family=family)
        tilts = largest_tilt(curve.column("lifted_edge_rise"))
        motions = np.where(curve.column("admissible").astype(bool), tilts, np.nan)
        axes.plot(curve.column("body_inertia") / INERTIA, motions, style, color=colour, label=f"family {family}")
    axes.set(xscale="log", xlabel="inertia ratio J/A", ylabel="largest tilt over the angle a", ylim=(0, 1))
    legend_below(axes)


def draw_beside_housner(axes: Axes, orbit: Orbit) -> None:
    """Draw the lossless rocking and that of Housner's block, released at the same tilt."""
    middle, t = orbit.flight_time / 2, np.linspace(0, 3.0, 900)
    theta = orbit.unrolled(middle + t)[:, orbit.flight.names.index("theta")]
    axes.plot(t, theta / ANGLE, color=COLOURS[0], lw=1.6, label="lossless, with the spring")
    released = ANGLE * largest_tilt(orbit.rises["lifted edge"])
    t, theta = (np.concatenate(each) for each in zip(*housner(released, 16), strict=True))
    axes.plot(t, theta / ANGLE, "--", color=COLOURS[1], lw=1.4, label="Housner's block")
    axes.axhline(0, color="0.4", lw=0.8)
    axes.set(xlabel="time (s)", ylabel="tilt over the angle a", xlim=(0, 3.0))
    legend_below(axes)


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    panels, orbits = new_row(2, 0.81, rows=2), {family: find(block(), family) for family in FAMILIES}
    tilts = {family: largest_tilt(orbit.rises["lifted edge"]) for family, orbit in orbits.items()}
    for family, orbit in orbits.items():
        print(f"  family {family}: tilts up to {tilts[family]:.4f} a, two rocks take {2 * orbit.period:.4f} s,", end="")
        print(f" friction {orbit.certificate.friction_needed:.4f}")
    rock, released = orbits[1], ANGLE * tilts[1]
    rocks, left = housner(released, 11), tilt_after(released, 10)
    slender = 4 * acosh(1 / (1 - tilts[1])) / (MASS * GRAVITY * RADIUS / INERTIA) ** 0.5
    print(f"  Housner's block has {LEFT**2:.4f} of its energy left at a landing; from the same tilt its period")
    print(f"  is {4 * rocks[0][0][-1]:.4f} s ({slender:.4f} s if slender), and after 10 landings it tilts to", end="")
    print(f" {left / ANGLE:.4f} a")
    draw_families(panels[0, 0], FAMILIES[:1] if quick else FAMILIES)
    draw_beside_housner(panels[0, 1], rock)
    numbers = draw_disturbed(panels[1], block(), rock, quick, 2e-4)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(panels[0, 0], folder / 'rocker.png')}")
    return numbers | {"orbits": orbits, "tilts": tilts, "rocks": rocks, "left": left}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer launches and steps")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
