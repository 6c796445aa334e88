"""A machine of one's own, from nothing: the hopper with an inerter, its hops, their family, its map, its best design.

An inerter resists the relative acceleration of its ends, as a spring resists their displacement: it is a flywheel
between two terminals (Smith 2002). Does an inerter between body and foot make a leg lose less, or hop higher?

Every step prints its result; the figures and an animation of the best leg are drawn at the end.
Run: python studies/tutorial.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import Mechanism, ReturnMap, check, find, follow, multiplier, optimize, simulate
from orbits.mechanics import Inerter, Mass, Spring
from orbits.show import save_figure


def leg(inertance: float) -> Mechanism:
    """A 60 kg body and a 3 kg foot, joined by a hardening spring and an inerter, in SI."""
    return Mechanism(
        name="inerter hopper",
        coordinates=("body", "foot"),  # their heights above where the leg stands unloaded
        elements=[
            Mass("body", "body_mass"),
            Mass("foot", "foot_mass"),
            Spring("body - foot", "k*r + c*r**3"),  # tension of the extension r
            Inerter("body - foot", "inertance"),
        ],
        gap="foot",  # what opens in flight, and lands plastically
        gravity=9.81,
        parameters={"body_mass": 60.0, "foot_mass": 3.0, "k": 8000.0, "c": 2e6, "inertance": inertance},
        in_si=True,
    )


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    machine = leg(inertance=0.5)

    print("1. Is the machine consistent? All of it follows from its mechanics, so it should be.")
    print(f"   {check(machine)!r}")

    print("2. One hop that loses nothing, with its certificate.")
    orbit = find(machine)
    print(orbit)

    print("3. What the inerter does to it: the family of hops along the inertance.")
    family = follow(leg(0.0), "inertance", 2.0, at=[0.5, 1.0])
    for event in family.events:
        print(f"   inertance {event.point.value:.2f} kg: launch at {event.point.alpha:.4f} m/s")

    print("4. Beside the hop: where launches go, and how fast small errors die out.")
    hops = ReturnMap(machine)(orbit.alpha * np.array([1.0, 1.02, 1.05]))
    print(f"   from 0, 2 and 5 % above it to {np.round((hops.next / orbit.alpha - 1) * 100, 3)} % above it")
    slope = multiplier(machine, orbit.alpha * 1.02)
    print(f"   slope of the map at 2 % above it: {slope:.4f}")

    print("5. Many hops, simulated impact by impact.")
    run = simulate(machine, orbit.alpha, hops=50 if quick else 1000)
    lost = sum(event.loss for event in run.events)
    print(f"   {run.status} after {len(run.events)} events, {lost:.1e} J lost")

    print("6. The best design: which stiffness and inertance press least on the ground, for a rise of 5 cm?")
    over = {"k": (2000.0, 20000.0), "inertance": (0.0, 2.0)}
    best = optimize(machine, minimise="largest_contact_force", over=over, subject_to=["body_rise == 0.05"])
    print(best)

    folder.mkdir(parents=True, exist_ok=True)
    save_figure(family.plot(), folder / "tutorial_family.png")
    save_figure(best.orbit.plot(), folder / "tutorial_best.png")
    if not quick:
        best.orbit.animate(folder / "tutorial.gif")
    return {
        "alpha": orbit.alpha,
        "flight time": orbit.flight_time,
        "slope": slope,
        "lost": lost,
        "least force": best.objective,
        "inertance": best.parameters["inertance"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="fewer hops, and no animation")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
