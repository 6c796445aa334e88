"""Several families of one machine along the same parameter, as one result."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError, NoOrbit, is_list
from ..io import Document
from ..model import Machine, title_of_machine
from ..periodic import family_number
from ..result import Axes, Progress, Result, Row, shown
from .family import Family


@dataclass(frozen=True, repr=False)
class Families(Result, what="families", dimension="point"):
    """Families of a machine along one parameter, as `follow` returns them for several numbers. `[number]` returns one
    of them; iteration goes over the numbers.

    families : by number
    missing : for each number without a family, the reason

    >>> from orbits import follow
    >>> from problems import Hopper
    >>> hops = follow(Hopper("cubic", parameters={"beta": 0.1}), "beta", (0.0, 0.2), families=(1, 2), longest=0.5)
    >>> [round(float(hops[number].column("alpha")[-1]), 6) for number in hops]
    [3.111516, 4.692919]
    """

    families: Mapping[int, Family]
    missing: Mapping[int, str] = field(default_factory=dict)

    machine = property(lambda self: self._first.machine)
    name = property(lambda self: self._first.name, doc="The parameter along which they go.")

    @property
    def _first(self) -> Family:
        return next(iter(self.families.values()))

    @property
    def units(self) -> Mapping[str, str]:
        return self._first.units

    def __getitem__(self, number: int) -> Family:
        if number not in self.families:
            why = f": {self.missing[number]}" if number in self.missing else ""
            known = ", ".join(map(str, self.families))
            raise InputError(f"there is no family {number!r} among these, {known}{why}")
        return self.families[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self.families)

    def __len__(self) -> int:
        return len(self.families)

    def table(self, machine: Machine | None = None, *, events: bool = False) -> dict[str, Any]:
        """The tables of the families below each other, see `Family.table`; the column "family" has their numbers."""
        tables = [family.table(machine, events=events) for family in self.families.values()]
        return {name: np.concatenate([np.asarray(each[name]) for each in tables]) for name in tables[0]}

    def dataframe(self, machine: Machine | None = None) -> Any:
        """The `table` with events and quantities of the motions, as `Family.dataframe`."""
        return super().dataframe(self._first.source if machine is None else machine, events=True)

    def document(self) -> Document:
        families = [each.document() for each in self.families.values()]
        return {"along": self.name, "numbers": [*self.families], "families": families, **self._missing()}

    def saved(self) -> Document:
        families = [each.saved() for each in self.families.values()]
        return {"format": self.form(), "numbers": [*self.families], "families": families, **self._missing()}

    def _missing(self) -> Document:
        return {"missing": {str(number): why for number, why in self.missing.items()}}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Families":
        data = cls._conform(document, Mapping[str, Any])
        families = [Family.of_saved(each, machine) for each in data["families"]]
        missing = {int(number): str(why) for number, why in data["missing"].items()}
        return cls(dict(zip(map(int, data["numbers"]), families, strict=True)), missing)

    def _line(self) -> dict[str, object]:
        return {"along": self.name, "families": [*self.families], "orbits": sum(map(len, self.families.values()))}

    def title(self) -> str:
        numbers = ", ".join(map(str, self.families))
        return f"families {numbers} of {title_of_machine(self.machine)}, along {self.name}"

    def heads(self) -> list[str]:
        return ["family", "orbits", "motions", self.heading(self.name), self.heading("alpha"), "events", "ends"]

    def _rows(self) -> Iterator[Row]:
        """The extent of each family, its events and its ends."""
        for number, family in self.families.items():
            motions = sum(point.admissible for point in family)
            x, speed = family.column("value"), family.column("alpha")
            events = ", ".join(dict.fromkeys(each.kind for each in family.events if each.kind != "value")) or "none"
            ends = ", ".join(end.kind for end in (family.beginning, family.end) if end)
            values = {
                "orbits": len(family), "motions": motions, "start": float(x[0]), "stop": float(x[-1]),
                "alpha at start": float(speed[0]), "alpha at stop": float(speed[-1]), "events": events, "end": ends,
            }  # fmt: skip
            own = {f"{name} of family {number}": value for name, value in values.items()}
            yield Row(str(number), own, ("{}", "{}", *("{:.6g} to {:.6g}",) * 2, "{}", "{}"))

    def _notes(self) -> list[str]:
        return [f"family {number}: {why}" for number, why in self.missing.items()]

    def plot(self, quantity: str = "alpha", axes: Axes | None = None) -> Axes:
        """Plot a quantity, or a formula, of all families against the parameter in one figure, with their events and
        ends; returns the axes. See `Family.plot`."""
        for number, family in self.families.items():
            axes = shown("plot").plot_family(family, axes, quantity, f"family {number}")
        assert axes is not None
        return axes


def numbers_of_families(families: object) -> tuple[int, ...]:
    """The stated numbers of families; raises `InputError` for anything but different ones."""
    numbers = tuple(map(family_number, families)) if is_list(families) else ()
    if not numbers or len({*numbers}) < len(numbers):
        raise InputError(f"families = {families!r}; they must be different numbers of families, such as (1, 2, 3)")
    return numbers


def followed_families(
    numbers: Sequence[int], follow: Callable[[int, Progress], Family], progress: Progress
) -> Families:
    """The families of these numbers, each as `follow` finds it; raises `NoOrbit` where there is none of them."""
    families, missing = dict[int, Family](), dict[int, str]()
    for i, number in enumerate(numbers):

        def report(share: float, i: int = i) -> None:
            if progress:
                progress((i + share) / len(numbers))

        try:
            families[number] = follow(number, report if progress else None)
        except NoOrbit as error:
            missing[number] = str(error)
    if not families:
        raise NoOrbit("; ".join(f"family {number}: {why}" for number, why in missing.items()))
    return Families(families, missing)
