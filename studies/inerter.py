"""A leg of 60 kg with an inerter parallel to its spring: how high does it hop without loss, with what stroke and force?

The lossless hop of a leg with a light foot is low, because foot and body oscillate fast against each other. An inerter
b slows this oscillation as a heavy foot would, without its weight. With a linear spring the rise grows in proportion to
mu + b, where mu is the reduced mass of body and foot. A softer leg would slow the contact down as well: the same rise
then takes a longer stroke, though less force. The disadvantage of the inerter is a less forgiving hop: with a large
inerter a launch that is 1 % too fast loses more than this 1 %. With a hardening spring the inerter gains less height,
with a shorter stroke.
Run: python studies/inerter.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import Family, find, follow
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import inerter_hopper

BODY, FOOT, GRAVITY, LENGTH, STIFFNESS, HARDENING = 60.0, 3.0, 9.81, 0.8, 5000.0, 1e5  # kg, m, N/m, N/m^3
OFF = 0.01  # the share by which a launch is off
COMPARED = 0.1  # the rise at which stroke and force are compared, in m
SHOWN = 20.0  # the inertance of the hop that is drawn, in kg


def leg(inertance: float, spring: str = "k*r", **more: float):
    """The leg with an inerter and a spring."""
    return inerter_hopper(
        spring, body_mass=BODY, foot_mass=FOOT, inertance=inertance, surface_gravity=GRAVITY, rest_length=LENGTH,
        parameters={"k": STIFFNESS, **more}, in_si=True,
    )  # fmt: skip


def told(family: Family) -> dict[str, np.ndarray]:
    """What a designer asks of the hops of a family that are motions."""
    points = [point for point in family if point.admissible]
    alpha = np.array([point.alpha for point in points])
    return {
        "value": np.array([point.value for point in points]),
        "alpha": alpha,
        "rise": (BODY * alpha / (BODY + FOOT)) ** 2 / (2 * GRAVITY),
        "stroke": LENGTH - np.array([point.smallest_separation for point in points]),
        "force": np.array([point.largest_contact_force for point in points]),
        "lost": np.array([point.loss_coefficient for point in points]) * alpha ** (1 / 3) * OFF ** (4 / 3),
    }


def draw(legs: dict[str, dict[str, np.ndarray]]):
    """The six panels of the picture."""
    panels = new_row(3, 1.06, rows=2).ravel()
    for inertance, style in ((0.0, "--"), (SHOWN, "-")):
        orbit = find(leg(inertance))
        t = np.linspace(0.0, orbit.period, 600)
        for (name, height), colour in zip(list(orbit.shape.heights.items())[:2], COLOURS, strict=False):
            panels[0].plot(t, height(orbit(t)), style, color=colour, label=f"{name}, b = {inertance:g} kg")
    panels[0].set(xlabel="time (s)", ylabel="height (m)", title="two hops, linear spring")
    for (name, found), colour in zip(legs.items(), COLOURS, strict=False):
        style = {"color": colour, "label": name, "ls": "--" if "softer" in name else "-"}
        if "softer" not in name:
            panels[1].plot(found["value"], found["alpha"], **style)
            panels[2].plot(found["value"], found["rise"], **style)
            panels[5].plot(found["value"], 100 * found["lost"], **style)
        panels[3].plot(found["rise"], found["stroke"], **style)
        panels[4].plot(found["rise"], found["force"] / 1000, **style)
    panels[1].set(xlabel="inertance (kg)", ylabel="launch speed (m/s)", title="speed of the body at lift-off")
    panels[2].set(xlabel="inertance (kg)", ylabel="rise of the centre of mass (m)", title="height of the hop")
    panels[3].set(xlabel="rise of the centre of mass (m)", ylabel="compression of the leg (m)", title="stroke")
    panels[4].set(xlabel="rise of the centre of mass (m)", ylabel="peak force on the ground (kN)", title="force")
    panels[5].set(
        xlabel="inertance (kg)", ylabel="loss of speed (%)", title=f"launch {100 * OFF:g} % too fast, by $C d^{{4/3}}$"
    )
    for axes in panels:
        axes.set_ylim(bottom=0)
        legend_below(axes)
    return panels[0]


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    most = 10.0 if quick else 60.0
    families = {
        "inerter, linear spring": follow(leg(0.0), "inertance", 0.0, most),
        "inerter, hardening spring": follow(leg(0.0, "k*r + c*r**3", c=HARDENING), "inertance", 0.0, most),
        "softer linear spring, no inerter": follow(leg(0.0), "k", STIFFNESS, 2500.0 if quick else 1000.0),
    }
    legs = {name: told(family) for name, family in families.items()}
    reduced, linear = BODY * FOOT / (BODY + FOOT), legs["inerter, linear spring"]
    per_mass = linear["rise"] / (reduced + linear["value"])
    numbers = {"rise over mu + b": float(per_mass[0]), "spread of it": float(np.ptp(per_mass))}
    print(f"\n  with a linear spring the rise is {per_mass[0]:.6g} m per kg of mu + b, mu = {reduced:.4g} kg")
    for name, family in families.items():
        found, order = legs[name], np.argsort(legs[name]["rise"])
        stroke, force = (np.interp(COMPARED, found["rise"][order], found[what][order]) for what in ("stroke", "force"))
        numbers |= {f"stroke, {name}": float(stroke), f"highest, {name}": float(found["rise"].max())}
        print(f"  {name}: a rise of {COMPARED:g} m takes {stroke:.4g} m and {force:.5g} N; the highest is", end="")
        print(f" {found['rise'].max():.4g} m, where {'the masses touch' if family.events else 'the study ends'}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(draw(legs), folder / 'inerter.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="smaller inerters")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
