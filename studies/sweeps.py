"""How fast are sweeps, and are they right? Thousands of members of three machines, and each of them against `find`.

The machines: a cubic hopper of three parameters; the same in gravity that falls with the height; and a spring with a
tanh and a sinh term, over a box where a tenth of the laws have no orbit. Times are per member, with what is compiled on
the way in the first of two columns and without it in the second. `--check` asks `find` for every member again: its
status, its reason and its launch speed have to agree, the last within the bounds of the errors.
Run: python studies/sweeps.py [--members N] [--check N] [--processes] [--quick]
"""

import argparse
from collections.abc import Mapping
from time import perf_counter

from orbits import NoOrbit, Sweep, existence, sweep
from problems import Hopper

MACHINES = {
    "cubic": Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3}),
    "varying gravity": Hopper("cubic", "1/(1 + z/R)**2", rest_length=20.0, parameters={"beta": 0.3, "R": 100.0}),
    "tanh and sinh": Hopper("tanh(b*r)/b - c*sinh(r)", parameters={"b": 0.2, "c": 1e-4}),
}
OVER = {
    "cubic": {"beta": (0.0, 1.0), "mass_ratio": (0.2, 5.0, "log"), "rest_length": (6.0, 20.0)},
    "varying gravity": {"beta": (0.0, 1.0), "mass_ratio": (0.5, 2.0), "R": (50.0, 500.0)},
    "tanh and sinh": {"b": (0.05, 0.3), "c": (1e-8, 3e-3, "log")},
}
DIAGRAM = Hopper("r + beta*r**3 + delta*r**5", rest_length=30.0, parameters={"beta": 0.0, "delta": 0.0})


def rates(members: int) -> dict[str, tuple[float, float, Mapping[str, int]]]:
    """By machine the seconds of a first sweep, those of a second one over other members, and its statuses."""
    found = {}
    for name, machine in MACHINES.items():
        seconds = []
        for seed in (0, 1):
            began = perf_counter()
            answer = sweep(machine, OVER[name], members, seed=seed, progress=False)
            seconds.append(perf_counter() - began)
        found[name] = (*seconds, answer.statuses())
        told = ", ".join(f"{count} {status}" for status, count in answer.statuses().items())
        print(f"  {name:<16}{members} members: {seconds[0]:.2f} s, again {seconds[1]:.2f} s "
              f"({1e3 * seconds[1] / members:.3f} ms each); {told}", flush=True)  # fmt: skip
    return found


def of_diagram(samples: int) -> float:
    """The seconds of a diagram of existence."""
    began = perf_counter()
    diagram = existence(DIAGRAM, "beta", (-0.03, 0.01), "delta", (-1e-4, 1.5e-4), samples=samples, progress=False)
    seconds = perf_counter() - began
    edges = len(diagram.orbit_edges), len(diagram.motion_edges)
    print(f"  existence, {samples} x {samples}: {seconds:.2f} s; {edges[0]} points on the edge of the orbits, "
          f"{edges[1]} on that of the motions")  # fmt: skip
    return seconds


def of_processes(members: int) -> float:
    """How many times faster two processes are than this one."""
    seconds = []
    for options in ({}, {"executor": "processes", "workers": 2}):
        began = perf_counter()
        sweep(MACHINES["cubic"], OVER["cubic"], members, progress=False, **options)
        seconds.append(perf_counter() - began)
    print(
        f"  {members} members: {seconds[0]:.2f} s, by two processes {seconds[1]:.2f} s, {seconds[0] / seconds[1]:.2f}x"
    )
    return seconds[0] / seconds[1]


def differing(answer: Sweep) -> list[int]:
    """The members of a sweep that `find` answers otherwise."""
    found = []
    for i, member in enumerate(answer.index.tolist()):
        try:
            orbit = answer.orbit(member)
        except NoOrbit as error:
            same = answer["status"][i] == "no orbit" and answer["reason"][i] == str(error)
        else:
            near = abs(orbit.alpha - answer["alpha"][i]) <= orbit.error + answer["error"][i]
            same = near and answer["status"][i] == ("certified" if orbit.admissible else "inadmissible")
        if not same:
            found.append(member)
    return found


def check(members: int) -> int:
    """How many of so many members of all machines, and of the diagram's, `find` answers otherwise."""
    wrong, each = 0, members // (len(MACHINES) + 1)
    questions = {name: (machine, OVER[name]) for name, machine in MACHINES.items()}
    questions["two powers"] = DIAGRAM, {"beta": (-0.03, 0.01), "delta": (-1e-4, 1.5e-4)}
    for name, (machine, over) in questions.items():
        answer = sweep(machine, over, each, seed=2, progress=False)
        others = differing(answer)
        wrong += len(others)
        print(
            f"  {name:<16}{each} members, {answer.statuses()}: find answers {len(others)} otherwise {others[:5]}",
            flush=True,
        )
    return wrong


def main(members: int = 10_000, checked: int = 0, processes: bool = False, samples: int = 100) -> dict:
    found: dict = {"rates": rates(members), "existence": of_diagram(samples)}
    if processes:
        found["processes"] = of_processes(5 * members)
    if checked:
        found["wrong"] = check(checked)
        print(f"  {found['wrong']} of {checked} members are wrong")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--members", type=int, default=10_000, help="of each machine")
    parser.add_argument("--check", type=int, default=0, metavar="N", help="members to ask find for")
    parser.add_argument("--processes", action="store_true", help="two processes against one")
    parser.add_argument("--quick", action="store_true", help="200 members, 40 of them checked")
    arguments = parser.parse_args()
    if arguments.quick:
        main(200, 40, arguments.processes, 8)
    else:
        main(arguments.members, arguments.check, arguments.processes)
