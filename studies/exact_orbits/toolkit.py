"""The answers of this toolkit to the cases, to compare with those of the second program."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orbits import find
from problems import Hopper
from studies.exact_orbits.closed_forms import CLOSED_FORMS
from studies.exact_orbits.comparison import BOUND, Comparison
from studies.exact_orbits.machines import MACHINES as OTHERS
from studies.exact_orbits.reader import Case


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
HOPPERS = {"linear_hop": lambda: lossless(Hopper(), HOPPER)}


def compared(path: Path) -> Iterator[Comparison]:
    """Compare the numbers of a case with the toolkit's, or with a closed form where it cannot state the machine."""
    if path.stem in HOPPERS:
        yield from HOPPERS[path.stem]()(Case(path))
    elif path.stem in OTHERS | CLOSED_FORMS:
        yield from (OTHERS | CLOSED_FORMS)[path.stem](Case(path))
