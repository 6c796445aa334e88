"""The figures and tables of a run of simulators: python studies/exact_orbits/simulators_figure.py [--output FOLDER]"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from orbits.result import Axes
from orbits.show import COLOURS, legend_below, new_row, save_figure

RECORD = Path(__file__).with_name("simulated.json")
# Ways by simulator, each with its line and its colour.
LOOKS = {
    "SciPy": {"DOP853": ("o-", COLOURS[0]), "Radau": ("o--", COLOURS[0])},
    "heyoka": {"Taylor": ("D-", COLOURS[2])},
    "MuJoCo": {
        "RK4": ("s-", COLOURS[1]), "RK4, ratio 30": ("s--", COLOURS[1]),
        "implicitfast, ratio 30": ("v-", COLOURS[5]), "discrete": ("v--", COLOURS[5]),
    },
    "Drake": {
        "SAP": ("^-", COLOURS[3]), "lagged": ("^--", COLOURS[3]), "CENIC": ("^:", COLOURS[3]),
        "RK3": ("x-", COLOURS[4]), "RK3, default dissipation": ("x--", COLOURS[4]),
    },
    "here": {"simulate": ("*", "k")},
}  # fmt: skip
STEPPED = {("MuJoCo", way) for way in LOOKS["MuJoCo"]} | {("Drake", "SAP"), ("Drake", "lagged")}
SHOWN = ("linear_hop", "heavy_hand_bounces", "bouncing_ball", "impact_graze")
ORDERS = (1e-11, 0.1)  # errors between which an order is measured
Rows = Sequence[Mapping[str, Any]]


def rows_of(results: Mapping[str, Any], **wanted: str) -> list[dict[str, Any]]:
    """The successful measurements with some values."""
    rows = (row for row in results["rows"] if np.isfinite(row.get("error", np.nan)))
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def draw(results: Mapping[str, Any], by: str, cases: Sequence[str], titles: Mapping[str, str]) -> Axes:
    """The errors in four cases against the settings of steps (`by` "setting") or against the times ("seconds")."""
    stepped, panels = by == "setting", new_row(2, 0.8, rows=2).ravel()
    for i, (axes, case) in enumerate(zip(panels, cases, strict=True)):
        for simulator, ways in LOOKS.items():
            for way, (line, colour) in ways.items():
                rows = rows_of(results, case=case, simulator=simulator, way=way)
                if not rows or (stepped and (simulator, way) not in STEPPED):
                    continue
                x, y = np.array([(row[by], max(row["error"], 1e-16)) for row in rows]).T
                name = "this toolkit" if simulator == "here" else f"{simulator}, {way}"
                # The legend is below both columns.
                label = name if i == int(simulator in ("Drake", "here")) else None
                face = colour if line[1:] in ("", "-") else "white"
                axes.loglog(x / (20 if stepped else 1), y, line, color=colour, mfc=face, ms=4, label=label)
        if stepped:
            x = np.array([2e-5, 1e-3])
            for order, at in ((1, 0.3), (2, 1e-2)):
                label = f"order {order}" if i == 1 else None
                axes.loglog(x, at * (x / x[1]) ** order, ":" if order == 1 else "-.", color="0.5", lw=1, label=label)
        limits = {"xlim": (1e-6, 3e-3), "ylim": (1e-11, 10)} if stepped else {"xlim": (1e-3, 5), "ylim": (1e-16, 10)}
        label = "step over duration" if stepped else "processor time (s)"
        axes.set(title=titles[case], xlabel=label, ylabel="error", **limits)
    for below, of in ((panels[2], panels[0]), (panels[3], panels[1])):
        legend_below(below, of=of)
    return panels[0]


def best(rows: Rows) -> Mapping[str, Any] | None:
    """The measurement with the least error."""
    return min(rows, key=lambda row: row["error"], default=None)


def order(rows: Rows) -> float | None:
    """The power of the step with which the error falls, by least squares; None for fewer than three steps."""
    low, high = ORDERS
    points = np.log([(row["setting"], row["error"]) for row in rows if low < row["error"] < high])
    return float(np.polyfit(*points.T, 1)[0]) if len(points) > 2 else None


def case_table(results: Mapping[str, Any]) -> list[str]:
    """The least error of each simulator in each case, with its processor time, or why there is none."""
    lines = ["| case | SciPy | heyoka | MuJoCo | Drake | this toolkit |", "|---|---|---|---|---|---|"]
    for case in dict.fromkeys(row["case"] for row in results["rows"]):
        cells = list[str]()
        for simulator in LOOKS:
            found = best(rows_of(results, case=case, simulator=simulator))
            own = [row for row in results["rows"] if (row["case"], row["simulator"]) == (case, simulator)]
            reason = next((row["cannot"] for row in own if "cannot" in row), "no result")
            cells.append(f"{found['error']:.0e}, {found['seconds']:.1g} s" if found else reason)
        lines.append(f"| `{case}` | {' | '.join(cells)} |")
    return lines


def reach_table(results: Mapping[str, Any]) -> list[str]:
    """How many cases each way can state, how many it brings to two errors, and the median order of its steps."""
    lines = ["| simulator | way | cases | to 1e-3 | to 1e-6 | order |", "|---|---|---|---|---|---|"]
    for simulator, ways in LOOKS.items():
        for way in ways:
            rows = rows_of(results, simulator=simulator, way=way)
            cases = list(dict.fromkeys(row["case"] for row in rows))
            if not cases:
                continue
            by_case = [[row for row in rows if row["case"] == case] for case in cases]
            counts = [sum(min(row["error"] for row in own) <= bound for own in by_case) for bound in (1e-3, 1e-6)]
            orders = [found for own in by_case if (found := order(own)) is not None]
            text = f"{np.median(orders):.1f}" if (simulator, way) in STEPPED and orders else ""
            name = "this toolkit" if simulator == "here" else simulator
            lines.append(f"| {name} | {way} | {len(cases)} | {counts[0]} | {counts[1]} | {text} |")
    return lines


def titles_of(cases: Sequence[str]) -> dict[str, str]:
    """The titles of cases."""
    folder = Path(__file__).parent / "cases"
    return {case: json.loads((folder / f"{case}.json").read_text(encoding="utf-8"))["title"] for case in cases}


def main(record: Path, output: Path) -> None:
    """Draw both figures and print the tables."""
    results = json.loads(record.read_text(encoding="utf-8"))
    known = {row["case"] for row in results["rows"]}
    cases = [case for case in (*SHOWN, *sorted(known)) if case in known][:4]
    output.mkdir(parents=True, exist_ok=True)
    for by, name in (("setting", "contact_models_steps.png"), ("seconds", "contact_models.png")):
        print(f"  figure: {save_figure(draw(results, by, cases, titles_of(cases)), output / name)}")
    print("\n".join([*reach_table(results), "", *case_table(results)]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--record", type=Path, default=RECORD, help="JSON file of a run")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures")
    arguments = parser.parse_args()
    main(arguments.record, arguments.output)
