"""A leg of 60 kg of body and 3 kg of foot: which spring makes it hop 0.2 m high without loss, and most forgivingly?

The spring is k r + b r^3, its stroke at most 0.25 m, and the hop the rise of the centre of mass. Designed are stiffness
k and hardening b, for the smallest loss coefficient C: what a launch that is off by d loses is C d^(4/3). For each
family of orbits there is an answer or the reason why there is none. Then, for the family that can do it best: how much
robustness a higher hop costs, and how much peak force.
Run: python studies/design.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

from orbits import Design, Front, NoOrbit, optimize, pareto, quantities
from orbits.plot import new_row, save_figure
from problems import hopper_in_si

BODY, FOOT = 60.0, 3.0  # kg
STROKE, HEIGHT = 0.25, 0.2  # m
LEG = hopper_in_si(BODY, FOOT, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
OVER = {"k": (500.0, 50_000.0), "b": (0.0, 1e7)}  # N/m, N/m^3
RISE = "centre_of_mass_rise"


def best(family: int) -> Design | str:
    """The most forgiving leg that hops as high as asked, or why there is none."""
    try:
        return optimize(
            LEG,
            minimise="loss_coefficient",
            over=OVER,
            subject_to=[f"stroke <= {STROKE}", f"{RISE} == {HEIGHT}"],
            family=family,
            starts=2,
        )
    except NoOrbit as reason:
        return str(reason)


def front(design: Design, points: int, high: float) -> Front:
    """Hop height against the loss coefficient, from the height asked for upward."""
    return pareto(
        design.machine,
        minimise=("loss_coefficient", f"-{RISE}"),
        over=OVER,
        subject_to=[f"stroke <= {STROKE}", f"{HEIGHT} <= {RISE} <= {high}"],
        family=design.orbit.family,
        points=points,
    )


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    families = range(1, 3 if quick else 6)
    designs = {family: best(family) for family in families}
    for family, design in designs.items():
        if isinstance(design, str):
            print(f"  family {family}: {design}")
            continue
        k, b = design.parameters["k"], design.parameters["b"]
        held = ", ".join(active.text for active in design.active)
        print(f"  family {family}: k = {k:.6g} N/m, b = {b:.6g} N/m^3: C = {design.objective:.6g}, held by {held}")
    found = {family: design for family, design in designs.items() if isinstance(design, Design)}
    winner = min(found.values(), key=lambda design: design.objective)
    print(f"\n{winner}\n")
    trade = front(winner, 4 if quick else 13, 0.3)
    print(trade)
    forces = [quantities(d.machine, d.orbit, ["largest_contact_force"])["largest_contact_force"] for d in trade.designs]
    _figure(designs, winner, trade, forces, folder)
    return {"designs": designs, "winner": winner, "front": trade}


def _figure(designs, winner: Design, trade: Front, forces, folder: Path):
    left, right = new_row(2, 5.2, 4.0)
    winner.orbit.plot(left)
    left.set_title("")
    heights = -trade.values[:, 1]
    right.plot(heights, trade.values[:, 0], "o-", ms=3.5)
    right.set(xlabel="rise of the centre of mass (m)", ylabel="loss coefficient C (SI)")
    twin = right.twinx()
    twin.plot(heights, forces, "s--", ms=3, color="0.5")
    twin.set_ylabel("largest contact force (N)")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'design.png')}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer families and points")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
