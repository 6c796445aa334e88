"""Run time against error: every way that the toolkit has, and its peers, on five scenes whose answers are known.

Orbits, flows with their sensitivities, return maps and families are timed on one core, as medians of repeats in one
run (what takes seconds is timed once), so that ratios mean something; errors are true ones, against values in 30
digits. A cold start is broken down into importing, building, solving and certifying, in a process of its own. Peers
start from within 1e-4 of the answer, with equations in the form that suits them, and certify nothing; those that are
not installed are left out, and said to be. `benchmark_figure` draws the figure anew from the JSON file.
Run: python studies/benchmark.py [--output FOLDER] [--quick] [--against FILE]
"""

import argparse
import contextlib
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from importlib import metadata
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one core: ratios of busy ones mean little

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from orbits import InputError, ReturnMap, find, follow, orbit_at
from orbits.continuation.curve import Curve
from orbits.curves.bordered_newton import newton_steps
from orbits.flow import Flow
from orbits.flow.runge_kutta import RungeKuttaStepper
from orbits.shooting import METHODS, equations_of
from orbits.show import save_figure
from problems import Chain, Hopper

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from studies import peers
from studies.benchmark_figure import draw

# Machine, family, launch speed in 30 digits (a root of tan; quadrature of the energy integral; Taylor series in 40
# digits), and the flight's rates in plain Python.
SCENES = {
    "linear": (Hopper(), 1, "4.49340945790906417530788092728", peers.rates_of(lambda r: r)),
    "cubic": (
        Hopper("cubic", parameters={"beta": 0.3}),
        1,
        "2.93645918849419649380666492846",
        peers.rates_of(lambda r: r + 0.3 * r**3),
    ),
    "sinh, inverse-square gravity": (
        Hopper("sinh", "1/(1 + z/R)**2", rest_length=12, parameters={"b": 0.5, "R": 80.0}),
        1,
        "3.19858497872741119689813185999",
        peers.rates_of(lambda r: 2 * math.sinh(0.5 * r), lambda z: 1 / (1 + z / 80) ** 2, 12.0),
    ),
    "stiff, r + 50 r^3": (
        Hopper("cubic", parameters={"beta": 50.0}),
        1,
        "1.29941926357377987165046227552",
        peers.rates_of(lambda r: r + 50 * r**3),
    ),
    "cubic, family 40": (
        Hopper("cubic", parameters={"beta": 0.3}),
        40,
        "30.5394714933042621033602393326",
        peers.rates_of(lambda r: r + 0.3 * r**3),
    ),
}
# Losses (in the square of the launch speed) of launches that land once, by the scene: by Taylor series in 40 digits.
LOSSES = {
    "linear": {
        4.5: "0.0433979761034926648291169509558",
        4.6: "1.86746556959198037510190444789",
        5.5: "28.6850589823529348231332917599",
    },
    "cubic": {
        3.0: "0.942783659457491841535091127985",
        3.25: "9.08580852934471158337211783861",
        3.5: "13.7611432397845077387401245239",
    },
    "sinh, inverse-square gravity": {
        3.25: "0.744085578957362002044424888738",
        3.5: "8.40005146362737811671659427546",
        3.75: "14.6577156381007974819548649155",
    },
    "stiff, r + 50 r^3": {
        1.3125: "0.0364066499819287586729416821846",
        1.375: "1.00778912087075371211602074432",
        1.5: "2.67039382116499487223151824434",
    },
}
# How near a family's points lie. Maps and families are asked so often before they are timed, until all is compiled that
# repays it.
LONGEST, WARM = 0.0125, 50
# What a point of a family is compared with: one Newton step of its equations, in as few unknowns as they have, near the
# family's end; and what it takes at least in all four states, half its flight by the compiled flow with its derivatives
# by the state and the parameter, the mean over the family.
NEWTON, FLOWN = "a Newton step", "half a flight, compiled flow"


def timed(function: Callable, seconds: float) -> tuple[float, object]:
    """The median time of repeats for so long, at least three of what takes under a second, and the last answer."""
    times, began = [], time.perf_counter()
    while not times or (times[0] < 1 and len(times) < 3) or time.perf_counter() - began < seconds:
        start = time.perf_counter()
        answer = function()
        times.append(time.perf_counter() - start)
    return float(np.median(times)), answer


def error_of(alpha: float, exact: str) -> float:
    """The true error, below the rounding of the exact value too."""
    return float(abs(Fraction(alpha) - Fraction(exact)))


def orbits_of(machine, family: int, exact: str, rates: Callable, seconds: float, quick: bool) -> list[dict]:
    """An orbit by every way of the toolkit, certified, and by its peers from a guess within 1e-4."""
    some = quick and family > 1  # of high families peers take seconds
    rows = []
    for method in METHODS:
        try:
            find(machine, family, method=method)
        except InputError:
            continue
        took, orbit = timed(lambda method=method: find(machine, family, method=method), seconds)
        rows.append({"way": method, "seconds": took, "error": error_of(orbit.alpha, exact), "claimed": orbit.error})
    for name, value in machine.spring.parameters.items():
        near = find(machine.with_values(**{name: 1.01 * value}), family)
        took, orbit = timed(lambda near=near: find(machine, family, start=near), seconds)
        rows.append({"way": "warm", "seconds": took, "error": error_of(orbit.alpha, exact), "claimed": orbit.error})
    start = np.array([orbit.alpha, orbit.flight_time / 2]) * (1 + 1e-4)
    for way, (make, settings) in peers.ORBITS.items():
        for setting in settings[: 1 if some else None : 2 if quick else 1]:
            with contextlib.suppress(ImportError, RuntimeError):  # not installed, or without an answer: family 40
                solver = make(rates if way.startswith("scipy") else machine, peers.liftoff(machine), setting)
                took, alpha = timed(lambda s=solver: s(*start), seconds)
                rows.append({"way": way, "seconds": took, "error": error_of(alpha, exact), "setting": setting})
    return rows


def flow_of(machine, way: str, *vary: str) -> Callable:
    """Flights with their derivatives by the four states and by varied parameters, (start, parameters, time) -> motion,
    derivatives."""
    names, columns = tuple(machine.values), 4 + len(vary)
    along, places = Flow(replace(machine.model.flight, closed_form=None), names), tuple(map(names.index, vary))
    seeds, parameter_seeds = np.eye(4, columns), np.zeros((len(names), columns))
    parameter_seeds[places, range(4, columns)] = 1.0
    if way.startswith("Runge-Kutta"):
        along.steppers[columns, places] = RungeKuttaStepper(along.vector_field, columns, places)
    return lambda start, p, time: along.run(start, p, time, seeds, parameter_seeds)


def flows_of(machine, orbit, seconds: float, tolerances) -> list[dict]:
    """Half the flight with its transition matrix by every way; the error is that of rest in mid-flight."""
    p = np.array(list(machine.values.values()))
    start, half, rows = orbit(0.0), orbit.flight_time / 2, []
    seeds = np.eye(4)
    for way in ("Taylor", "Runge-Kutta of order 8"):
        along = flow_of(machine, way)
        took, (path, _) = timed(lambda a=along: a(start, p, half), seconds)
        rows.append({"way": way, "seconds": took, "error": float(np.abs(path.end[1:4:2]).max())})
    with contextlib.suppress(ImportError):
        along = peers.flow_by_heyoka(machine)
        took, (end, _) = timed(lambda: along(start, half), seconds)
        rows.append({"way": "heyoka", "seconds": took, "error": float(np.abs(end[1:4:2]).max())})
    field, p = peers.flight_of(machine)
    x, q = ca.SX.sym("x", 4), ca.SX.sym("p", len(p))
    slope = ca.Function("slope", [x, q], [ca.jacobian(field(x, q), x)])

    def variational(t, z):
        return np.concatenate([field(z[:4], p).full().ravel(), (slope(z[:4], p).full() @ z[4:].reshape(4, 4)).ravel()])

    for tolerance in tolerances:
        took, run = timed(
            lambda tol=tolerance: solve_ivp(
                variational, (0, half), np.r_[start, seeds.ravel()], "DOP853", rtol=tol, atol=tol
            ),
            seconds,
        )
        error = float(np.abs(run.y[1:4:2, -1]).max())
        rows.append({"way": "scipy DOP853", "seconds": took, "error": error, "setting": tolerance})
    return rows


def _warmed(call: Callable, seconds: float):
    """Ask until all is compiled whose use repays it, for a few seconds at most."""
    began = time.perf_counter()
    for _ in range(WARM):
        call()
        if time.perf_counter() - began > 2 + 6 * seconds:
            break


def maps_of(machine, rates: Callable, losses: dict[float, str], seconds: float) -> list[dict]:
    """The return map at 1000 launches, per launch, and at one; a landing by scipy's events."""
    step, alpha, known = ReturnMap(machine), np.linspace(3.5, 8.0, 1000), np.array(list(losses))
    true = np.array([float(loss) for loss in losses.values()])
    _warmed(lambda: step(alpha), seconds)
    error = float(np.abs(step(known).loss - true).max())
    many, _ = timed(lambda: step(alpha), seconds)
    one, _ = timed(lambda: step(float(alpha[500])), seconds)
    liftoff = peers.liftoff(machine)
    lands = lambda t, x: x[2] if t > 1e-3 else 1.0  # noqa: E731
    lands.terminal, lands.direction = True, -1

    def landing():
        options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "events": lands}
        return np.array([solve_ivp(rates, (0, 60), [liftoff, a, 0, 0], **options).y[3, -1] for a in known])

    took, speeds = timed(landing, seconds)
    return [
        {"way": "return map, 1000 at a time", "seconds": many / alpha.size, "error": error},
        {"way": "return map, one", "seconds": one, "error": error},
        {
            "way": "scipy events, flight alone",
            "seconds": took / known.size,
            "error": float(np.abs(machine.mass_ratio * speeds**2 - true).max()),
        },
    ]


def lanes_of(seconds: float, quick: bool) -> dict[str, list[dict]]:
    """Many motions at a time in the lanes of machine code: half a flight with its derivatives, beside heyoka's batch
    mode; a step of the relative flow; and a map whose launches several threads share."""
    (machine, family, *_), count = SCENES["cubic"], 100 if quick else 1000
    orbit = find(machine, family)
    half, p = np.full(count, orbit.flight_time / 2), np.array([list(machine.values.values())])
    flight, starts = Flow(replace(machine.model.flight, closed_form=None), tuple(machine.values)), orbit(0.0)
    relative = equations_of(machine.model, "relative", tuple(machine.values)).flows[0]
    found: dict[str, list[dict]] = {"half a flight and its slopes": [], "a step of the relative flow": []}
    for scene, flow, start, columns in (
        ("half a flight and its slopes", flight, starts, 4),
        ("a step of the relative flow", relative, [orbit.liftoff_extension, orbit.alpha], 0),
        ("a step of the relative flow", relative, [orbit.liftoff_extension, orbit.alpha], 2),
    ):
        stepper = flow.stepper(columns)
        many = np.tile(start, (count, 1)), p, half, np.eye(flow.size, columns), np.zeros((p.size, columns))
        steps = len(stepper.advance_all(*many).steps) if flow is relative else count
        took, motions = timed(lambda many=many, stepper=stepper: stepper.advance_all(*many), seconds)
        row = {"way": f"lanes, {columns} columns", "seconds": took / steps, "setting": count}
        found[scene].append(row | {"error": float(np.abs(motions.ends[:, 1::2]).max())})
    fast = {"force_avx512": True, "fast_math": True}
    ways = ("heyoka, batch", {}), ("heyoka, batch, fast", fast), ("heyoka, batch, recorded", {**fast, "record": True})
    for way, options in ways:
        with contextlib.suppress(ImportError):
            batch = peers.flows_by_heyoka(machine, **options)
            took, (ends, _) = timed(lambda batch=batch: batch(np.tile(starts, (count, 1)), half), seconds)
            row = {"way": way, "seconds": took / count, "setting": count}
            found["half a flight and its slopes"].append(row | {"error": float(np.abs(ends[:, 1::2]).max())})
    return found | {"return map in threads": _threads_of(machine, 1000 if quick else 100_000)}


def _threads_of(machine, count: int) -> list[dict]:
    """A map of so many launches by one thread and by two; the error is that of the second against the first."""
    step, alpha, before = ReturnMap(machine), np.linspace(3.5, 8.0, count), os.environ.get("ORBITS_THREADS")
    _warmed(lambda: step(alpha[:1000]), 1.0)
    rows, first = [], None
    for threads in (1, 2):
        os.environ["ORBITS_THREADS"] = str(threads)
        took, hops = timed(lambda: step(alpha), 0.0)
        first = hops.next if first is None else first
        error = float(np.nanmax(np.abs(hops.next - first)))
        rows.append({"way": f"{threads} threads", "seconds": took / count, "error": error, "setting": count})
    os.environ.pop("ORBITS_THREADS") if before is None else os.environ.update(ORBITS_THREADS=before)
    return rows


def families_of(seconds: float, quick: bool) -> dict[str, list[dict]]:
    """A family through every scene: a point, certified, and what it is compared with; the cubic one by stepping scipy's
    shooting too."""
    golden = {0.5: "2.7218099551244222", 1.0: "2.4464033594052791", 2.0: "2.1928659123582987"}
    golden[5.0] = "1.8928045469451067"
    straight, cubic = Hopper("k*r", parameters={"k": 1.0}), Hopper("cubic", parameters={"beta": 0.0})
    bent, _, exact, _ = SCENES["sinh, inverse-square gravity"]
    found = {
        "cubic": _followed(cubic, "beta", 5.0, 1, golden, seconds),
        "sinh, inverse-square gravity": _followed(bent.with_values(b=0.1), "b", 2.0, 1, {0.5: exact}, seconds),
    }
    if quick:
        return found
    found["linear"] = _followed(straight, "k", 6.0, 1, {4.0: "2.24670472895453208765394046364"}, seconds)
    for name, stop in (("stiff, r + 50 r^3", 60.0), ("cubic, family 40", 0.35)):
        machine, family, exact, _ = SCENES[name]
        value = machine.values["beta"]
        found[name] = _followed(cubic, "beta", stop, family, {value: exact}, seconds)

    def stepping():
        u, worst = np.array([4.493409457909064, 4.493409457909064]), 0.0
        values = np.unique(np.r_[np.linspace(0, 1, 30), np.linspace(1, 5, 30), list(golden)])
        for value in values[1:]:
            force = lambda r, beta=value: r + beta * r**3  # noqa: E731
            liftoff = peers.liftoff(Hopper("cubic", parameters={"beta": value}))
            u = np.full(2, peers.by_scipy(peers.rates_of(force), liftoff, 1e-12)(*u))
            worst = max(worst, error_of(u[0], golden[value]) if value in golden else 0.0)
        return len(values), worst

    took, (count, error) = timed(stepping, 0.0)
    found["cubic"].append({"way": "scipy, stepped", "seconds": took / count, "error": error})
    return found


def _followed(machine, along: str, stop: float, number: int, golden: dict[float, str], seconds: float) -> list[dict]:
    def walk():
        return follow(machine, along, stop, family=number, at=tuple(golden), longest=LONGEST)

    _warmed(walk, seconds)
    took, family = timed(walk, seconds)
    error = max(error_of(point.alpha, golden[point.value]) for point in family if point.value in golden)
    curve = Curve(machine, along, family.settings["method"], 1.0)
    points = family.points[-40:]
    xs, rows = np.array([[*point.u, point.value] for point in points]), np.array([point.tangent for point in points])
    levels = np.einsum("mi,mi->m", rows, xs)
    newton = lambda: newton_steps(curve.evaluate(xs), xs, rows, levels)  # noqa: E731
    once, _ = timed(newton, seconds)
    rows = [
        {"way": "follow, certified", "seconds": took / len(family), "error": error, "points": len(family)},
        {"way": NEWTON, "seconds": once / len(points), "error": 0.0},
    ]
    flown, times = flow_of(machine, "Taylor", along), []
    for point in family.points[:: len(family) // 8]:
        orbit, p = orbit_at(machine, point, along), machine.with_values(**{along: point.value}).values.values()
        here = orbit(0.0), np.array(list(p)), orbit.flight_time / 2
        times.append(timed(lambda known=here: flown(*known), seconds / 8)[0])
    rows.append({"way": FLOWN, "seconds": float(np.mean(times)), "error": 0.0})
    return rows


COLD = """
import time; t = [time.perf_counter()]
import json
from orbits import find
from problems import Hopper
t.append(time.perf_counter())
machine = Hopper(**json.loads({machine!r}))
machine.model, machine.values
t.append(time.perf_counter())
import orbits.periodic.family_orbits as search
whole = search.certified_orbit
def certify(*args, **options):
    t.append(time.perf_counter()); return whole(*args, **options)
search.certified_orbit = certify
orbit = find(machine, {family})
t.append(time.perf_counter())
print(json.dumps([[b - a for a, b in zip(t, t[1:])], list(orbit.skipped)]))
"""


def cold(machine, family: int) -> dict:
    """Seconds of a new process: importing, building, solving, certifying; and what the scene did without."""
    described = machine.describe()
    statement = {name: described[name] for name in ("spring", "gravity", "mass_ratio", "rest_length", "parameters")}
    code = COLD.format(machine=json.dumps(statement), family=family)
    runs = [
        json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in "123"
    ]
    times = np.median([run[0] for run in runs], axis=0)
    return {**dict(zip(("import", "build", "solve", "certify"), times.tolist(), strict=True)), "skipped": runs[0][1]}


def scaling(seconds: float, quick: bool) -> dict[str, dict]:
    """Time of an orbit against what makes it longer, with the exponent of a power law through the last three."""

    def measured(values, make):
        calls = [make(value) for value in values]
        for call in calls:  # what is built and kept is not counted
            call()
        times = [timed(call, seconds)[0] for call in calls]
        exponent = np.polyfit(np.log(values[-3:]), np.log(times[-3:]), 1)[0]
        return {"values": list(values), "seconds": times, "exponent": float(exponent)}

    def chain_hop(count):
        chain = Chain([1.0] * count)
        start = chain.starts(6.0, 6.0)[0]
        return lambda: find(chain, start=start)

    families = [1, 3, 10, 30, 100]
    machine = Hopper("cubic", parameters={"beta": 0.3})
    shooting = measured(families[: 3 if quick else 4], lambda n: lambda: find(machine, n, method="shooting"))
    return {
        "family": measured(families, lambda n: lambda: find(machine, n)),
        "stiffness": measured([1, 10, 100, 1000, 10_000], lambda b: lambda: find(machine.with_values(beta=b))),
        "masses of a chain": measured([2, 3, 4, 6] if quick else [2, 3, 4, 6, 9, 12], chain_hop),
        "shooting nodes": {**shooting, "values": [len(find(machine, n).flight.steps) for n in shooting["values"]]},
    }


def environment() -> dict:
    """Where the figures were measured, the speed of a plain loop for comparison, and which peers were there."""
    took, _ = timed(lambda: sum(i * i for i in range(1_000_000)), 0.0)
    versions = {}
    for name in ("persistent-orbits", "casadi", "numpy", "scipy", "rockit-meco", "heyoka"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "loop of 1e6": took,
        "versions": versions,
    }


def rows_of(results: dict) -> dict[str, dict]:
    """Every row that was measured, by what it is of."""
    found = {}
    for part in ("orbits", "flows", "lanes", "maps", "families"):
        for scene, rows in results.get(part, {}).items():  # an earlier version may not have measured it
            for row in rows:
                found[" | ".join([part, scene, row["way"], *([str(row["setting"])] if "setting" in row else [])])] = row
    return found


def compare(results: dict, before: dict):
    """Print what has become faster or slower since an earlier run on the same machine."""
    earlier, loops = rows_of(before), [run["environment"]["loop of 1e6"] for run in (before, results)]
    print(f"\n  against the earlier run (a plain loop took {1e3 * loops[0]:.0f} ms then, {1e3 * loops[1]:.0f} ms now):")
    for name, row in rows_of(results).items():
        if name in earlier:
            then, now = 1e3 * earlier[name]["seconds"], 1e3 * row["seconds"]
            print(f"  {name:<76}{then:10.4f} ms, now{now:10.4f} ms: {then / now:5.2f} times as fast")


def main(folder: Path, quick: bool = False, against: Path | None = None) -> dict:
    seconds = 0.05 if quick else 1.0
    before = json.loads(against.read_text(encoding="utf-8")) if against else None
    results = {"environment": environment(), "orbits": {}, "flows": {}, "cold": {}}
    for name, (machine, family, exact, rates) in SCENES.items():
        some = quick and family > 1
        results["orbits"][name] = orbits_of(machine, family, exact, rates, seconds, quick)
        results["flows"][name] = flows_of(
            machine, find(machine, family), seconds, peers.TOLERANCES[:: 4 if some else 1]
        )
        results["cold"][name] = cold(machine, family)
    results["lanes"] = lanes_of(seconds, quick)
    results["maps"] = {
        name: maps_of(SCENES[name][0], SCENES[name][3], LOSSES[name], seconds)
        for name in list(LOSSES)[: 2 if quick else None]
    }
    results["families"] = families_of(seconds, quick)
    for name, row in rows_of(results).items():
        print(f"  {name:<76}{1e3 * row['seconds']:10.4f} ms{row['error']:12.1e}")
    for name, rows in results["families"].items():
        seconds_of = {row["way"]: row["seconds"] for row in rows}
        if FLOWN in seconds_of:
            times = seconds_of["follow, certified"] / np.array([seconds_of[FLOWN], seconds_of[NEWTON]])
            print(f"  families | {name}: a point takes {times[0]:.1f} compiled flows, or {times[1]:.1f} Newton steps")
    for name, row in results["cold"].items():
        parts = ", ".join(f"{part} {1e3 * row[part]:.0f} ms" for part in ("import", "build", "solve", "certify"))
        print(f"  cold start, {name}: {parts}; without " + "; ".join(row["skipped"]))
    results["scaling"] = scaling(seconds, quick)
    for name, found in results["scaling"].items():
        print(f"  time of an orbit goes with {name} to the power {found['exponent']:.2f}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "benchmark.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    if before:
        compare(results, before)
    print(f"\n  figure: {save_figure(draw(results), folder / 'benchmark.png')}")
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures and the JSON file")
    parser.add_argument("--quick", action="store_true", help="short repeats, under a minute")
    parser.add_argument("--against", type=Path, help="benchmark.json of an earlier run, to compare with")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick, arguments.against)
