"""The answers of this toolkit to the cases, to compare with those of the second program."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orbits import find
from problems import Hopper

BOUND = 1e-12  # of differences, in units of the largest number of a motion


@dataclass(frozen=True)
class Comparison:
    """A number of a case, as computed again, against the one in its file.

    what : which number
    difference, bound : between the two, and what it may be
    """

    what: str
    difference: float
    bound: float

    @property
    def agrees(self) -> bool:
        """Whether the difference is within its bound."""
        return self.difference <= self.bound


def lossless(machine: Any, names: tuple[str, ...], **how: Any) -> Callable[[Mapping[str, Any]], Iterator[Comparison]]:
    """The comparison with an orbit that `find` finds: the times of events, and the states at twenty times.

    names : of the case's states, in the order of the machine's
    how : options of `find`
    """

    def compared(document: Mapping[str, Any]) -> Iterator[Comparison]:
        orbit = find(machine, **how)
        cycles = np.arange(len(document["events"]) + 1)
        times = (cycles[:, None] * orbit.period + [0.0, orbit.flight_time]).ravel()[1:]
        for k, each in enumerate(document["events"]):
            yield Comparison(f"time of event {k + 1}", abs(times[k] - each["time"]), BOUND * max(1.0, each["time"]))
        states = np.array([[each["state"][name] for name in names] for each in document["samples"]])
        found = orbit(np.array([each["time"] for each in document["samples"]]) % orbit.period)
        size = max(1.0, np.abs(states).max())
        for each, difference in zip(document["samples"], np.abs(found - states).max(axis=1), strict=True):
            yield Comparison(f"at {each['time']}", float(difference), BOUND * size)

    return compared


HOPPER = ("y1", "v1", "y2", "v2")
MACHINES: dict[str, Callable[[], Any]] = {
    "linear_hop": lambda: lossless(Hopper(), HOPPER),
}


def compared(path: Path) -> Iterator[Comparison]:
    """Compare the numbers of a case with the toolkit's; none where it cannot state the machine."""
    if path.stem in MACHINES:
        yield from MACHINES[path.stem]()(json.loads(path.read_text(encoding="utf-8")))
