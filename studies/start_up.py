"""From rest onto a lossless hop by pumping the spring's end in contact, and back onto it from a launch that is short.

The left panel shows a start in two pumps and the free hops that follow. The middle panel shows the least effort against
the number of pumps, for actuators of different strokes. More pumps hardly help, because the foot must not leave the
ground early, which bounds every swing but the last. The right panel shows the least effort to bring back, in one hop, a
launch speed d below the lossless one. It is proportional to d^2, while such a launch without control loses 10 C
d^(4/3). A launch that is too fast by a small d takes a few hundredths of this effort if it may land freely, because the
impact does the rest.
Run: python studies/start_up.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import NoOrbit, find
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import Hopper
from problems.steering import missed, recover, rerun, start_up

MACHINE = Hopper()
RATE = 6.0
STROKES = (2.0, 3.0, np.inf)
SHOWN = {"pumps": 2, "stroke": 2.0, "rate": RATE}


def efforts(strokes, pumps, orbit) -> tuple[dict[float, np.ndarray], float]:
    """The least effort (pumps,) for each stroke, NaN where it cannot be done, and the most by which one is missed."""
    found, worst = {}, 0.0
    for stroke in strokes:
        row = []
        for count in pumps:
            try:
                answer = start_up(MACHINE, count, start=orbit, rate=RATE, stroke=stroke)
            except NoOrbit as reason:
                print(f"  stroke {stroke:g}, {count} pumps: {reason}")
                row.append(np.nan)
                continue
            row.append(answer.cost)
            worst = max(worst, missed(MACHINE, answer))
        found[stroke] = np.array(row)
    return found, worst


def draw(axes, orbit, hops: int = 2):
    """A start and the hops after it."""
    answer = start_up(MACHINE, start=orbit, **SHOWN)
    run = rerun(MACHINE, answer, hops=hops)
    run.plot(axes)
    t = np.linspace(0, run.end, 4001)
    axes.plot(t, run(t)[:, -1], color=COLOURS[3], lw=1.8, label="spring's end")
    axes.axvline(answer.end, color="0.4", lw=0.8, ls="--")
    axes.set_title(f"from rest in {SHOWN['pumps']} pumps, stroke {SHOWN['stroke']:g}")
    legend_below(axes)
    return run


def main(folder: Path, quick: bool = False) -> dict[str, float]:
    orbit = find(MACHINE)
    left, middle, right = new_row(3, 1.5)
    run = draw(left, orbit)
    pumps = np.arange(1, 3 if quick else 7)
    strokes = STROKES[1:2] if quick else STROKES
    print()
    found, worst = efforts(strokes, pumps, orbit)
    for (stroke, row), colour in zip(found.items(), COLOURS, strict=False):
        label = f"stroke {stroke:g}" if np.isfinite(stroke) else "any stroke"
        middle.plot(pumps, row, "o-", color=colour, ms=5, label=label)
        print(f"  {label}: " + ", ".join(f"{value:.5g}" for value in row))
    middle.set(
        xlabel="pumps", ylabel="least effort", ylim=(0, None), xticks=pumps, title=f"start-up, rate at most {RATE:g}"
    )
    legend_below(middle)
    short = np.geomspace(1e-3, *((1e-2, 2) if quick else (1.0, 13)))
    numbers = {"start": float(found[strokes[0]][1]), "launches": float(np.abs(run.launches - orbit.alpha).max())}
    for lossless, name, colour in ((True, "lossless landing", COLOURS[0]), (False, "any landing", COLOURS[1])):
        answers = [recover(MACHINE, d, start=orbit, lossless=lossless) for d in short]
        row = np.array([answer.cost for answer in answers])
        worst = max([worst] + [missed(MACHINE, answer) for answer in answers])
        kind = "recovery" if lossless else "any recovery"
        numbers[f"{kind} over d^2"] = float(row[0] / short[0] ** 2)
        numbers[f"{kind} exponent"] = float(np.log(row[1] / row[0]) / np.log(short[1] / short[0]))
        print(f"  {name}: effort {numbers[f'{kind} over d^2']:.5f} d^2, exponent {numbers[f'{kind} exponent']:.5f}")
        right.semilogx(short, row / short**2, "o-", color=colour, ms=4, label=name)
    fast = [recover(MACHINE, -d, start=orbit, lossless=False) for d in short]
    row = np.array([answer.cost for answer in fast])
    worst = max([worst] + [missed(MACHINE, answer) for answer in fast])
    right.semilogx(short, row / short**2, "o--", color=COLOURS[1], ms=4, label="any landing, too fast by d")
    share = (row / [answer.cost for answer in answers])[short < 0.11].max()
    numbers["too fast over any recovery"] = float(share)
    print(f"  too fast by d up to 0.1, any landing: at most {share:.4f} of what short by d takes")
    right.set(xlabel="launch speed short by d", ylabel="least effort / d²", ylim=(0, None), title="recovery in one hop")
    legend_below(right)
    numbers["missed"] = worst
    print(f"  open loop the answers are missed by {worst:.1e}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(left, folder / 'start_up.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer pumps and launches")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
