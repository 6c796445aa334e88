"""The word of hops that come back: the number of impacts of each, from which the arcs and their unknowns follow.

A hop flies from its launch to the first impact and on to each further one, leaves at once after all but the last, and
ends with a contact, which leads to the next launch, and in the last hop back to the first one.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class HopWord:
    """The arcs of hops that come back.

    impacts : the number of impacts of each hop, as in the statement of cycles in floats
    """

    impacts: tuple[int, ...]

    @property
    def period(self) -> int:
        """The number of hops."""
        return len(self.impacts)

    @property
    def bounces(self) -> bool:
        """Whether a hop has an impact after which the machine leaves at once."""
        return max(self.impacts) > 1

    @property
    def launches(self) -> tuple[str, ...]:
        """The names of the launch speeds."""
        return ("alpha", *(f"alpha{each}" for each in self._numbers[1:]))

    @property
    def flights(self) -> tuple[tuple[str, ...], ...]:
        """The names of the times of the flights of each hop."""
        pairs = zip(self._numbers, self.impacts, strict=True)
        return tuple(
            tuple(f"flight_time{i}_{j + 1}" for j in range(count)) if count > 1 else (f"flight_time{i}",)
            for i, count in pairs
        )

    @property
    def contacts(self) -> tuple[str, ...]:
        """The names of the times of the contacts."""
        return tuple(f"contact_time{each}" for each in self._numbers)

    @property
    def times(self) -> list[str]:
        """The names of the times of all flights and contacts, in the order of the arcs."""
        return [name for own, last in zip(self.flights, self.contacts, strict=True) for name in (*own, last)]

    def following(self, hop: int) -> str:
        """The name of the launch speed to which a hop leads."""
        return self.launches[(hop + 1) % self.period]

    def in_words(self) -> str:
        """The hops in words, with their impacts."""
        first, *others = self.impacts
        if others:
            return f"{self.period} hops that come back, of {', '.join(map(str, self.impacts))} impacts,"
        return f"a hop of {first} impact{'' if first == 1 else 's'} that comes back"

    @property
    def _numbers(self) -> list[str]:
        """The marks of the hops in the names of their unknowns."""
        return [f"_{i + 1}" if self.period > 1 else "" for i in range(self.period)]
