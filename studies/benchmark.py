"""Run time against error: every way that the toolkit has, and its peers, on five scenes whose answers are known.

Orbits, flows with their sensitivities, return maps and families are timed as medians of repeats in one run, so that
ratios mean something; errors are true ones, against values in 30 digits. A cold start is broken down into importing,
building, solving and certifying, in a process of its own. Peers that are not installed are left out and said to be.
Run: python studies/benchmark.py [--output FOLDER] [--quick]
"""

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from orbits import METHODS, InputError, ReturnMap, find, follow
from orbits.flow import Flow
from orbits.plot import COLOURS, new_row, save_figure
from problems import Chain, Hopper

# Launch speeds in 30 digits: a root of tan; quadrature of the energy integral; Taylor series in 40 digits.
SCENES = {
    "linear": (Hopper(), 1, "4.49340945790906417530788092728"),
    "cubic": (Hopper("cubic", parameters={"beta": 0.3}), 1, "2.93645918849419649380666492846"),
    "sinh, inverse-square gravity": (
        Hopper("sinh", "1/(1 + z/R)**2", rest_length=12, parameters={"b": 0.5, "R": 80.0}),
        1,
        "3.19858497872741119689813185999",
    ),
    "stiff, r + 50 r^3": (Hopper("cubic", parameters={"beta": 50.0}), 1, "1.29941926357377987165046227552"),
    "cubic, family 40": (Hopper("cubic", parameters={"beta": 0.3}), 40, "30.5394714933042621033602393326"),
}
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def timed(function: Callable, seconds: float) -> tuple[float, object]:
    """The median time of repeats for so long, at least three of what takes under a second, and the last answer."""
    times, began = [], time.perf_counter()
    while not times or (times[0] < 1 and len(times) < 3) or time.perf_counter() - began < seconds:
        start = time.perf_counter()
        answer = function()
        times.append(time.perf_counter() - start)
    return float(np.median(times)), answer


def orbits_of(machine, family: int, exact: float, seconds: float, tolerances) -> list[dict]:
    """An orbit by every way of the toolkit, certified, and by shooting with scipy and CasADi's Opti."""
    rows = []
    for method in METHODS:
        try:
            find(machine, family, method=method)
        except InputError:
            continue
        took, orbit = timed(lambda method=method: find(machine, family, method=method), seconds)
        rows.append({"way": method, "seconds": took, "error": abs(orbit.alpha - exact), "claimed": orbit.error})
    near = orbit
    took, orbit = timed(lambda: find(machine, start=near), seconds)
    rows.append({"way": "warm", "seconds": took, "error": abs(orbit.alpha - exact), "claimed": orbit.error})
    start = np.array([orbit.alpha, orbit.flight_time / 2]) * (1 + 1e-4)
    for tolerance in tolerances:
        took, alpha = timed(lambda tol=tolerance: by_scipy(machine, start, tol), seconds)
        rows.append({"way": "scipy DOP853 + root", "seconds": took, "error": abs(alpha - exact), "setting": tolerance})
    for steps in (50, 200, 800) if family == 1 else (1600,):
        solver = opti(machine, steps)
        took, alpha = timed(lambda s=solver: s(*start), seconds)
        rows.append({"way": "Opti, RK4", "seconds": took, "error": abs(alpha - exact), "setting": steps})
    return rows


def by_scipy(machine, start, tolerance: float) -> float:
    """The launch speed by shooting to rest in mid-flight: DOP853 and the hybrid method, from alpha and half time."""
    field, p, x0 = numeric_field(machine), list(machine.values.values()), find_liftoff(machine)

    def rest(u):
        run = solve_ivp(
            lambda t, x: field(x, p).full().ravel(),
            (0, u[1]),
            [x0, u[0], 0, 0],
            "DOP853",
            rtol=tolerance,
            atol=tolerance,
        )
        return run.y[1::2, -1]

    return float(root(rest, start, tol=tolerance).x[0])


def numeric_field(machine) -> ca.Function:
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", len(machine.values))
    named = dict(zip(machine.values, ca.vertsplit(p), strict=True))
    return ca.Function("f", [x, p], [ca.vertcat(*machine.model.flight.field(ca.vertsplit(x), named, []))])


def find_liftoff(machine) -> float:
    return float(machine.model.release(np.array([1.0]), machine.values)[0])


def opti(machine, steps: int) -> Callable:
    """(alpha, half time) -> launch speed, by multiple shooting with so many RK4 steps, written with CasADi's Opti."""
    field, p, x0 = numeric_field(machine), list(machine.values.values()), find_liftoff(machine)
    problem = ca.Opti()
    x, alpha, duration = problem.variable(4, steps + 1), problem.variable(), problem.variable()
    h = duration / steps
    a, b = ca.MX.sym("a", 4), ca.MX.sym("b")
    k1 = field(a, p)
    k2 = field(a + b / 2 * k1, p)
    k3 = field(a + b / 2 * k2, p)
    k4 = field(a + b * k3, p)
    step = ca.Function("rk4", [a, b], [a + b / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    problem.subject_to(x[:, 1:] == step.map(steps)(x[:, :-1], ca.repmat(h, 1, steps)))
    problem.subject_to(x[:, 0] == ca.vertcat(x0, alpha, 0, 0))
    problem.subject_to(x[1::2, -1] == 0)
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-12})

    def solve(speed, half):
        run = solve_ivp(lambda t, y: field(y, p).full().ravel(), (0, half), [x0, speed, 0, 0], rtol=1e-6,
                        t_eval=np.linspace(0, half, steps + 1))  # fmt: skip
        problem.set_initial(x, run.y)
        problem.set_initial(alpha, speed)
        problem.set_initial(duration, half)
        return float(problem.solve().value(alpha))

    return solve


def flows_of(machine, orbit, seconds: float, tolerances) -> list[dict]:
    """Half the flight with its 4 by 4 transition matrix; the error is that of the energy's conservation and of rest in
    mid-flight."""
    names, p = tuple(machine.values), np.array(list(machine.values.values()))
    start, half, rows = orbit(0.0), orbit.flight_time / 2, []
    seeds = np.eye(4)
    for way in ("Taylor, virtual machine", "Taylor, compiled"):
        along = Flow(machine.model.flight, names)
        if along.method == "Taylor":
            scheme = along.scheme(4)
            scheme.patience, asked = np.inf, False
            if way.endswith("compiled"):
                while (not scheme.compiled and scheme.patience < np.inf) or not asked:
                    scheme.patience, asked = -1.0, True
                    scheme.spend(0)
                if not scheme.compiled:
                    continue
        elif way.endswith("compiled"):
            continue
        took, (path, _) = timed(lambda a=along: a.run(start, p, half, seeds), seconds)
        name = way if along.method == "Taylor" else along.method
        rows.append({"way": name, "seconds": took, "error": float(np.abs(path.end[1:4:2]).max())})
    field = numeric_field(machine)
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


def maps_of(machine, seconds: float) -> list[dict]:
    """The return map at 1000 launches, per launch; by scipy's events at 20 of them."""
    step, alpha = ReturnMap(machine), np.linspace(3.5, 8.0, 1000)
    step(alpha)
    took, hops = timed(lambda: step(alpha), seconds)
    rows = [{"way": "return map, 1000 at a time", "seconds": took / alpha.size, "error": 0.0}]
    took, _ = timed(lambda: step(float(alpha[500])), seconds)
    rows.append({"way": "return map, one", "seconds": took, "error": 0.0})
    field, p = numeric_field(machine), list(machine.values.values())
    lands = lambda t, x: x[2] if t > 1e-3 else 1.0  # noqa: E731
    lands.terminal, lands.direction = True, -1
    few, liftoff = np.flatnonzero(hops.impacts == 1)[:20], find_liftoff(machine)

    def landing():
        speeds = []
        for a in alpha[few]:
            options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "events": lands}
            run = solve_ivp(lambda t, x: field(x, p).full().ravel(), (0, 60), [liftoff, a, 0, 0], **options)
            speeds.append(run.y[3, -1])
        return np.array(speeds)

    took, speeds = timed(landing, seconds)
    error = np.abs(machine.mass_ratio * speeds**2 - hops.loss[few]).max()
    rows.append({"way": "scipy events, flight alone", "seconds": took / max(len(few), 1), "error": float(error)})
    return rows


def family_of(seconds: float) -> list[dict]:
    """The cubic family from beta = 0 to 5, per point, certified; and by stepping scipy's shooting."""
    golden = {0.5: 2.7218099551244222, 1.0: 2.4464033594052791, 2.0: 2.1928659123582987, 5.0: 1.8928045469451067}
    machine = Hopper("cubic", parameters={"beta": 0.0})

    def walk():
        return follow(machine, "beta", 5.0, at=tuple(golden))

    walk()
    took, family = timed(walk, seconds)
    error = max(abs(point.alpha - golden[point.value]) for point in family if point.value in golden)
    rows = [{"way": "follow, certified", "seconds": took / len(family), "error": error}]

    def stepping():
        u, worst = np.array([4.493409457909064, 4.493409457909064]), 0.0
        values = np.unique(np.r_[np.linspace(0, 1, 30), np.linspace(1, 5, 30), list(golden)])
        for value in values[1:]:
            there = machine.with_values(beta=value)
            u = np.full(2, by_scipy(there, u, 1e-12))
            worst = max(worst, abs(u[0] - golden.get(value, u[0])))
        return len(values), worst

    took, (count, error) = timed(stepping, 0.0)
    rows.append({"way": "scipy, stepped", "seconds": took / count, "error": error})
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
import orbits.search as search
whole = search.as_orbit
def certify(*args):
    t.append(time.perf_counter()); return whole(*args)
search.as_orbit = certify
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
    """Time of an orbit against what makes it longer, with the exponent of a power law through the upper half."""

    def measured(values, make):
        calls = [make(value) for value in values]
        for call in calls:  # what is built and kept is not counted
            call()
        times = [timed(call, seconds)[0] for call in calls]
        upper = slice(len(values) // 2 - 1, None)
        exponent = np.polyfit(np.log(values[upper]), np.log(times[upper]), 1)[0]
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
        "loop of 1e6": took,
        "versions": versions,
    }


def draw(results: dict):
    """The work-precision pictures, one for each scene, the cold starts and the scaling."""
    axes = new_row(4, 4.3, 3.7, rows=2).ravel()
    looks = {way: ("o", colour) for way, colour in zip((*METHODS, "warm"), COLOURS, strict=False)}
    looks |= {"scipy DOP853 + root": ("s-", "0.35"), "Opti, RK4": ("^-", "0.6")}
    for one, (name, rows) in zip(axes, results["orbits"].items(), strict=False):
        for way in dict.fromkeys(row["way"] for row in rows):
            points = np.array([(row["error"], row["seconds"]) for row in rows if row["way"] == way])
            style, colour = looks[way]
            one.loglog(np.maximum(points[:, 0], 1e-16), 1e3 * points[:, 1], style, color=colour, ms=5, label=way)
        one.set(title=name, xlabel="true error of alpha", ylabel="ms an orbit", xlim=(3e-17, 1))
    axes[0].legend(frameon=False, fontsize="x-small")
    bars, base = axes[5], np.zeros(len(SCENES))
    for part, colour in zip(("import", "build", "solve", "certify"), COLOURS, strict=False):
        values = np.array([1e3 * results["cold"][name][part] for name in SCENES])
        bars.barh(range(len(SCENES)), values, left=base, color=colour, label=part)
        base = base + values
    bars.set(yticks=range(len(SCENES)), yticklabels=[name.split(",")[0] for name in SCENES], xlabel="ms, cold start")
    bars.legend(frameon=False, fontsize="x-small")
    for one, names in ((axes[6], ("family", "stiffness")), (axes[7], ("masses of a chain", "shooting nodes"))):
        for name in names:
            found = results["scaling"][name]
            label = f"{name}, exponent {found['exponent']:.2f}"
            one.loglog(found["values"], 1e3 * np.array(found["seconds"]), "o-", label=label)
        one.set(ylabel="ms an orbit", xlabel=" or ".join(names))
        one.xaxis.set_minor_formatter("")
        one.legend(frameon=False, fontsize="x-small")
    return axes[0]


def main(folder: Path, quick: bool = False) -> dict:
    seconds = 0.05 if quick else 1.0
    results = {"environment": environment(), "orbits": {}, "flows": {}, "cold": {}}
    tolerances = TOLERANCES[::2] if quick else TOLERANCES
    for name, (machine, family, exact) in SCENES.items():
        some = tolerances[:1] if quick and family > 1 else tolerances
        results["orbits"][name] = orbits_of(machine, family, float(exact), seconds, some)
        results["flows"][name] = flows_of(machine, find(machine, family), seconds, some)
        results["cold"][name] = cold(machine, family)
        for row in results["orbits"][name] + results["flows"][name]:
            print(f"  {name:<30}{row['way']:<26}{1e3 * row['seconds']:10.3f} ms{row['error']:12.1e}")
    results["maps"] = maps_of(Hopper(), seconds)
    results["family"] = family_of(seconds)
    for row in results["maps"] + results["family"]:
        print(f"  {'':<30}{row['way']:<26}{1e3 * row['seconds']:10.4f} ms{row['error']:12.1e}")
    results["scaling"] = scaling(seconds, quick)
    for name, found in results["scaling"].items():
        print(f"  time of an orbit goes with {name} to the power {found['exponent']:.2f}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "benchmark.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(f"\n  figure: {save_figure(draw(results), folder / 'benchmark.png')}")
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figures and the JSON file")
    parser.add_argument("--quick", action="store_true", help="short repeats, under a minute")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
