"""Two rigid legs and a torso that walk and lose nothing: how fast, on what friction, and where such walks end.

Families of walks begin at the machine at rest and are followed along the step angle, each walk with the torso's inertia
and the stiffness of the hip that it needs. Two sets are drawn: legs of 5 % of the mass each as rods, with torsos of
several heights, and torsos with their centre of mass at the hip on legs whose masses are at the feet. Then the hips are
damped. A damper c between the torso and each leg with the rates w of their relative angles costs, to first order, the
integral of c w^2 over the lossless step. Over weight and step this is a cost of transport, which is compared with that
of walkers that were built. Lengths are in legs, masses in the whole, and speeds in sqrt(g l).
Run: python studies/walker_two_legs.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.integrate import simpson

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import Family, Mechanism, Orbit, find, follow
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import walker
from studies.walker import in_few_colours

TUNED = ("torso_inertia", "hip_stiffness")
# The walks of the step angle SMALL: heights of the torso, and masses of a leg, with the tuned numbers near them.
TORSOS = {0.0: (0.453, 0.475), 0.05: (0.436, 0.430), 0.1: (0.406, 0.394), 0.2: (0.303, 0.334)}
FEET = {0.08: (0.268, 0.420), 0.1: (0.378, 0.400), 0.15: (0.627, 0.350), 0.2: (0.807, 0.300)}
SMALL, ANGLE, WIDEST = 0.05, 0.3, 1.5
# Mechanical costs of transport: positive work over weight and distance. S. Collins, A. Ruina, R. Tedrake and M. Wisse,
# Science 307 (2005) 1082-1085, for three of them; 21 % of a total of 0.19 for the Cornell Ranger, P. A. Bhounsule et
# al., Int. J. Robotics Research 33 (2014) 1305-1321.
BUILT = {"Honda ASIMO": 1.6, "Cornell biped": 0.055, "human": 0.05, "Cornell Ranger": 0.04}


def rods(torso_height: float, torso_inertia: float, hip_stiffness: float) -> Mechanism:
    """A walker whose legs are rods of 5 % of the mass each."""
    return walker(0.05, 0.5, 0.05 / 12, torso_height, torso_inertia, hip_stiffness)


def heavy_feet(leg_mass: float, torso_inertia: float, hip_stiffness: float) -> Mechanism:
    """A walker whose legs have their masses at the feet, and whose torso's centre of mass is the hip."""
    return walker(leg_mass, 1.0, 0.0, 0.0, torso_inertia, hip_stiffness)


def family(machine: Mechanism, first: float, widest: float, longest: float = 0.02) -> Family:
    """The walks of a machine from one step angle to another, as far as they are motions."""
    walk = find(machine, tune=TUNED, at={"angle": first})
    return follow(walk.source, "angle", widest, walk, tune=TUNED, stop_inadmissible=True, longest=longest)


def in_si() -> Orbit:
    """A walk of a machine of 60 kg on legs of 0.9 m and 9 kg each."""
    machine = walker(9.0, 0.7, 0.3, 0.0, 18.0, 200.0, mass=60.0, leg_length=0.9, in_si=True)
    return find(machine, tune=TUNED, at={"angle": ANGLE})


def cost_of_damping(walk: Orbit) -> float:
    """The cost of transport per damping ratio of the torso on its two springs, to first order."""
    p = walk.source.values
    assert walk.step is not None
    assert walk.contact_time is not None
    squares = 0.0
    for begins, lasts in ((0.0, walk.flight_time), (walk.flight_time, walk.contact_time)):
        t = begins + np.linspace(1e-12, 1 - 1e-12, 2001) * lasts  # within one phase
        _, lean, _, angle, _, torso = walk(t).T
        squares += simpson((torso - lean - angle) ** 2 + (torso - lean + angle) ** 2, x=t)
    body = p["torso_inertia"] + (p["mass"] - 2 * p["leg_mass"]) * p["torso_height"] ** 2
    critical = np.sqrt(2 * p["hip_stiffness"] * body)  # of each damper, where the ratio is 1
    return float(critical * squares / (p["mass"] * p["surface_gravity"] * walk.step))


def ended(each: Family) -> str:
    """Where a family ends, and why."""
    folds = [event.value for event in each.events if event.kind == "fold"]
    turned = f", after a fold at {folds[0]:.4f}" if folds else ""
    return f"{each.points[-1].value:.4f}{turned}: {each.end.reason}"


def draw_families(panels, curves: dict[str, Family]) -> None:
    """Draw speed, friction and the least force on the standing foot along families of walks."""
    names = ("mean_speed", "friction_needed", "smallest_stance_force")
    for (label, each), colour in zip(curves.items(), COLOURS, strict=False):
        moves, angle = each.column("admissible").astype(bool), each.column("angle")
        for axes, name in zip(panels, names, strict=True):
            axes.plot(angle[moves], each.column(name)[moves], color=colour, lw=1.5, label=label)
            axes.plot(angle[moves][-1], each.column(name)[moves][-1], "o", ms=4, color=colour)
    labels = ("mean speed", "friction needed", "least force on a foot")
    for axes, label in zip(panels, labels, strict=True):
        axes.set(xlabel="step angle (rad)", ylabel=label, xlim=(0, None), ylim=(0, None))
    panels[1].set(ylim=(0, 1))
    panels[2].set(ylim=(0, 1.05))
    legend_below(panels[1])


def draw_tuned(axes, sets: list[dict[str, Family]]) -> None:
    """Draw the tuned numbers of the walks."""
    for curves, style in zip(sets, ("-", "--"), strict=True):
        for (label, each), colour in zip(curves.items(), COLOURS, strict=False):
            moves = each.column("admissible").astype(bool)
            inertia, stiffness = (each.column(name)[moves] for name in TUNED)
            axes.plot(inertia, stiffness, style, color=colour, lw=1.3, label=label)
            axes.plot(inertia[0], stiffness[0], "s", ms=4, color=colour)
    axes.set(xlabel="inertia of the torso", ylabel="stiffness of a hip spring", title="tuned numbers, from small steps")


def draw_costs(axes, walks: dict[str, Orbit]) -> dict[str, float]:
    """Draw what damping costs, with the costs of walkers that were built."""
    ratios, costs = np.geomspace(1e-4, 1, 50), dict[str, float]()
    for (label, walk), colour in zip(walks.items(), COLOURS, strict=False):
        costs[label] = cost_of_damping(walk)
        axes.plot(ratios, costs[label] * ratios, color=colour, lw=1.5, label=label)
    for (name, cost), style in zip(BUILT.items(), ("-", "--", "-.", ":"), strict=True):
        axes.axhline(cost, color="0.4", lw=1.0, ls=style, label=name)
    axes.set(xscale="log", yscale="log", xlabel="damping ratio of the torso", ylabel="cost of transport")
    axes.set(xlim=(ratios[0], ratios[-1]), title=f"step angle {ANGLE:g}")
    return costs


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    numbers, way = dict[str, object](), (ANGLE, ANGLE + 0.01, 0.5) if quick else (SMALL, WIDEST)
    torsos = {0.0: TORSOS[0.0]} if quick else TORSOS
    feet = {0.1: FEET[0.1]} if quick else FEET
    sets = [
        {f"torso at {height:g}": family(rods(height, *near), *way) for height, near in torsos.items()},
        {f"legs of {mass:g}": family(heavy_feet(mass, *near), *way) for mass, near in feet.items()},
    ]
    for curves, kind in zip(sets, ("rods of 0.05", "masses at the feet"), strict=True):
        for label, each in curves.items():
            numbers[f"end, {label}"] = each.end.kind, each.points[-1].value
            print(f"  {kind}, {label}: walks to the step angle {ended(each)}")
    panels = new_row(3, 1.11, rows=2)
    for row, curves, title in zip(panels, sets, ("legs are rods of 0.05", "masses at the feet"), strict=True):
        draw_families(row, curves)
        row[1].set(title=title)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(panels[0][0], folder / 'walker_two_legs.png')}")
    walks = {
        "rods, torso at 0": find(rods(0.0, *TORSOS[0.0]), tune=TUNED, at={"angle": ANGLE}),
        "legs of 0.1": find(heavy_feet(0.1, *FEET[0.1]), tune=TUNED, at={"angle": ANGLE}),
    }
    tuned, costs = new_row(2, 0.95)
    draw_tuned(tuned, sets)
    numbers["costs"] = found = draw_costs(costs, walks)
    for label, cost in found.items():
        like = BUILT["Cornell biped"] / cost
        print(f"  {label}: damping costs {cost:.3f} times its ratio; as much as the Cornell biped at {like:.4f}")
    for axes in (tuned, costs):
        legend_below(axes)
    print(f"  figure: {save_figure(tuned, folder / 'walker_two_legs_cost.png')}")
    numbers["walks"], numbers["in SI"] = walks, in_si()
    heavy: Orbit = numbers["in SI"]  # type: ignore[assignment]
    friction, (inertia, stiffness) = heavy.certificate.friction_needed, heavy.tuned.values()
    print(f"  60 kg on legs of 0.9 m: {heavy.mean_speed:.4f} m/s, steps of {heavy.step:.4f} m in {heavy.period:.4f} s,")
    print(f"  friction {friction:.4f}, torso {inertia:.4f} kg m^2, hip springs of {stiffness:.2f} N m/rad")
    path = walks["legs of 0.1"].animate(folder / "walker_two_legs.gif", frames=4 if quick else 84)
    print(f"  animation: {in_few_colours(path)}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="fewer machines and step angles")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
