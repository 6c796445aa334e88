"""A leg of 60 kg of body and 3 kg of foot: which spring makes it hop 0.2 m high without loss, and most forgivingly?

The spring is k r + b r^3, its stroke at most 0.25 m, and the hop is the rise of the centre of mass. The design
variables are the stiffness k and the hardening b, and the objective is the smallest loss coefficient C: a launch at the
distance d from the lossless one loses C d^(4/3). For each family of orbits the study has a design or the reason why
there is none. It follows the best design as the height changes, which takes less time than a search at each height.
Then it computes, for any C, the peak force that a higher hop costs, as the Pareto front of each family.
Run: python studies/design.py [--output FOLDER] [--quick]
"""

import argparse
import time
from pathlib import Path

import numpy as np

from orbits import Design, DesignCurve, Front, NoOrbit, optimize, pareto, quantities
from orbits.show import legend_below, new_row, save_figure
from problems import hopper_in_si

BODY, FOOT = 60.0, 3.0  # kg
STROKE, HEIGHT = 0.25, 0.2  # m
LEG = hopper_in_si(BODY, FOOT, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
OVER = {"k": (500.0, 50_000.0), "b": (0.0, 1e7)}  # N/m, N/m^3
RISE = "centre_of_mass_rise"


def best(family: int, starts: int) -> Design | str:
    """The most forgiving leg that hops as high as asked, or why there is none."""
    try:
        return optimize(
            LEG,
            minimise="loss_coefficient",
            over=OVER,
            subject_to=[f"stroke <= {STROKE}", f"{RISE} == {HEIGHT}"],
            family=family,
            starts=starts,
        )
    except NoOrbit as reason:
        return str(reason)


def front(family: int, points: int) -> Front:
    """The highest hop against the least peak force on the foot."""
    return pareto(
        LEG,
        minimise=(f"-{RISE}", "largest_contact_force"),
        over=OVER,
        subject_to=[f"stroke <= {STROKE}", f"{RISE} >= 0.05"],
        family=family,
        points=points,
    )


def heights(best: Design, points: int, searches: int) -> tuple[DesignCurve, float]:
    """The curve of designs from this height down to half of it; and how many times longer searches at some of its
    heights take for each design, each from the design before, which find the same ones."""
    limits, began = best.subject_to[:1], time.process_time()
    curve = best.follow(best.subject_to[1], 0.5 * HEIGHT, points=points)
    followed = (time.process_time() - began) / points
    some = [int(i) for i in np.linspace(1, points - 1, searches)]
    began = time.process_time()
    for i in some:
        wanted = [*limits, f"{RISE} == {curve.values[i]!r}"]
        before = curve.designs[i - 1]
        found = optimize(before.source, minimise=best.text, over=OVER, subject_to=wanted, start=before.orbit)
        assert abs(found.objective / curve.designs[i].objective - 1) < 1e-8
    return curve, (time.process_time() - began) / searches / followed


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    designs = {family: best(family, 1 if quick else 3) for family in range(1, 3 if quick else 6)}
    for family, design in designs.items():
        if isinstance(design, str):
            print(f"  family {family}: {design}")
            continue
        k, b = design.parameters["k"], design.parameters["b"]
        held = ", ".join(active.text for active in design.active)
        print(f"  family {family}: k = {k:.6g} N/m, b = {b:.6g} N/m^3: C = {design.objective:.6g}, held by {held}")
    found = [design for design in designs.values() if isinstance(design, Design)]
    winner = min(found, key=lambda design: design.objective)
    print(f"\n{winner}\n")
    curve, ratio = heights(winner, 3 if quick else 50, 1 if quick else 5)
    print(f"{curve}\n  a search at a height takes {ratio:.1f} times as long as a design of the curve\n")
    fronts = {family: front(family, 3 if quick else 9) for family in ((2,) if quick else (1, 2, 3, 4))}
    for family, trade in fronts.items():
        print(f"  family {family}\n{trade}\n")
    print(f"  figure: {_figure(winner, found, fronts, folder)}")
    return {"designs": designs, "winner": winner, "curve": curve, "fronts": fronts}


def _figure(winner: Design, found: list[Design], fronts: dict[int, Front], folder: Path) -> Path:
    left, right = new_row(2, 0.81)
    winner.orbit.plot(left)
    k, b = winner.parameters["k"], winner.parameters["b"]
    left.set_title(f"least C for {HEIGHT} m: k = {k:.0f} N/m, b = {b:.3g} N/m³")
    colours = {}
    for family, trade in fronts.items():
        heights, forces = -trade.values[:, 0], trade.values[:, 1] / 1e3
        (line,) = right.plot(heights, forces, "o-", ms=3.5, lw=1.2, label=f"family {family}")
        colours[family] = line.get_color()
    for design in (design for design in found if design.orbit.family in fronts):
        force = quantities(design.source, design.orbit, ["largest_contact_force"])["largest_contact_force"] / 1e3
        colour = colours[design.orbit.family]
        right.plot(HEIGHT, force, "*", color=colour, ms=11, zorder=3, label=f"least C = {design.objective:.3g}")
    right.set(xlabel="rise of the centre of mass (m)", ylabel="largest contact force (kN)")
    right.set_title(f"fronts with a stroke of at most {STROKE} m")
    legend_below(right)
    folder.mkdir(parents=True, exist_ok=True)
    return save_figure(left, folder / "design.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer families and points")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
