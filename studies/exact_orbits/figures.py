"""The cases drawn: python studies/exact_orbits/figures.py [--output FOLDER]

A figure for each subject, with a panel for each case. SciPy integrates the curves from the state after each event to
the next one; the points are the twenty states of the file. The first coordinate that an axis names is blue, the second
orange, the third green.
"""

import argparse
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from scipy.integrate import solve_ivp

from orbits.show import COLOURS, STYLE, new_row, save_figure
from studies.exact_orbits.reader import Case

CASES = Path(__file__).parent / "cases"
POINTS = 400  # of each curve between two events
COLUMNS = 2


def cases_of(subject: str) -> list[Case]:
    """The cases of a subject, by name."""
    cases = [Case(path) for path in sorted(CASES.glob("*.json"))]
    return [case for case in cases if case["subject"] == subject]


def coordinates(case: Case) -> list[str]:
    """The states of a case whose derivative is another state, in some mode."""
    modes = case["modes"].values()
    names = dict.fromkeys(name for mode in modes for name in mode["states"])
    return [name for name in names if any(mode["derivatives"].get(name) in names for mode in modes)]


def curves(case: Case) -> list[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times (n,) and states (n,) by name between one event and the next."""
    start = {"time": case["start"]["time"], "mode": case["start"]["mode"], "after": case.at(case["start"]["state"])}
    arcs, found = [start, *case["events"], {"time": case["samples"][-1]["time"]}], []
    for arc, following in pairwise(arcs):
        mode, begin, end = case["modes"][arc["mode"]], arc["time"], following["time"]
        if end <= begin:
            continue
        names = mode["states"]

        def field(t: float, x: np.ndarray, mode: Any = mode, names: list[str] = names) -> list[float]:
            slopes = case.at(mode["derivatives"], t, dict(zip(names, x.tolist(), strict=True)))
            return [slopes[name] for name in names]

        times = np.linspace(begin, end, POINTS)
        run = solve_ivp(field, (begin, end), [arc["after"][n] for n in names], "DOP853", times, rtol=1e-5, atol=1e-7)
        found.append((run.t, dict(zip(names, run.y, strict=True))))
    return found


def draw_case(case: Case, axes: Any) -> None:
    """Draw a case's coordinates against time."""
    names = coordinates(case)
    for times, states in curves(case):
        for name, colour in zip(names, COLOURS, strict=False):
            if name in states:
                axes.plot(times, states[name], color=colour, lw=1.0)
    for name, colour in zip(names, COLOURS, strict=False):
        places = [(each["time"], each["state"][name]) for each in case["samples"] if name in each["state"]]
        axes.plot(*zip(*places, strict=True), ".", color=colour, ms=3.5)
    unit = {"SI": " (s)"}.get(case["units"], "")
    axes.set(title=case["name"], xlabel=f"time{unit}", ylabel=", ".join(names))


def draw(subject: str) -> Any:
    """A figure of all cases of a subject; returns its first axes."""
    cases = cases_of(subject)
    columns = min(COLUMNS, len(cases))
    panels = np.ravel(new_row(columns, 0.55, -(-len(cases) // columns), STYLE.page * columns / COLUMNS))
    for case, axes in zip(cases, panels, strict=False):
        draw_case(case, axes)
    for axes in panels[len(cases) :]:
        axes.remove()
    return panels[0]


def main(folder: Path) -> None:
    """Write a figure of every subject to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for subject in sorted({Case(path)["subject"] for path in CASES.glob("*.json")}):
        print(save_figure(draw(subject), folder / f"{subject.replace(' ', '_')}.png"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    main(parser.parse_args().output)
