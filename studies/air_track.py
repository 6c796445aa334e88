"""The paper's table-top experiment (section 10) from its SI data: predicted and measured amplitudes side by side.

A juggler lies on an air track that is tipped by 1.1 inch over five feet; gravity along the track is g sin(theta). The
hand catches the ball m1 after one oscillation of the hand m2.
Run: python studies/air_track.py [--output FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import find
from orbits.show import plot_orbit, save_figure, small_type
from problems import juggler_in_si

BALL, HAND = 0.2923, 0.2657  # kg
STIFFNESS = 8.8  # N/m, of the two springs together
SLOPE = np.arctan(1.1 / 60)
# As measured by the authors: the ratio of the amplitudes of ball and hand, and the ball's amplitude in m.
MEASURED_RATIO, MEASURED_AMPLITUDE = 1.523, 0.099


def amplitudes():
    """The lossless orbit, and the amplitudes A1 of the ball and A2 of the hand over a cycle, in m."""
    machine = juggler_in_si(BALL, HAND, stiffness=STIFFNESS, surface_gravity=9.81 * np.sin(SLOPE))
    orbit = find(machine)
    # Both stand lowest in mid-contact; the ball is highest in mid-flight, the hand half an oscillation before or after.
    lowest = orbit(orbit.flight_time + orbit.contact_time / 2)[0]
    ball, hand = (orbit(np.linspace(0, orbit.flight_time, 20001))[:, i].max() for i in (0, 2))
    return orbit, ball - lowest, hand - lowest


def main(folder: Path) -> dict[str, float]:
    orbit, first, second = amplitudes()
    rows = [
        ("A1/A2", first / second, MEASURED_RATIO, ""),
        ("amplitude of the ball", first, MEASURED_AMPLITUDE, " (m)"),
    ]
    print(orbit, "\n")
    print(f"  {'':<28}{'model':>10}{'measured':>10}{'off':>8}")
    for name, model, measured, unit in rows:
        print(f"  {name + unit:<28}{model:>10.4g}{measured:>10.4g}{model / measured - 1:>8.1%}")

    axes = plot_orbit(orbit)
    axes.set_title(
        f"air-track juggler: A₁ = {1e3 * first:.0f} mm, A₂ = {1e3 * second:.0f} mm, A₁/A₂ = {first / second:.3f} "
        f"(measured {MEASURED_RATIO})"
    )
    bottom = orbit(orbit.flight_time + orbit.contact_time / 2)[0]
    for share, high, text in ((0.12, first, "A₁"), (0.42, second, "A₂")):
        x = share * orbit.flight_time
        axes.annotate(
            "",
            (x, bottom + high),
            (x, bottom),
            arrowprops={"arrowstyle": "<->", "color": "0.4", "lw": 0.9, "shrinkA": 0, "shrinkB": 0},
        )
        axes.text(x, 0.8 * bottom, f" {text}", color="0.2", fontsize=small_type(axes))
    axes.axhline(bottom, color="0.8", lw=0.7)
    for amplitude in (first, second):
        axes.axhline(bottom + amplitude, color="0.8", lw=0.7)
    axes.set_ylabel("position along the track (m)")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(axes, folder / 'air_track.png')}")
    return {"ratio": first / second, "amplitude": first}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    main(parser.parse_args().output)
