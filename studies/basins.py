"""Which launches come to a hop that lasts, where an injection makes up for what impacts and dampers take?

The shares of launches that come to each attracting hop follow from the pieces of the return map (`ReturnMap.basins`).
They are compared with launches that are simulated, hop after hop, until they are near one of these hops or rest: at the
middles of equal parts of the range.
Run: python studies/basins.py [--output FOLDER] [--quick] [--launches N]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import ReturnMap, simulate
from orbits.returns import Basins
from orbits.show import save_figure
from problems import Hopper, hopper_in_si, springs

LEG = hopper_in_si(12.0, 2.0, stiffness=8000.0, rest_length=0.8)
TABLE = hopper_in_si(3.0, 1.5, force=springs.table(springs.SAMPLE, in_si=True), rest_length=0.3)
# Machines with their injections and the ranges of their launch speeds.
CASES = {
    "leg of 14 kg, 5 mm/s": (LEG, 0.005, 0.5, 3.0),
    "leg of 14 kg, 20 mm/s": (LEG, 0.02, 0.5, 3.0),
    "leg of 14 kg, 50 mm/s": (LEG, 0.05, 0.5, 3.0),
    "linear": (Hopper(), 0.03, 3.0, 8.0),
    "cubic": (Hopper("r + 0.3*r**3"), 0.02, 2.0, 8.0),
    "measured spring": (TABLE, 0.02, 0.5, 2.0),
    "restitution and damper": (Hopper(restitution=0.3, damping=0.01), 0.2, 2.0, 8.0),
}
# Hops that are simulated together and at most, and how near a launch is to a hop that it comes to.
TOGETHER, MOST, NEAR = 8, 160, 1e-3


def end_of(machine: object, alpha: float, inject: float, known: list[tuple[float, ...]]) -> int:
    """The number of the hop that the launch comes to, or of a chaotic motion, -1 where it rests and -2 where none is
    near after very many hops."""
    for _ in range(MOST // TOGETHER):
        run = simulate(machine, alpha, hops=TOGETHER, inject=inject)
        if run.status != "done":
            return -1
        alpha = float(np.ravel(run.launches[-1])[0])
        for i, speeds in enumerate(known):
            if min(abs(alpha - each) for each in speeds) < NEAR * alpha:
                return i
    return -2


def compared(basins: Basins, machine: object, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The shares of the hops by pieces of the map, and by simulated launches."""
    hops = [each for each in basins.destinations if each.is_hop]
    places = basins.low + (basins.high - basins.low) * (np.arange(count) + 0.5) / count
    ends = np.array(
        [end_of(machine, alpha, basins.inject, [each.launches for each in hops]) for alpha in places.tolist()]
    )
    shares = [basins.share_of(each.launches[0]) for each in hops]
    return np.array(shares), np.array([(ends == i).mean() for i in range(len(hops))])


def main(folder: Path, quick: bool = False, launches: int = 3000) -> dict[str, float]:
    folder.mkdir(parents=True, exist_ok=True)
    off, found = dict[str, float](), dict[str, Basins]()
    for name, (machine, inject, low, high) in list(CASES.items())[-1 if quick else 0 :]:
        basins = found[name] = ReturnMap(machine, inject=inject).basins(low, high)
        shares, counted = compared(basins, machine, 60 if quick else launches)
        off[name] = float(np.abs(shares - counted).max())
        print(f"{name}: {basins}")
        print(
            f"  simulated: {', '.join(f'{each:.3%}' for each in counted)}; the largest difference is {off[name]:.3%}\n",
            flush=True,
        )
    (machine, inject, low, high), path = CASES["restitution and damper"], folder / "basins.png"
    print(f"  figure: {save_figure(ReturnMap(machine, inject=inject).plot_basin(low, high), path)}")
    return off


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="one machine, and few launches")
    parser.add_argument("--launches", type=int, default=3000, help="simulated launches of each machine")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick, arguments.launches)
