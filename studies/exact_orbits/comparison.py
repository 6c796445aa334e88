"""Comparisons of a case's numbers with those of another program: of its events, and of its states at twenty times."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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


def compared_motion(
    document: Mapping[str, Any], times: Sequence[float], states_at: Callable[[float], Mapping[str, float]],
    bound: float = BOUND,
) -> Iterator[Comparison]:  # fmt: skip
    """Compare the times of all events, and states at twenty times.

    times : (k,) of the events
    states_at : states of the case by name, all or some, at a time
    bound : of differences, in units of the largest number
    """
    for k, (each, time) in enumerate(zip(document["events"], times, strict=True), 1):
        yield Comparison(f"time of event {k}", abs(time - each["time"]), bound * max(1.0, each["time"]))
    size = max(1.0, *(abs(x) for each in document["samples"] for x in each["state"].values()))
    for each in document["samples"]:
        found = states_at(each["time"])
        difference = max(abs(found[name] - x) for name, x in each["state"].items() if name in found)
        yield Comparison(f"at {each['time']}", float(difference), bound * size)
