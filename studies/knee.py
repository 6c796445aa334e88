"""A leg with a knee that carries 60 kg: its lossless hops over the length of its links and the knee's stiffness.

Near its rest the knee is a linear spring along the leg, of stiffness kappa/L'^2, and the body is launched with the
speed L' alpha, where L' is the leg's lever. Both cancel: the launch speed of family n, alpha = x (1 + M) g
(mu/kappa)^(1/2) with the n-th root of tan x = x, depends neither on the links nor on the angle of rest, and that of the
hops below differs from it by half a percent at most. The height goes with the square of the lever. What ends the
motions towards long links is the body's weight on the knee: the crouch becomes so deep that the knee folds through.
Run: python studies/knee.py [--output FOLDER] [--quick]
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from orbits import Family, Orbit, Sweep, find, follow, sweep
from orbits.model import half_angle
from orbits.show import COLOURS, colour_bar, legend_below, new_row, plot_orbit, save_figure
from orbits.show.style import NO_MOTIONS, SHADE
from problems import knee_hopper

LEG = knee_hopper(body_mass=60.0, foot_mass=3.0, link=0.45, stiffness=400.0, rest_angle=2.0)
LINKS, STIFFNESSES, SHOWN = (0.25, 0.7), (200.0, 1000.0), 2  # m, N m/rad, the family of map and picture
OFF = 0.01  # the share by which a launch is off


def near_rest(family: int, stiffness: float) -> float:
    """The launch speed for small swings of the knee, in rad/s."""
    p = LEG.values
    m1, m2 = p["body_mass"], p["foot_mass"]
    clock = np.sqrt(m1 * m2 / (m1 + m2) / stiffness)
    return float(half_angle(family) * (1 + m2 / m1) * p["surface_gravity"] * clock)


def told(family: Family) -> dict[str, np.ndarray]:
    """What a designer asks of the hops of a family."""
    values = np.array([point.value for point in family])
    alpha = np.array([point.alpha for point in family])
    p, lever = LEG.values, values * np.cos([point.liftoff_extension / 2 for point in family])
    thrown = p["body_mass"] * lever * alpha / (p["body_mass"] + p["foot_mass"])
    return {
        "link": values,
        "alpha": alpha,
        "rise": thrown**2 / (2 * p["surface_gravity"]),
        "force": np.array([point.largest_contact_force for point in family]),
        "lost": np.array([point.loss_coefficient for point in family]) * alpha ** (1 / 3) * OFF ** (4 / 3),
        "motion": np.array([point.admissible for point in family]),
    }


def draw_leg(axes, orbit: Orbit) -> None:
    """The leg in mid-contact, at lift-off and in mid-flight."""
    link, ground = LEG.values["link"], 0.0
    moments = {
        "crouched": orbit.flight_time + orbit.contact_time / 2,
        "at lift-off": 0.0,
        "in mid-flight": orbit.flight_time / 2,
    }
    places, labels = [], []
    for i, time in enumerate(moments.values()):
        foot, _, angle, _ = orbit(time)
        hip, bend, x = foot + 2 * link * np.sin(angle / 2), link * np.cos(angle / 2), 0.8 * i
        axes.plot([x, x + bend, x], [foot, (foot + hip) / 2, hip], "-", color="0.35", lw=3, solid_joinstyle="round")
        axes.plot(x + bend, (foot + hip) / 2, "o", color="0.35", ms=5)
        axes.plot(x, hip, "o", color=COLOURS[0], ms=10)
        axes.plot(x, foot, "o", color=COLOURS[1], ms=5)
        places.append(x + 0.1)
        labels.append(f"{np.degrees(angle):.0f}°")
    axes.axhspan(-2.0, ground, color=SHADE, zorder=0)
    axes.axhline(ground, color="0.3", lw=1.2)
    axes.set(
        xlim=(-0.35, 2.25),
        ylim=(-0.4, 1.2),
        aspect="equal",
        ylabel="height (m)",
        title=f"the leg {', '.join(moments)}",
    )
    axes.set_xticks(places, labels)
    axes.tick_params(axis="x", length=0)


def draw_map(axes, legs: Sweep) -> None:
    """How high the body rises, over links and stiffness, with the legs whose knee folds through left out."""
    links, stiffnesses = np.unique(legs["link"]), np.unique(legs["stiffness"])
    shape = len(links), len(stiffnesses)
    order = np.lexsort((legs["stiffness"], legs["link"]))
    good = (legs["status"] == "certified")[order].reshape(shape).T
    rise = np.where(good, legs["body_rise"][order].reshape(shape).T, np.nan)
    drawn = axes.pcolormesh(links, stiffnesses, rise, shading="nearest", cmap="viridis", rasterized=True)
    colour_bar(axes, drawn, "rise of the body (m)")
    axes.set_facecolor("0.85")
    axes.fill_between([], [], color="0.85", lw=0, label="the knee folds through")
    legend_below(axes).set(xlabel="link (m)", ylabel="stiffness (N m/rad)", title=f"family {SHOWN}")


def draw(orbit: Orbit, legs: Sweep, families: Mapping[int, Family]):
    """The six panels of the picture."""
    panels = new_row(3, 1.06, rows=2).ravel()
    draw_leg(panels[0], orbit)
    plot_orbit(orbit, panels[1]).set_title(f"a hop of family {SHOWN}")
    draw_map(panels[2], legs)
    for (number, family), colour in zip(families.items(), COLOURS, strict=False):
        found = told(family)
        for axes, name, factor in ((panels[3], "rise", 1), (panels[4], "force", 1e-3), (panels[5], "lost", 100)):
            values = factor * found[name]
            axes.plot(found["link"], np.where(found["motion"], values, np.nan), color=colour, label=f"family {number}")
            if not found["motion"].all():
                label = None if NO_MOTIONS in axes.get_legend_handles_labels()[1] else NO_MOTIONS
                rest = np.where(found["motion"], np.nan, values)
                axes.plot(found["link"], rest, color=colour, lw=1, ls="--", label=label)
    panels[3].set(xlabel="link (m)", ylabel="rise of the centre of mass (m)", title="height")
    panels[4].set(xlabel="link (m)", ylabel="peak force on the ground (kN)", title="force")
    panels[5].set(
        xlabel="link (m)", ylabel="loss of speed (%)", title=f"launch {100 * OFF:g} % too fast, by $C d^{{4/3}}$"
    )
    for axes in panels[3:]:
        axes.set_ylim(bottom=0)
        legend_below(axes)
    return panels[0]


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    orbit = find(LEG, SHOWN)
    print(orbit)
    numbers: dict[str, float] = {}
    families = follow(LEG, "link", *((0.4, 0.7) if quick else LINKS), families=(1, 2, 3)).families
    for n, family in families.items():
        found, linear = told(family), near_rest(n, LEG.values["stiffness"])
        numbers[f"off {n}"] = float(np.abs(found["alpha"] / linear - 1).max())
        lowest = int(np.argmin(found["force"]))
        print(f"  family {n}: alpha = {linear:.5g} rad/s, to {numbers[f'off {n}']:.1%} at every link", end="")
        print(f"; least peak force {found['force'][lowest]:.5g} N at link {found['link'][lowest]:.3g} m")
        for event in family.events:
            numbers[f"folds {n}"] = event.point.value
            print(f"    the knee folds through from link {event.point.value:.6g} m")
    count = 3 if quick else 15
    over = {"link": np.linspace(*LINKS, count).tolist(), "stiffness": np.linspace(*STIFFNESSES, count).tolist()}
    legs = sweep(LEG, over, family=SHOWN, quantities=["body_rise"], progress=False)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(draw(orbit, legs, families), folder / 'knee.png')}")
    print(f"  animation: {orbit.animate(folder / 'knee.gif', frames=4 if quick else 80)}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure and the animation")
    parser.add_argument("--quick", action="store_true", help="fewer legs")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
