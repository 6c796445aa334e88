"""Runs over level ground that cost nothing: for which designs, how fast, and on how little friction.

A body on a sprung leg with a hip spring and a massive foot hops in place for any inertia and hip stiffness. At
single points in the plane of these two, runs branch off the hop, and along a curve from there they go faster. The units
are those of the body's mass, the leg's stiffness and gravity, so that lengths are in m g/k and speeds in g sqrt(m/k).
Run: python studies/runner.py [--output FOLDER] [--quick]
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import (
    BranchPoint,
    Family,
    NoOrbit,
    Orbit,
    find,
    find_branch_points,
    follow,
    follow_branch_points,
    multipliers,
    orbit_at,
)
from orbits.show import COLOURS, legend_below, new_row, save_figure
from orbits.units import STANDARD_GRAVITY
from problems import runner
from studies.walker import in_few_colours

TUNED = ("inertia", "hip_stiffness")
REGION = {"inertia": (0.5, 20.0), "hip_stiffness": (0.5, 20.0)}
FOOT_MASSES = (0.05, 0.1, 0.15)
REST_LENGTHS = (3.7, 4.3, 5.2)
SPEED, FIRST, FASTEST = 0.4, 0.05, 2.0
# Of a runner in SI: 60 kg on a leg of 1 m, a foot of 6 kg, and the leg's stiffness that makes it the one of the paper's
# units with the rest length 3.7.
BODY, LEG, EARTH = 60.0, 1.0, STANDARD_GRAVITY


def feet(quick: bool) -> tuple[float, ...]:
    """The masses of the foot, in the quick mode the middle one."""
    return FOOT_MASSES[1:2] if quick else FOOT_MASSES


def branch_points(foot_mass: float, rest_lengths: np.ndarray, designs: int) -> list[list[tuple[float, float]]]:
    """Curves of inertias and hip stiffnesses at which runs begin, as the leg gets longer and shorter, from all branch
    points of the middle rest length."""
    middle, curves = len(rest_lengths) // 2, list[list[tuple[float, float]]]()
    for point in find_branch_points(runner(foot_mass, rest_lengths[middle]), REGION, designs=designs):
        longer = follow_branch_points(point, "rest_length", rest_lengths[middle + 1 :])
        shorter = follow_branch_points(point, "rest_length", rest_lengths[:middle][::-1])
        along = (*reversed(shorter), point, *longer)
        curves.append([(each.values["inertia"], each.values["hip_stiffness"]) for each in along])
    return curves


def first_branch(rest_length: float, foot_mass: float) -> BranchPoint:
    """The branch point of an inertia between 2 and 12."""
    return find_branch_points(runner(foot_mass, rest_length), REGION | {"inertia": (2.0, 12.0)}, designs=20)[0]


def family(rest_length: float, fastest: float, foot_mass: float = 0.1) -> Family:
    """The runs that branch off there, by their speed, as far as they are motions."""
    point = first_branch(rest_length, foot_mass)
    return follow(point.machine, "speed", fastest, point.start(FIRST), tune=TUNED, stop_inadmissible=True)


def at_speed(speed: float, foot_mass: float, rest_lengths: Sequence[float]) -> list[Orbit]:
    """Runs at one speed for rising rest lengths, each from the one before, as far as they are motions."""
    point, runs = first_branch(rest_lengths[0], foot_mass), list[Orbit]()
    near = find(point.machine, start=point.start(FIRST), tune=TUNED, at={"speed": FIRST})
    for length in rest_lengths:
        machine = near.source.with_values(rest_length=length)
        try:
            near = run = find(machine, tune=TUNED, at={"speed": speed}, start=near)
        except NoOrbit:
            break
        if not run.admissible:
            break
        runs.append(run)
    return runs


def in_si() -> Orbit:
    """The run of a body of 60 kg at the speed 0.4."""
    stiffness = 3.7 * BODY * EARTH / LEG
    length = BODY * EARTH / stiffness
    machine = runner(
        0.1 * BODY, LEG, 5.7 * BODY * length**2, 5.4 * BODY * EARTH * length,
        body_mass=BODY, stiffness=stiffness, in_si=True,
    )  # fmt: skip
    return find(machine, tune=TUNED, at={"speed": SPEED * np.sqrt(EARTH * length)})


def draw_map(axes, families: Sequence[Family], quick: bool) -> dict[str, object]:
    """Draw where runs begin, and the curves along which they go faster."""
    lengths, numbers = np.linspace(3.4, 5.4, 3 if quick else 21), dict[str, object]()
    for foot_mass, colour in zip(feet(quick), COLOURS, strict=False):
        curves = numbers[f"branch points {foot_mass:g}"] = branch_points(foot_mass, lengths, 16 if quick else 40)
        for k, curve in enumerate(curves):
            axes.plot(*zip(*curve, strict=True), ".-", ms=3, lw=0.8, color=colour,
                      label=None if k else f"begin, foot {foot_mass:g}")  # fmt: skip
    for each in families:
        axes.plot(each.column("inertia"), each.column("hip_stiffness"), color="0.2", lw=1.3,
                  label="faster runs, foot 0.1" if each is families[0] else None)  # fmt: skip
    axes.set(xlabel="inertia", ylabel="hip stiffness", xscale="log", yscale="log", title="where runs begin")
    for name in ("x", "y"):
        getattr(axes, f"set_{name}ticks")([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
        getattr(axes, f"set_{name}ticks")([], minor=True)
    return numbers


def draw_multipliers(axes, runs: Family, count: int) -> np.ndarray:
    """Draw the multipliers (count, d) along a family."""
    points = [runs.points[i] for i in np.linspace(0, len(runs.points) - 1, count).astype(int)]
    each = [orbit_at(runs.source, point, "speed") for point in points]
    found = np.array([multipliers(run.source, run).values for run in each])
    for k, values in enumerate(np.abs(found).T):
        label = "modulus, leg 3.7" if k == 0 else None
        axes.plot([run.speed for run in each], values, ".-", ms=4, lw=0.8, color=COLOURS[0], label=label)
    axes.axhline(1.0, color="0.6", lw=0.8)
    axes.set(xlabel="speed in flight", ylabel="multipliers", yscale="log", title="what a step does to a change")
    return found


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    panels = new_row(3, 1.11, rows=2)
    where, along, high, grip, least, beside = np.ravel(panels)
    lengths = REST_LENGTHS[:1] if quick else REST_LENGTHS
    families = [family(length, 0.5 if quick else FASTEST) for length in lengths]
    numbers = draw_map(where, families, quick)
    for length, runs, colour in zip(lengths, families, COLOURS, strict=False):
        speed, friction = runs.column("speed"), runs.column("friction_needed")
        along.plot(speed, runs.column("step"), color=colour, lw=1.5, label=f"step, leg {length:g}")
        along.plot(speed, runs.column("mean_speed"), "--", color=colour, lw=1.2, label=f"mean speed, leg {length:g}")
        high.plot(speed, runs.column("foot_rise"), color=colour, lw=1.5, label=f"foot, leg {length:g}")
        high.plot(speed, runs.column("body_rise"), "--", color=colour, lw=1.2, label=f"body, leg {length:g}")
        grip.plot(speed, friction, color=colour, lw=1.5, label=f"leg {length:g}, foot 0.1")
        numbers[f"end {length:g}"] = runs.end.kind, float(speed[-1])
        print(f"  leg {length:g}: runs up to the speed {speed[-1]:.4g}, friction {friction[-1]:.4g}: {runs.end.reason}")
    numbers["multipliers"] = draw_multipliers(beside, families[0], 4 if quick else 20)
    along.set(xlabel="speed in flight", ylabel="step; mean speed", ylim=(0, None), title="along the families")
    high.set(xlabel="speed in flight", ylabel="rise in flight", ylim=(0, None), title="foot and body")
    grip.set(xlabel="speed in flight", ylabel="friction needed", ylim=(0, None), title="tangential over normal force")
    for foot_mass, colour in zip(feet(quick), COLOURS, strict=False):
        runs = at_speed(SPEED, foot_mass, np.linspace(3.7 if foot_mass < 0.15 else 3.9, 5.0, 3 if quick else 14))
        frictions = [run.certificate.friction_needed for run in runs]
        numbers[f"friction {foot_mass:g}"] = dict(zip([run.source.values["rest_length"] for run in runs], frictions,
                                                      strict=True))  # fmt: skip
        least.plot([*numbers[f"friction {foot_mass:g}"]], frictions, "o-", ms=3, lw=0.8, color=colour,
                   label=f"foot {foot_mass:g}")  # fmt: skip
        few = min(frictions, default=np.nan)
        print(f"  foot {foot_mass:g}, speed {SPEED:g}: the least friction of {len(runs)} legs is {few:.4f}")
    least.set(xlabel="rest length of the leg", ylabel="friction needed", title=f"at the speed {SPEED:g}")
    for axes in np.ravel(panels):
        legend_below(axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"  figure: {save_figure(where, folder / 'runner.png')}\n")
    heavy = numbers["in SI"] = in_si()
    tuned = heavy.source.values
    print(f"  60 kg on a leg of 1 m: {heavy.speed:.4f} m/s in flight, {heavy.mean_speed:.4f} m/s on the whole;")
    print(f"  step {heavy.step:.4f} m, inertia {tuned['inertia']:.4f} kg m^2, hip {tuned['hip_stiffness']:.2f} N m")
    run = numbers["run"] = find(runner(), tune=TUNED, at={"speed": SPEED})
    print(f"  animation: {in_few_colours(run.animate(folder / 'runner.gif', frames=4 if quick else 84))}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="fewer machines and speeds")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
