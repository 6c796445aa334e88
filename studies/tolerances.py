"""The paper's air-track juggler with the tolerances of its numbers: does the model agree with the measurement?

Masses, stiffness and slope determine the amplitudes A1 of the ball and A2 of the hand (section 10, eq. 14). Here each
of these varies over its own bounds: the masses by 1 %, the stiffness by 3 %, the height of the track's block by 0.05 of
1.1 inch. Together they reach the bound of 9 % that the authors give for A1. They measured A1/A2 = 1.523 to 3 % and A1 =
0.099 m to 1 %.
Run: python studies/tolerances.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.stats import uniform

from orbits import Uncertainty, uncertainty
from orbits.show import COLOURS, legend_below, new_row, save_figure
from problems import juggler_in_si

SLOPE, EARTH = 1.1 / 60, 9.81  # rise over length of the track; m/s^2
JUGGLER = juggler_in_si(0.2923, 0.2657, stiffness=8.8, surface_gravity=EARTH * np.sin(np.arctan(SLOPE)))
BOUNDS = {"ball_mass": 0.01, "hand_mass": 0.01, "stiffness": 0.03, "surface_gravity": 0.05 / 1.1}  # relative
HAND = "stroke"  # the hand moves with the spring's end
BALL = "ball_rise + stroke - hand_rise"  # from mid-contact, where both stand lowest, to mid-flight
RATIO = f"({BALL})/{HAND}"
MEASURED = {RATIO: (1.523, 0.03), BALL: (0.099, 0.01)}  # with relative bounds
WORDS = {RATIO: "$A_1/A_2$", BALL: "$A_1$ (m)"}


def spread(samples: int) -> Uncertainty:
    """What the bounds do to the amplitudes."""
    own = JUGGLER.values
    over = {name: uniform(own[name] * (1 - bound), 2 * bound * own[name]) for name, bound in BOUNDS.items()}
    return uncertainty(JUGGLER, over, [BALL, HAND, RATIO], samples=samples, progress=False)


def draw(found: Uncertainty, blame: dict):
    """The two quantities with what was measured, and what each bound adds to them."""
    panels = new_row(3, 1.25)
    for axes, (text, (measured, bound)) in zip(panels, MEASURED.items(), strict=False):
        axes.hist(found.sweep[text], bins=40, color=COLOURS[4], label="model")
        axes.axvspan(
            measured * (1 - bound), measured * (1 + bound), color=COLOURS[1], alpha=0.25, lw=0, label="measured"
        )
        axes.axvline(measured, color=COLOURS[1], lw=1.5)
        axes.set(xlabel=WORDS[text], ylabel="jugglers")
        legend_below(axes)
    names = list(BOUNDS)
    for k, text in enumerate(MEASURED):
        values = [blame[text][name]["total"] for name in names]
        panels[2].barh(np.arange(len(names)) + 0.2 - 0.4 * k, values, 0.36, color=COLOURS[2 + k], label=WORDS[text])
    labels = [name.replace("_", " ") for name in names]
    panels[2].set(yticks=range(len(names)), yticklabels=labels, xlabel="Sobol's total index", ylabel="parameter")
    legend_below(panels[2])
    for axes, words in zip(
        panels, ("ratio of the amplitudes", "amplitude of the ball", "what blurs them"), strict=True
    ):
        axes.set_title(words)
    return panels[0]


def main(folder: Path, quick: bool = False) -> dict[str, object]:
    samples = 128 if quick else 1024
    found = spread(samples)
    blame = found.sweep.sensitivity(list(MEASURED), samples=samples, progress=False)
    print(f"  {'':<10}{'model':>10}{'5% to 95%':>22}{'measured':>22}{'off by':>9}")
    for text, (measured, bound) in MEASURED.items():
        low, high = (found.quantiles[text][share] for share in ("5%", "95%"))
        told = f"{measured * (1 - bound):.4g} to {measured * (1 + bound):.4g}"
        off = found.mean[text] / measured - 1
        print(f"  {WORDS[text]:<10}{found.mean[text]:>10.4g}{f'{low:.4g} to {high:.4g}':>22}{told:>22}{off:>9.1%}")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(draw(found, blame), folder / 'tolerances.png')}")
    return {"spread": found, "blame": blame}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="fewer samples")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
