"""Fig. 7 of the paper made numeric: why lossless hops exist for nonlinear springs and varying gravity.

The machine starts at rest in mid-flight, with the centre of mass at height h and the spring compressed by a. For a
small a the foot falls without turning. As a grows, extrema of its path appear in pairs, at an inflection with y2' =
y2'' = 0. For each height one compression a(h) has such an inflection. The lossless hop has the height at which the
inflection lies on the ground.
Run: python studies/figure_7.py [--output FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from orbits import find
from orbits.flow import flow_of
from orbits.model import Arc, Statement
from orbits.numerics import derivative, piecewise_roots
from orbits.shooting import Shooting
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper

MACHINE = Hopper("r + beta*r**3", "1/(1 + z/R)**2", rest_length=12.0, parameters={"beta": 0.1, "R": 60.0})
HEIGHT = 7.0  # of the centre of mass in mid-flight, over its height when the foot stands and the spring is unloaded
COMPRESSIONS = (1.2, 1.8, 2.6, 3.4)


def rest(height, compression, mass_ratio):
    """Flight state at rest with the centre of mass and the spring as given."""
    share = compression / (1 + mass_ratio)
    return [height - mass_ratio * share, 0.0, height + share, 0.0]


def foot_path(height: float, compression: float, duration: float):
    """The flight from rest, and the times at which the foot turns."""
    start = rest(height, compression, MACHINE.mass_ratio)
    path, _ = flow_of(MACHINE.model.flight, tuple(MACHINE.values)).run(start, list(MACHINE.values.values()), duration)
    turns = piecewise_roots(derivative(path.row("y2")), path.steps, start=1)
    return path, [path.times[i] + t for i, t in turns]


def inflection_equations() -> Shooting:
    """y2' = y2'' = 0 at an unknown time after an unknown compression, the height being a parameter."""
    flight = MACHINE.model.flight
    arc = Arc(
        flight,
        start=lambda u, before, p: rest(p["height"], u["compression"], p["mass_ratio"]),
        duration=lambda u, p: u["time"],
        conditions=lambda u, x, p: [x[3], flight.field(x, p, [])[3]],
    )
    statement = Statement("inflection", ("compression", "time"), (arc,), ("time",))
    return Shooting(statement, (*MACHINE.values, "height"))


def inflection_curve(heights, compression: float, time: float):
    """Compression, time, and state of the inflection at each height, from a guess at the first."""
    equations, u, found = inflection_equations(), np.array([compression, time]), []
    for height in heights:
        u, here = equations.newton(u, np.array([*MACHINE.values.values(), height]))
        found.append([height, *u, *here.trajectories[0].finals[0, :4]])
    return np.array(found)


def main(folder: Path) -> dict[str, float]:
    orbit = find(MACHINE)
    # From the hop itself backwards: in mid-flight it is at rest, and half a flight later lies its inflection.
    y1, y2 = orbit.state_mid_flight[[0, 2]]
    M = MACHINE.mass_ratio
    top = (y1 + M * y2) / (1 + M)
    up = inflection_curve(np.linspace(top, top + 4, 41), y2 - y1, orbit.flight_time / 2)
    down = inflection_curve(np.linspace(top, top - 3, 31), y2 - y1, orbit.flight_time / 2)
    curve = np.vstack([down[::-1], up[1:]])

    def on_the_ground(height):
        nearest = curve[np.abs(curve[:, 0] - height).argmin()]
        return inflection_curve([height], *nearest[1:3])[0, 5]

    height = brentq(on_the_ground, curve[0, 0], curve[-1, 0], xtol=1e-14, rtol=1e-14)
    nearest = curve[np.abs(curve[:, 0] - height).argmin()]
    _, compression, time, _, speed, _, _ = inflection_curve([height], *nearest[1:3])[0]
    print(f"  inflection on the ground: h = {height:.12g}, a = {compression:.12g}, {time:.12g} after mid-flight")
    print(f"  speed of the body there {-speed:.15g}; launch speed of the hop {orbit.alpha:.15g} +- {orbit.error:.1e}")

    left, middle, right = new_row(3, 1.4)
    critical = inflection_curve([HEIGHT], *curve[np.abs(curve[:, 0] - HEIGHT).argmin(), 1:3])[0]
    pairs = []
    for compression_, colour in zip((*COMPRESSIONS, critical[1]), (*"0123", "k"), strict=True):
        path, turns = foot_path(HEIGHT, compression_, 1.25 * critical[2])
        pairs.append(len(turns) // 2)
        t = np.linspace(0, path.times[-1], 400)
        style = {"color": "k", "lw": 2} if colour == "k" else {"color": COLOURS[int(colour)], "lw": 1.3}
        word = "inflection" if colour == "k" else f"{pairs[-1]} pair" + "s" * (pairs[-1] != 1)
        left.plot(t, path(t)[:, 2], label=f"a = {compression_:.3g}: {word}", **style)
        left.plot(turns, path(np.array(turns))[:, 2] if turns else [], "o", ms=4, color=style["color"])
    left.plot(critical[2], critical[5], "ks", ms=6, mfc="w")
    left.set(xlabel="time after mid-flight", ylabel="foot y₂", title=f"released from rest at h = {HEIGHT:g}")
    legend_below(left)
    middle.plot(curve[:, 0], curve[:, 1], color=COLOURS[0], lw=2)
    middle.plot(HEIGHT, critical[1], "ks", ms=6, mfc="w")
    middle.plot(height, compression, "o", color=COLOURS[1])
    middle.set(xlabel="height h of the centre of mass", ylabel="compression a", title="where a pair of extrema is born")
    right.axhline(0, color="0.6", lw=0.8)
    right.plot(curve[:, 0], curve[:, 5], color=COLOURS[0], lw=2)
    right.plot(HEIGHT, critical[5], "ks", ms=6, mfc="w", label=f"h = {HEIGHT:g}")
    right.plot(height, 0, "o", color=COLOURS[1], label=f"lossless hop, α = {-speed:.6g}")
    right.set(
        xlabel="height h of the centre of mass",
        ylabel="foot at the inflection",
        title="and where that meets the ground",
    )
    legend_below(right)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(left, folder / 'figure_7.png')}")
    return {"alpha": -speed, "expected": orbit.alpha, "pairs": pairs[:-1], "height": height}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    main(parser.parse_args().output)
