"""Twelve hoppers, jugglers and chains held by feedback: which launches return, within which limits, at what cost.

Without feedback a hop is lost: launches with less energy than a lossless hop lose more and more, and launches of a
damped machine that is driven open loop drift away. Each machine here has an actuator between two of its masses, a force
or a moving spring's end, with stated limits. Launches are too fast or too slow by 1 and 5 %. All return within the
limits, and the printed multipliers agree with those of the simulated cycle. The left panel shows the error of the worst
launch of each machine, hop after hop, until a launch is lost. The right panel shows the
actuator's positive work per hop over the first twelve hops, as a fraction of the largest value of these launches.
Holding a lossless hop costs nothing once it has returned, while a damped hop always needs some work.
Run: python studies/held_hops.py [--output FOLDER] [--quick]
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from orbits import find, find_all
from orbits.control import Hold, hold
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Actuator, Chain, Hopper, Juggler, hopper_in_si, juggler_in_si
from problems.steering import keep_hopping

ERRORS = (-0.05, -0.01, 0.01, 0.05)
FORCE = Actuator("y1 - y2", kind="force")
MOTOR = {"force": 400.0, "power": 300.0, "speed_force": (4.0, 600.0)}  # N, W, m/s and N


def leg_in_si() -> Hold:
    """A leg of 14 kg with a motor, which is damped."""
    leg = hopper_in_si(12.0, 2.0, stiffness=4000.0, rest_length=0.6, damping=5.0)
    return keep_hopping(leg, actuator=FORCE, intervals=20, **MOTOR).hold(**MOTOR)


def juggler_of_a_ball() -> Hold:
    """A ball of 0.3 kg on a hand, with a motor at the hand."""
    machine = juggler_in_si(0.3, 0.2, stiffness=200.0, damping=0.02)
    limits = {"force": 5.0, "power": 20.0}
    return keep_hopping(machine, actuator=Actuator("w2", kind="force"), intervals=20, **limits).hold(**limits)


def chain(masses: tuple, at: tuple[float, float]) -> tuple:
    """A chain with its lossless hop."""
    machine = Chain(masses)
    return machine, find_all(machine, machine.starts(*at))[0]


def held_by_a_force(machine, along: str, **limits) -> Hold:
    """A lossless hop held by a force."""
    return hold(find(machine), along, **limits)


MACHINES: dict[str, Callable[[], Hold]] = {
    "hopper": lambda: held_by_a_force(Hopper(), "y1 - y2", force=1.0, power=8.0),
    "cubic, at lift-off": lambda: held_by_a_force(Hopper("cubic"), "y1 - y2", force=2.0, when="lift-off"),
    "leg of 14 kg": leg_in_si,
    "juggler": lambda: held_by_a_force(Juggler(), "w2", force=1.0, speed_force=(12.0, 3.0)),
    "chain of three": lambda: hold(chain((1, 1, 1), (3.2, 4.6))[1], "y1 - y3", force=2.0),
    "tanh": lambda: held_by_a_force(Hopper("tanh", mass_ratio=0.5), "y1 - y2", force=0.5),
    "heavy foot": lambda: held_by_a_force(Hopper("r + 0.1*r**3", mass_ratio=5.0), "y1 - y2", force=1.0),
    "late, by 0.5": lambda: held_by_a_force(Hopper("r + 0.1*r**3"), "y1 - y2", force=1.0, delay=0.5),
    "spring's end": lambda: keep_hopping(Hopper(damping=0.01), intervals=20).hold(rate=1.5, stroke=1.5),
    "damped, a force": lambda: keep_hopping(Hopper(damping=0.02), actuator=FORCE, intervals=20).hold(force=1.0),
    "cubic juggler": lambda: held_by_a_force(Juggler("cubic"), "w2", force=2.0),
    "juggler in SI": juggler_of_a_ball,
}
QUICK = ("hopper", "leg of 14 kg", "juggler", "chain of three")


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    left, right = new_row(2, 0.8)
    worst, back, launches = 0.0, 0, 0
    heads = ("back", 7), ("hops", 6), ("|mu|", 10), ("simulated", 11), ("force", 10), ("power", 10), ("work", 10)
    print(f"\n  {'machine':<20}" + "".join(f"{name:>{width}}" for name, width in heads))
    for name in QUICK if quick else MACHINES:
        held = MACHINES[name]()
        found = held.launches(ERRORS, hops=12)
        printed, simulated = (np.abs(each) for each in (held.held_multipliers, held.simulated_multipliers()))
        worst = max(worst, float(np.abs(simulated - printed).max()))
        back, launches = back + int(found.returned.sum()), launches + len(ERRORS)
        row = int(found.returned.sum()), found.hops.max(), printed[0], simulated[0]
        most = found.force.max(), found.power.max(), found.work.max()
        print(f"  {name:<20}{row[0]:>3} of{len(ERRORS):>2}{row[1]:>6.0f}{row[2]:>10.5f}{row[3]:>11.5f}", end="")
        print("".join(f"{each:>10.4g}" for each in most))
        style = "o-" if len(left.lines) < len(COLOURS) else "s--"
        left.semilogy(found.off.max(axis=0).clip(1e-9), style, ms=3, label=name)
        right.plot(100 * found.errors, found.work / found.work.max(), style, ms=3)
    print(f"\n  {back} of {launches} launches come back; multipliers differ by {worst:.1e} at most")
    left.set(xlabel="hop", ylabel="change of the launch", title="worst launch")
    right.set(
        xlabel="launch speed off by (%)", ylabel="work, as a share", title="positive work per hop", ylim=(0, None)
    )
    legend_below(left)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'held_hops.png')}")
    return {"machines": float(len(QUICK if quick else MACHINES)), "share": back / launches, "multipliers": worst}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="four machines")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
