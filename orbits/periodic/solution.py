"""Solved orbits of one model as arrays, on their way from the equations to their certificates."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..flow.trajectory import Trajectories

# Marks a minimum, a peak or a time that does not exist.
NONE = np.inf


@dataclass(frozen=True, eq=False)
class Solution:
    """Solved orbits (m) of one model, and what they mean for the flight.

    u, p : unknowns and parameters by name, (m,) each
    flight : the first halves, in flight states; whole flights where nothing mirrors them
    halves : of each flight the motion from lift-off to its middle and, where that is not its mirror image, the one from
        landing backwards
    gap_slope : (m,), derivative with respect to alpha of the gap at the orbit's landing time
    residual, error : (m,), the largest residual of the equations, and the bound on the error of alpha
    """

    u: Mapping[str, np.ndarray]
    p: Mapping[str, np.ndarray]
    flight: Trajectories
    halves: Trajectories
    gap_slope: np.ndarray
    residual: np.ndarray
    error: np.ndarray


@dataclass(frozen=True, eq=False)
class Cycles(Solution):
    """Solved orbits with their contacts.

    with_contact : (k,), the orbits whose contact ends; `contacts` are theirs, each up to its middle or, where nothing
        mirrors it, up to lift-off
    without_contact : by index of the others, the reason why their contact does not end
    """

    with_contact: np.ndarray
    contacts: Trajectories | None
    without_contact: Mapping[int, str]

    def __len__(self) -> int:
        return len(self.error)

    @property
    def halves_per_flight(self) -> int:
        """How many of the `halves` belong to each flight: 1 where the other one is its mirror image, else 2."""
        return len(self.halves) // len(self)

    @cached_property
    def flight_times(self) -> np.ndarray:
        """Times (m,) of whole flights."""
        return self.halves.ends.reshape(len(self), -1).sum(1) * (2 if self.halves_per_flight == 1 else 1)

    @cached_property
    def contact_times(self) -> np.ndarray:
        """Times (m,) of whole contacts, `NONE` for those that do not end."""
        times = np.full(len(self), NONE)
        if self.contacts:
            times[self.with_contact] = self.contacts.ends * (2 if self.halves_per_flight == 1 else 1)
        return times

    @cached_property
    def p_of_halves(self) -> Mapping[str, np.ndarray]:
        """The parameters of each of the `halves`."""
        return {name: np.repeat(values, self.halves_per_flight) for name, values in self.p.items()}

    @cached_property
    def p_of_contacts(self) -> Mapping[str, np.ndarray]:
        """The parameters of each of the `contacts`."""
        return {name: values[self.with_contact] for name, values in self.p.items()}


def columns(values: Iterable) -> np.ndarray:
    """The array (m, n) of n values, each (m,) or one number for all m; at least one is an array."""
    values = list(values)
    array = np.empty((next(len(value) for value in values if np.ndim(value)), len(values)))
    for i, value in enumerate(values):
        array[:, i] = value
    return array


def vector(p: Mapping[str, float]) -> np.ndarray:
    """The values of parameters by name, in their order."""
    return np.array(list(p.values()), dtype=float)


def or_none(values: np.ndarray) -> list[float | None]:
    """Numbers (m,), with None for `NONE`."""
    return [None if value == NONE else value for value in values.tolist()]
