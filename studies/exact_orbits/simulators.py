"""Run simulators through the cases: python studies/exact_orbits/simulators.py [NAME ...] [--output FILE] [--quick]

Each simulator integrates each case that it can state, with its settings swept. The error is the largest difference from
the case at its samples, each state over the largest size that it has in the motion; samples nearer to a jump of the
state than a hundredth of the duration are left out. The times are processor times of the integration alone, without the
compilation of models. The file has all measurements, those of other cases that it had included, and
`simulators_figure.py` draws it.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))

from studies.exact_orbits.automaton import Found
from studies.exact_orbits.reader import Case

FOLDER = Path(__file__).parent
SIMULATORS = {
    "SciPy": "by_scipy",
    "heyoka": "by_heyoka",
    "MuJoCo": "by_mujoco",
    "Drake": "by_drake",
    "here": "by_orbits",
}
QUICK = ("linear_hop", "bouncing_ball")


class Limits(NamedTuple):
    """How long a measurement may take.

    seconds : a setting that would take longer is left out
    growth : how much longer the next setting takes
    short : runs of less than this many seconds are repeated
    repeats : of short runs; the shortest time counts
    """

    seconds: float = 0.6
    growth: float = 3.4
    short: float = 0.02
    repeats: int = 3


def scales(case: Case) -> dict[str, float]:
    """The largest size of each state in a motion."""
    states = [each["state"] for each in case["samples"]]
    states += [each[side] for each in case["events"] for side in ("before", "after")]
    found = dict[str, float]()
    for state in states:
        for name, x in state.items():
            found[name] = max(found.get(name, 0.0), abs(x))
    return {name: x or 1.0 for name, x in found.items()}


def compared_samples(case: Case, apart: float = 0.01, fewest: int = 5) -> list[int]:
    """The samples that are compared: near a jump of the state, an error of its time would count as one of the state.

    apart : share of the duration by which a sample is away from jumps
    fewest : all samples count where fewer are left, or where none of them is after a jump
    """
    size, times = scales(case), [each["time"] for each in case["samples"]]
    jumps = [
        each["time"]
        for each in case["events"]
        if any(abs(x - each["before"].get(name, x)) > 1e-9 * size[name] for name, x in each["after"].items())
    ]
    gap = apart * (times[-1] - case["start"]["time"])
    found = [i for i, t in enumerate(times) if all(abs(t - jump) > gap for jump in jumps)]
    enough = len(found) >= fewest and (not jumps or times[found[-1]] > jumps[0])
    return found if enough else list(range(len(times)))


def error_of(case: Case, found: Found) -> float:
    """The largest scaled difference at the samples that are compared."""
    size, samples = scales(case), case["samples"]
    worst = max(
        abs(found.states[i][name] - x) / size[name]
        for i in compared_samples(case)
        for name, x in samples[i]["state"].items()
    )
    return float(worst) if math.isfinite(worst) else math.inf


def event_error_of(case: Case, found: Found) -> float | None:
    """The error of the time of the last event over the duration; None where the number of events differs."""
    if found.last is None or not case["events"]:
        return None
    name, count, at = found.last
    names = [each["event"] for each in case["events"]]
    if (name, count) != (names[-1], names.count(names[-1])):
        return None
    return abs(at - case["events"][-1]["time"]) / (case["samples"][-1]["time"] - case["start"]["time"])


def measured(case: Case, simulator: str, limits: Limits, most: int | None = None) -> Iterator[dict[str, Any]]:
    """The measurements of a simulator on a case, for the first `most` settings of each way."""
    module = import_module(f"studies.exact_orbits.{SIMULATORS[simulator]}")
    for way, settings in module.WAYS.items():
        row = {"case": case["name"], "simulator": simulator, "way": way}
        try:
            ready = module.prepared(case, way)
        except NotImplementedError as error:
            yield row | {"cannot": str(error)}
            return
        if ready is None:
            continue
        took = 0.0
        for setting in settings[:most]:
            if took * limits.growth > limits.seconds:
                break
            own = row | {"setting": setting}
            try:
                found, took = timed(ready(setting), limits)
            except TimeoutError as error:
                yield own | {"failed": str(error)}
                break
            except (ArithmeticError, ValueError, RuntimeError) as error:
                yield own | {"failed": str(error).partition("\n")[0]}
                continue
            own |= {"error": error_of(case, found), "event_error": event_error_of(case, found), "seconds": took}
            yield own


def timed(run: Any, limits: Limits) -> tuple[Found, float]:
    """What a run finds, and the least processor time of some."""
    times = list[float]()
    for _ in range(limits.repeats):
        begin = time.process_time()
        found = run()
        times.append(time.process_time() - begin)
        if times[0] > limits.short:
            break
    return found, min(times)


def main(names: list[str], output: Path | None, quick: bool) -> dict[str, Any]:
    """Measure the named cases, or all."""
    names = names or (list(QUICK) if quick else sorted(path.stem for path in (FOLDER / "cases").glob("*.json")))
    limits, rows = Limits(seconds=0.1) if quick else Limits(), list[Mapping[str, Any]]()
    if output and output.exists():
        stored = json.loads(output.read_text(encoding="utf-8"))["rows"]
        rows = [row for row in stored if row["case"] not in names]
    versions = {name: import_module(f"studies.exact_orbits.{each}").VERSION for name, each in SIMULATORS.items()}
    for name in names:
        case = Case(FOLDER / "cases" / f"{name}.json")
        for simulator in SIMULATORS:
            found = list(measured(case, simulator, limits, 4 if quick else None))
            rows += found
            good = [row for row in found if "error" in row]
            best = min(good, key=lambda row: row["error"], default=None)
            words = f"{best['error']:.1e} in {best['seconds']:.2g} s, {best['way']}" if best else (found or [{}])[0]
            print(f"  {name}: {simulator}: {words}", flush=True)
        results = {"versions": versions, "rows": sorted(rows, key=lambda row: row["case"])}
        if output:
            lines = ",\n".join(json.dumps(row) for row in results["rows"])
            head = f'{{"versions": {json.dumps(versions)}, "rows": [\n'
            output.write_text(f"{head}{lines}\n]}}\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="of cases; all by default")
    parser.add_argument("--output", type=Path, help="JSON file for the measurements")
    parser.add_argument("--quick", action="store_true", help="two cases, a few settings")
    arguments = parser.parse_args()
    main(arguments.names, arguments.output, arguments.quick)
