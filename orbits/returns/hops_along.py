"""The machines along one of their parameters, or the injection, whose hops have a statement."""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from ..hops import Impacts, LaunchSection
from ..model import Machine
from ..units import LIFTOFF_SPEED
from .flown_hops import flown_hops
from .hop_statement import Array, HopEquations, Word, hop_equations

INJECT = "inject"  # the parameter of maps in addition to those of the machine
DIFFERENCE = 1e-5  # of a parameter, relative, for the derivative of the unit of speed


class HopsAlong:
    """The machines along one of their parameters, or the injection, whose hops have a statement.

    machine : at some value of the parameter
    free : names of the free numbers of a launch
    impacts_at : value -> the impacts of the machine there
    """

    def __init__(
        self, machine: Machine, name: str, inject: float, span: float, free: tuple[str, ...],
        impacts_at: Callable[[float], Impacts],
    ):  # fmt: skip
        self.machine, self.model, self.name, self.inject, self.span = machine, machine.model, name, inject, span
        self.names, self.free, self.impacts_at = tuple(machine.values), free, impacts_at

    def hop(self, count: int) -> HopEquations:
        """The equations of a hop."""
        return hop_equations(self.model, count, self.names, self.free)

    def units(self, values: Array) -> tuple[Array, Array]:
        """The units (m,) of speed at values (m,) of the parameter and their derivatives."""
        if self.model.units is None:
            return np.ones(len(values)), np.zeros(len(values))
        step, units = DIFFERENCE * np.maximum(np.abs(values), DIFFERENCE * self.span), self.model.units
        low, here, high = (
            np.broadcast_to(units({**self.machine.values, self.name: v}).of(LIFTOFF_SPEED), len(values))
            for v in (values - step, values, values + step)
        )
        return here, (high - low) / (2 * step)

    def parameters_at(self, values: Array) -> Array:
        """The parameters (m, np) of the machine at values (m,)."""
        ps = np.tile([*self.machine.values.values()], (len(values), 1))
        if self.name != INJECT:
            ps[:, self.names.index(self.name)] = values
        return ps

    @cached_property
    def places(self) -> list[int]:
        """The places of the free numbers of a launch in contact states."""
        return [self.model.launch_places[name] for name in self.free]

    def starts(self, impacts: Impacts, launches: Array) -> Array:
        """The flight states (m, n) at launches (m, d) without units, NaN where there is none."""
        if self.model.one_speed:
            return impacts.launch(launches[:, 0])
        return LaunchSection(impacts).states(launches) @ self.model.embed.T

    def flown(self, launches: Array, value: float, period: int) -> tuple[Word, Array] | None:
        """The word and the unknowns of hops from launches (h, d) without units, of all hops or of the first one; None
        where one has no next launch."""
        impacts, (unit, _) = self.impacts_at(value), self.units(np.array([value]))
        added = (value if self.name == INJECT else self.inject) / float(unit[0])
        word, us, known, speed = list[int](), list[Array](), [*launches], self.free.index("alpha")
        for hop in range(period):
            start = self.starts(impacts, np.array(known[hop : hop + 1]))
            if not np.isfinite(start).all():
                return None
            hops = flown_hops(impacts, known[hop][speed : speed + 1], starts=start)
            if not hops.counts[0]:
                return None
            word.append(int(hops.counts[0]))
            us.append(hops.unknowns(impacts, np.zeros(1, int))[0])
            if hop + 1 == len(known):
                known.append(hops.ends[0, self.places] + added * (np.arange(len(self.free)) == speed))
            if not known[-1][speed] > 0:
                return None
        return tuple(word), np.concatenate(us)
