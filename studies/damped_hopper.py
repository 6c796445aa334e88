"""What it takes to keep a damped hopper on its lossless hop, as the damping c tends to 0: by an actuator at the
spring's end, and by the paper's injection at lift-off (sections 9 and 10).

Any actuation does the work of the dissipation, which is proportional to c. The least effort, the integral of the
squared rate of the spring's end, is proportional to c^2. At M = 1, with a rate that is constant on 40 intervals of a
hop, it is 125.81 c^2 for a lossless landing (124.65 c^2 in the limit of many intervals). It is 111.9 c^2 if the foot
may land with a speed, which is 3.06 c. The energy alone needs less: Schwarz's inequality for the work, the integral of
M phi w, gives the bound in the figure. The rest of the effort brings the foot down. The smallest injection with which
the machine continues to hop does the same work to leading order, all at once, and the hop is then on the verge of being
lost. The left panel shows the motion for c = 0.01.
Run: python studies/damped_hopper.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import ReturnMap, find
from orbits.hops import Impacts
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper
from problems.steering import keep_hopping, missed, work

SHOWN = 0.01


def injection(damping: float, lossless: float) -> tuple[float, float]:
    """The least injection of launch speed with which a damped hopper hops on, and the work it does."""
    machine, low, high = Hopper(damping=damping), lossless - 1.5, lossless + 1.5
    step, rules = ReturnMap(machine), Impacts(machine)
    for _ in range(5):
        alpha = np.linspace(low, high, 61)
        lost = alpha - step(alpha).next
        i = int(np.nanargmin(lost))
        low, high = alpha[max(i - 1, 0)], alpha[min(i + 1, 60)]
    before, after = rules.launch(np.array([alpha[i] - lost[i], alpha[i]]))
    return float(lost[i]), rules.energy(after) - rules.energy(before)


def bound(orbit) -> tuple[float, float]:
    """What dissipation and effort are as c goes to 0: the former over c, and the latter's bound by energy over c^2."""
    places, weights = np.polynomial.legendre.leggauss(200)
    lost = pull = 0.0
    for start, length in ((0.0, orbit.flight_time), (orbit.flight_time, orbit.contact_time)):
        y1, v1, y2, v2 = orbit(start + length * (0.5 + 0.5 * places)).T
        share = weights * length / 2
        lost += float(share @ (v1 - v2) ** 2)
        pull += float(share @ (y1 - y2) ** 2)
    return lost, lost**2 / pull


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    orbit = find(Hopper())
    dampings = np.geomspace(1e-4, 0.1, 4 if quick else 13)
    lost, floor = bound(orbit)
    efforts, works, worst, speeds = {}, {}, 0.0, []
    for lossless in (True, False):
        found = [keep_hopping(Hopper(damping=c), start=orbit, lossless=lossless) for c in dampings]
        efforts[lossless] = np.array([one.cost for one in found])
        works[lossless] = np.array([work(Hopper(damping=c), one)[0] for c, one in zip(dampings, found, strict=True)])
        worst = max([worst] + [missed(Hopper(damping=c), one) for c, one in zip(dampings, found, strict=True)])
        speeds = [float(-one.legs[0].path(one.legs[0].duration)[3]) for one in found]
    injected = np.array([injection(c, orbit.alpha) for c in dampings])
    exponent = float(np.log(efforts[True][1] / efforts[True][0]) / np.log(dampings[1] / dampings[0]))
    numbers = {
        "exponent": exponent,
        "effort over c^2": float(efforts[True][0] / dampings[0] ** 2),
        "plastic effort over c^2": float(efforts[False][0] / dampings[0] ** 2),
        "landing speed over c": speeds[0] / dampings[0],
        "bound over c^2": floor,
        "dissipation over c": lost,
        "work over c": float(works[True][0] / dampings[0]),
        "injected work over c": float(injected[0, 1] / dampings[0]),
        "missed": worst,
    }
    print(f"\n  {'c':>10}{'effort/c^2':>14}{'plastic':>12}{'work/c':>12}{'injected/c':>12}{'eps/c':>10}")
    for i, c in enumerate(dampings):
        row = efforts[True][i] / c**2, efforts[False][i] / c**2, works[True][i] / c, injected[i, 1] / c
        print(f"  {c:>10.3g}{row[0]:>14.6f}{row[1]:>12.4f}{row[2]:>12.4f}{row[3]:>12.4f}{injected[i, 0] / c:>10.4f}")
    print(f"\n  the effort goes with c to the power {exponent:.6f}; by energy alone it would be {floor:.4f} c^2")
    print(f"  the dissipation of the lossless hop is {lost:.6f} c; open loop the answers are missed by {worst:.1e}")
    left, middle, right = new_row(3, 1.5)
    keep_hopping(Hopper(damping=SHOWN), start=orbit).plot(left)
    for lossless, name, colour in ((True, "lossless landing", COLOURS[0]), (False, "any landing", COLOURS[1])):
        middle.semilogx(dampings, efforts[lossless] / dampings**2, "o-", color=colour, ms=4, label=name)
        right.semilogx(dampings, works[lossless] / dampings, "o-", color=colour, ms=4, label=name)
    middle.axhline(floor, color="0.4", ls="--", lw=1, label="bound by energy, c to 0")
    middle.set(xlabel="damping c", ylabel="effort / c²", ylim=(90, 132), title="least effort")
    right.semilogx(dampings, injected[:, 1] / dampings, "s-", color=COLOURS[2], ms=4, label="injection at lift-off")
    right.axhline(lost, color="0.4", ls="--", lw=1, label="dissipation of the lossless hop")
    right.set(xlabel="damping c", ylabel="work / c", title="work a hop")
    for axes in (middle, right):
        legend_below(axes)
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'damped_hopper.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer dampings")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
