"""A leg of about 60 kg in SI: of 20,000 designs, which hop 0.2 m high without loss, and how sure is the best of them?

Body and foot mass, stiffness k and hardening b of the spring k r + b r^3 are swept together. The candidates are the
designs whose lossless hop of the second family lifts the centre of mass by 0.2 m, to 2 %, within a stroke of 0.25 m.
The most forgiving of them has the smallest loss coefficient C (a launch at the distance d from the lossless one loses C
d^(4/3)). The figure also has the front of C against the peak force on the foot. Then the spring is known to 3 % and the
masses to 2 %: how high does that leg hop, and which of the four causes most of the spread?
Run: python studies/robot_leg.py [--output FOLDER] [--quick] [--workers N] [--store FILE]
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.stats import norm

from orbits import Sweep, Uncertainty, sweep, uncertainty
from orbits.show import COLOURS, colour_bar, legend_below, new_row, save_figure
from problems import hopper_in_si

LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
OVER = {
    "body_mass": (50.0, 70.0),
    "foot_mass": (1.0, 10.0, "log"),
    "k": (300.0, 30_000.0, "log"),
    "b": (1e3, 1e7, "log"),
}
FAMILY, HEIGHT, STROKE = 2, 0.2, 0.25  # m
RISE, FORCE, LOSS = "centre_of_mass_rise", "largest_contact_force", "loss_coefficient"
SPRING, MASSES = 0.03, 0.02  # relative standard deviations


def front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Places (k,) of the points (m,) that no other one undercuts in both, by their x."""
    order = np.lexsort((y, x))
    best = np.minimum.accumulate(y[order])
    return order[np.append(True, best[1:] < best[:-1])]


def uncertain(leg: dict[str, float], samples: int) -> tuple[Uncertainty, dict]:
    """What the tolerances do to one leg, and Sobol's indices of its height."""
    shares = {"k": SPRING, "b": SPRING, "body_mass": MASSES, "foot_mass": MASSES}
    over = {name: norm(leg[name], share * leg[name]) for name, share in shares.items()}
    spread = uncertainty(LEG.with_values(**leg), over, [RISE, FORCE], family=FAMILY, samples=samples, progress=False)
    return spread, spread.sweep.sensitivity([RISE], samples=samples, progress=False)[RISE]


def draw(legs: Sweep, good: np.ndarray, best: int, on_front: np.ndarray, spread: Uncertainty, blame: dict):
    """The four panels of the picture."""
    panels = new_row(2, 0.81, rows=2).ravel()
    rise, ratio = legs[RISE], legs["foot_mass"] / legs["body_mass"]
    drawn = panels[0].scatter(legs["k"], rise, c=np.log10(legs["b"]), s=2, lw=0, rasterized=True)
    panels[0].axhline(HEIGHT, color="0.2", lw=0.8, ls="--")
    panels[0].set(
        xscale="log", xlabel="k (N/m)", ylabel="rise of the centre of mass (m)", ylim=(0, 0.5), title="all designs"
    )
    colour_bar(panels[0], drawn, "lg of b (N/m³)")
    drawn = panels[1].scatter(legs[FORCE][good], legs[LOSS][good], c=ratio[good], s=8, lw=0)
    panels[1].plot(legs[FORCE][on_front], legs[LOSS][on_front], "-", color="0.2", lw=1, label="front")
    panels[1].plot(legs[FORCE][best], legs[LOSS][best], "*", color=COLOURS[1], ms=13, label="most forgiving")
    panels[1].set(xlabel="peak force on the foot (N)", ylabel="loss coefficient C", title="designs that hop 0.2 m")
    colour_bar(panels[1], drawn, "foot mass over body mass")
    legend_below(panels[1])
    heights = spread.sweep[RISE]
    panels[2].hist(heights[np.isfinite(heights)], bins=40, color=COLOURS[4])
    panels[2].axvline(spread.mean[RISE], color="0.2", lw=1)
    panels[2].set(xlabel="rise of the centre of mass (m)", ylabel="legs as built", title="the most forgiving leg")
    names = list(blame)
    for k, which in enumerate(("first", "total")):
        values = np.array([blame[name][which] for name in names])
        ends = np.array([[blame[name][f"{which}_{side}"] for name in names] for side in ("low", "high")])
        panels[3].barh(np.arange(len(names)) + 0.2 - 0.4 * k, values, 0.36, color=COLOURS[k], label=which,
                       xerr=np.clip(np.abs(ends - values), 0, None), error_kw={"lw": 0.8})  # fmt: skip
    panels[3].set(
        yticks=range(len(names)),
        yticklabels=[name.replace("_", " ") for name in names],
        xlabel="Sobol's index of the height",
        ylabel="parameter",
    )
    panels[3].set_title("what the height is blamed on")
    legend_below(panels[3])
    return panels[0]


def main(folder: Path, quick: bool = False, workers: int | None = None, store: Path | None = None) -> dict[str, object]:
    options = {"executor": "processes", "workers": workers} if workers else {}
    legs = sweep(
        LEG, OVER, 1000 if quick else 20_000, seed=1, family=FAMILY, quantities=[RISE, FORCE, LOSS, "stroke"],
        store=store, **options,
    )  # fmt: skip
    print(legs)
    near = np.abs(legs[RISE] / HEIGHT - 1) < (0.1 if quick else 0.02)
    good = np.flatnonzero((legs["status"] == "certified") & near & (legs["stroke"] <= STROKE))
    best = int(good[np.argmin(legs[LOSS][good])])
    on_front = good[front(legs[FORCE][good], legs[LOSS][good])]
    leg = {name: float(legs[name][best]) for name in OVER}
    print(f"\n  {len(good)} designs hop {HEIGHT} m; the most forgiving, member {legs.index[best]}:")
    print("".join(f"    {legs.heading(name)} = {value:.6g}\n" for name, value in leg.items()), end="")
    print(f"    C = {legs[LOSS][best]:.6g}, peak force {legs[FORCE][best]:.6g} N, stroke {legs['stroke'][best]:.4g} m")
    spread, blame = uncertain(leg, 64 if quick else 1024)
    print(spread)
    folder.mkdir(parents=True, exist_ok=True)
    picture = save_figure(draw(legs, good, best, on_front, spread, blame), folder / "robot_leg.png")
    print(f"\n  figure: {picture}")
    return {"legs": legs, "good": good, "best": leg, "spread": spread, "blame": blame}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="1,000 designs")
    parser.add_argument("--workers", type=int, help="processes that compute")
    parser.add_argument("--store", type=Path, help="SQLite file of the sweep, to go on with")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick, arguments.workers, arguments.store)
