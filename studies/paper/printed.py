"""The numbers of the section "What it has found" of `paper.md`, computed again and compared with the text.

Run: python studies/paper/printed.py
"""

import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script too it finds the other studies

from orbits import bifurcations, find, follow
from problems import Hopper, rimless_wheel, runner
from problems.steering import keep_hopping
from studies import period_four

TEXT = Path(__file__).with_name("paper.md")


def numbers() -> Iterator[tuple[str, float]]:
    """Phrases of the text, each with one # for its number, and the value of that number."""
    hop = find(Hopper())
    yield r"lossless launch speed is $\alpha = #$", hop.alpha
    yield "$C = #$", hop.certificate.loss_coefficient
    family = follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0)
    values = {event.kind: event.point.value for event in family.events}
    yield r"down to a fold at $\beta = #$", values["fold"]
    yield r"cease to be admissible at $\beta = #$", values["collapse"]
    launches = {"sections": 3, "doublings": 2}
    diagram = bifurcations(Hopper(), "inject", period_four.INJECT, period_four.LAUNCHES, **launches)
    folds = [event for event in diagram.events if event.kind == "fold" and len(event.alphas) == 4]
    yield "begin in a fold at an injection of #", folds[0].value
    yield "end in a crisis at #.", period_four.crisis()
    damping, intervals = 1e-3, (80, 160)
    held = [keep_hopping(Hopper(damping=damping), start=hop, intervals=each).cost / damping**2 for each in intervals]
    # A rate that is constant on intervals costs more, by the square of their length.
    yield r"grows like $#\,c^2$ for small", (4 * held[1] - held[0]) / 3
    wheel = rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0)
    yield "one of # spokes needs", math.pi / wheel.values["angle"]
    yield "needs friction of #.", find(wheel).certificate.friction_needed
    run = find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    yield "one runs at a dimensionless speed of #, with", run.speed
    yield "with steps of # and", run.step
    yield "friction of #, if", run.certificate.friction_needed


def differences() -> list[str]:
    """What is printed otherwise than it is computed, to the digits that are printed."""
    text, found = " ".join(TEXT.read_text(encoding="utf-8").split()), []
    for phrase, value in numbers():
        before, after = map(re.escape, phrase.split("#"))
        printed = re.search(rf"{before}(-?\d+\.?\d*){after}", text)
        if printed is None:
            found.append(f"the text has no {phrase!r}")
            continue
        shown = f"{value:.{len(printed[1].partition('.')[2])}f}"
        print(f"  {phrase:<60}{printed[1]:>14}{shown:>14}")
        if shown != printed[1]:
            found.append(f"{phrase!r} is {shown}, and printed as {printed[1]}")
    return found


if __name__ == "__main__":
    if wrong := differences():
        sys.exit("\n".join(wrong))
