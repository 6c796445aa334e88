"""Many laws through every entry point, and the most memory that the process took; run by `test_caches`.

Usage: python many_laws.py LAWS MEGABYTES
"""

import re
import resource
import sys
from pathlib import Path

from orbits import ReturnMap, find, find_all, follow, optimize, simulate
from problems import Chain, Hopper, steering


def peak() -> float:
    """The most memory of this process in MB. Linux's `ru_maxrss` also counts that of the process that started it."""
    if (status := Path("/proc/self/status")).exists():
        return int(re.findall(r"VmHWM:\s*(\d+)", status.read_text())[0]) / 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def use(k: int) -> None:
    """One law through every entry point."""
    law = f"r + 0.{100 + k}*r**3"
    of = Hopper(law)
    find(of)
    follow(of, "mass_ratio", 1.3)
    ReturnMap(of)([4.4, 4.6])
    simulate(of, 4.3, hops=2)
    free = Hopper(f"r + b*r**3 + 0.00{100 + k}*r**5", parameters={"b": 0.1})
    optimize(free, minimise="alpha", over={"b": (0.05, 0.2)}, starts=1)
    steering.keep_hopping(Hopper(law, damping=0.01), intervals=14)
    chain = Chain([1.0] * (3 + k % 3), f"{100 + k}*r/100")
    find_all(chain, chain.starts(2.0, 4.0)[:1])


if __name__ == "__main__":
    laws, most = map(int, sys.argv[1:])
    for k in range(laws):
        use(k)
    used = peak()
    print(f"{laws} laws took {used:.0f} MB")
    sys.exit(used > most)
