"""A machine of one's own, from nothing: the hopper with an inerter, its hops, their family, its map, its best design.

An inerter resists the acceleration of its ends, as a spring resists their distance: two terminals, a flywheel between
them (Smith 2002). Does one between body and foot make a leg lose less, or hop higher?

Run it in the environment, as `python studies/tutorial.py --output FOLDER`; every step prints what it finds.
"""

from pathlib import Path

import click
import numpy as np

from orbits import Inerter, Mass, Mechanism, ReturnMap, Spring, check, find, follow, multiplier, optimize, simulate


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


@click.command()
@click.option("--output", type=click.Path(path_type=Path), help="Folder for the figures and the animation.")
@click.option("--quick", is_flag=True, help="Without the animation.")
def main(output: Path | None, quick: bool) -> None:
    machine = leg(inertance=0.5)

    print("1. Is the machine consistent? Everything follows from its mechanics, so it should be.")
    print(f"   {check(machine)!r}")

    print("2. One hop that loses nothing, with its certificate.")
    orbit = find(machine)
    print(orbit)

    print("3. What the inerter does to it: the family of hops along the inertance.")
    family = follow(leg(0.0), "inertance", 2.0, at=[0.5, 1.0])
    for point in family.events:
        print(f"   inertance {point.point.value:.2f} kg: launch at {point.point.alpha:.4f} m/s")

    print("4. Beside the hop: where launches go, and how fast small errors die out.")
    hops = ReturnMap(machine)(orbit.alpha * np.array([1.0, 1.02, 1.05]))
    print(f"   from 0, 2 and 5 % above to {(hops.next / orbit.alpha - 1) * 100} % above")
    print(f"   multiplier {multiplier(machine, orbit.alpha * 1.02):.4f} at 2 % above")

    print("5. A thousand hops, simulated impact by impact.")
    run = simulate(machine, orbit.alpha, hops=50 if quick else 1000)
    print(f"   {run.status}, {len(run.events)} events, lost {sum(event.loss for event in run.events):.1e} J")

    print("6. The best design: which stiffness and inertance lose least beside the hop, at a rise of 5 cm?")
    over = {"k": (2000.0, 20000.0), "inertance": (0.0, 2.0)}
    best = optimize(machine, minimise="loss_coefficient", over=over, subject_to=["body_rise == 0.05"])
    print(best)

    if output:
        output.mkdir(parents=True, exist_ok=True)
        family.plot().figure.savefig(output / "family.png")
        best.orbit.plot().figure.savefig(output / "best.png")
        if not quick:
            best.orbit.animate(output / "best.gif")


if __name__ == "__main__":
    main()
