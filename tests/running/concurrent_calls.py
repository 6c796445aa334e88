"""Mixed calls in many threads give the answers that they give one after another; run by `test_exclusive`.

Usage: python concurrent_calls.py THREADS CALLS
"""

import gc
import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor

from orbits import ReturnMap, find, follow, optimize, sensitivities, simulate, trace
from problems import Chain, Hopper, Juggler

LONGEST = 600  # Seconds after which a process that hangs is ended by a signal.
SPRINGS = ("r + 0.1*r**3", "sinh(r)", "tanh(0.2*r)/0.2", "r", "r + 0.05*r**2 + 0.3*r**3", "atan(0.1*r)/0.1")


def machine(k: int) -> Hopper | Juggler:
    """One of many machines, some of which share their laws."""
    kind = Juggler if k % 3 == 2 else Hopper
    return kind(SPRINGS[k % 6] if k % 7 else f"r + 0.0{k}*r**3", mass_ratio=1 + 0.1 * (k % 5))


def call(k: int) -> list[float]:
    """The numbers that one of the calls gives."""
    of = machine(k)
    match k % 8:
        case 0:
            return [find(of, 1 + k % 2).alpha]
        case 1:
            return [point.alpha for point in follow(of, "mass_ratio", of.mass_ratio + 0.4)]
        case 2:
            hops = ReturnMap(of)([4.4, 4.6, 5.0])  # the map itself ends in this thread, and what it holds
            return [*hops.next, *hops.loss]
        case 3:
            return simulate(of, 4.3, hops=2)(1.0).tolist()
        case 4:
            cubic = Hopper("r + b*r**3", parameters={"b": 0.01 * (1 + k % 9)})
            return [optimize(cubic, minimise="alpha", over={"b": (0.005, 0.2)}, starts=1).orbit.alpha]
        case 5:
            orbits = trace(of, "mass_ratio", of.mass_ratio + 0.2)
            return [next(orbits).alpha, next(orbits).alpha]  # the rest of the family is let go
        case 6:
            chain = Chain((1.0, 1.0 + 0.1 * k), "r")
            return [*chain.values.values(), float(chain.springs[0](0.1 * k))]
        case _:
            gc.collect()
            cubic = Hopper("r + b*r**3", parameters={"b": 0.01 * (1 + k % 9)})
            return list(sensitivities(cubic, quantities=["flight_time"])["flight_time"].values())


def in_child(jobs: list[int]) -> bool:
    """Whether a child process of this one, made by `fork` amid the work of the threads, gives the same."""
    if (child := os.fork()) == 0:
        signal.alarm(LONGEST)
        code = 1
        try:
            code = int([call(k) for k in jobs] != [call(k) for k in jobs])
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1] == 0


if __name__ == "__main__":
    if hasattr(signal, "alarm"):
        signal.alarm(LONGEST)
    threads, calls = map(int, sys.argv[1:])
    with ThreadPoolExecutor(threads) as pool:
        waiting = [pool.submit(call, k) for k in range(calls)]
        forked = not hasattr(os, "fork") or in_child([0, 1, 3, 4])
        together = [job.result() for job in waiting]
    different = [k for k in range(calls) if repr(call(k)) != repr(together[k])]
    print(f"{calls} calls in {threads} threads: different {different}, child {'well' if forked else 'lost'}")
    sys.exit(bool(different) or not forked)
