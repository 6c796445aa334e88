"""A machine whose spring has hysteresis, as ordinary machines between the reversals of the spring.

While the extension grows, the machine has the law of one branch; while it shrinks, the law of the other. Where the rate
of the extension vanishes, the other branch holds if it moves the extension on. If neither branch does, the spring
sticks: its force lies between the branches and keeps its extension.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..flow import Watch, first_zero
from ..laws import LARGEST_CROSSING, from_formula, from_key
from ..mechanics import Mechanism, Spring
from ..model import Affine, refuse_steps
from .impacts import Impacts


class HysteresisOptions(NamedTuple):
    """When a spring turns or sticks, and by how much its branches may cross, which feeds energy to the motion."""

    turning: float = 1e-13  # a rate of the extension below this, relative to the state, is that of a reversal
    rounding: float = 1e-9  # all branches may cross by this share of the accelerations
    samples: int = 513  # of the width of a loop between the ends of its branches


HYSTERESIS = HysteresisOptions()


class Branches:
    """The impacts and contacts of a machine with hysteresis on each of its branches, by the sign of the rate.

    model, restitution : of the machine itself, which is not conservative
    of : the `Impacts` while the extension grows (1) and while it shrinks (-1)
    rates : of the extension, as functions of the flight and the contact state
    mean : the `Impacts` of the mean law, by which the energy is counted
    """

    never_lose = False  # as of `Impacts`

    def __init__(self, machine: Any):
        self.machine, self.model, self.restitution = machine, machine.model, float(machine.restitution)
        refuse_steps(self.model, "a spring with hysteresis")
        if not hasattr(machine, "stated"):
            raise InputError(f"the {self.model.name} has a spring with hysteresis: state it as a Mechanism")
        stated: Mechanism = replace(machine.stated(), restitution=machine.restitution)
        springs = [each.force for each in stated.elements if isinstance(each, Spring)]
        (self._key,) = (key for key in springs if key.branches)
        self._springs, self._stated, p = springs, stated, stated.parameters
        self.of = dict(zip((1, -1), (self._with(from_key(key, p)) for key in self._key.branches), strict=True))
        weights = self.model.hysteretic
        self.rates = Affine(tuple(weights)), Affine(tuple((np.array(weights) @ self.model.embed).tolist()))

    def _with(self, law: Any) -> Impacts:
        """The impacts of the machine with another law of its spring."""
        return Impacts(self._stated.with_springs([law if key.branches else key for key in self._springs]))

    @cached_property
    def mean(self) -> Impacts:
        """The impacts with the mean law, by which the energy is counted."""
        return self._with(from_key(self._key._replace(branches=None), self._stated.parameters))

    @cached_property
    def _pulls(self) -> tuple[Impacts, Impacts]:
        """The machine without a force of its spring, and with the force 1."""
        return self._with(from_formula("0*r", "r")), self._with(from_formula("1", "r"))

    def branch(self, x: np.ndarray, contact: bool = False) -> tuple[int, int]:
        """The branch that holds from a flight or a contact state on, 0 where the spring sticks; and the order of the
        rate's zero there."""
        (side,), (order,) = self.branches(x[None], contact)
        return int(side), int(order)

    def branches(self, x: np.ndarray, contact: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """`branch` at several states (m, n): branches (m,) and orders (m,)."""
        rate = self.rates[contact](x)
        still = np.abs(rate) <= HYSTERESIS.turning * (1 + np.abs(x).max(1))
        side = np.where(rate > 0, 1, -1)
        if still.any():
            growing, shrinking = (self._turns(self.of[sign], x[still], contact) for sign in (1, -1))
            self.check_width(x[still], contact)
            side[still] = np.where(growing > 0, 1, np.where(shrinking < 0, -1, 0))
        return side, still.astype(int)

    def _turns(self, impacts: Impacts, x: np.ndarray, contact: bool) -> np.ndarray:
        """The second derivatives (m,) of the extension on a branch at states (m, n)."""
        flow, rate = impacts.contact if contact else impacts.flight, self.rates[contact]
        return flow.field(x, impacts.p)[0] @ np.array(rate.weights)

    def check_width(self, x: np.ndarray, contact: bool = False) -> None:
        """Raise `InputError` where the branches are crossed at flight or contact states (m, n)."""
        growing, shrinking = (self._turns(self.of[sign], x, contact) for sign in (1, -1))
        free, pulled = (self._turns(each, x, contact) for each in self._pulls)
        gain = (growing - shrinking) / (free - pulled) if self._noise else growing - shrinking
        if (gain > self._noise + HYSTERESIS.rounding * (np.abs(growing) + np.abs(shrinking))).any():
            raise InputError(
                "the branches of the spring with hysteresis cross: the motion reaches extensions where the force is "
                "larger while the spring shortens, which would add energy; exchange the branches, state them as far "
                "as they go, or use the law's `.mean`"
            )

    @cached_property
    def _noise(self) -> float:
        """The largest force by which measured branches may cross; 0 for branches that are not bounded."""
        laws = [from_key(key, self._stated.parameters) for key in self._key.branches]
        low, high = max(law.range()[0] for law in laws), min(law.range()[1] for law in laws)
        if not np.isfinite(high - low):
            return 0.0
        places = np.linspace(low, high, HYSTERESIS.samples)
        return LARGEST_CROSSING * float(np.abs(laws[0](places) - laws[1](places)).max())

    def on(self, side: int, x: np.ndarray, contact: bool = False) -> Impacts:
        """The impacts on a branch, as `branch` has it from a flight or a contact state on."""
        return self.of[side] if side else self.stuck(x, contact)

    def stuck(self, x: np.ndarray, contact: bool = False) -> Impacts:
        """The machine while its spring sticks, with the force that keeps the extension of a flight or contact state."""
        free, pulled = (float(self._turns(each, x[None], contact)[0]) for each in self._pulls)
        return self._with(from_formula("stuck_force", "r", {"stuck_force": free / (free - pulled)}))

    def first(self, state: np.ndarray | None = None) -> Impacts:
        """The branch on which a motion from a flight state begins, by default the one on which launches are."""
        if state is not None:
            return self.of[self.branch(state)[0] or 1]
        forward = not self.model.one_speed or self.rates[False](self.of[1].launch(np.ones(1))[0]) >= 0
        return self.of[1 if forward else -1]

    def landed(self, x: np.ndarray) -> np.ndarray:
        """The branches (m,) that hold after plastic impacts at flight states (m, n)."""
        stuck = x - (x @ self.of[1].gap_speed)[:, None] * self.of[1].direction(x)
        return np.where(self.rates[False](stuck) >= 0, 1, -1)

    @cached_property
    def watches(self) -> dict[tuple[int, bool], Watch]:
        """What the phases of a branch are watched for, by its sign and whether it is contact: the gap or the contact
        force, and the rate, unless that vanishes throughout."""
        found = {}
        for side, impacts in self.of.items():
            for contact, flow in enumerate((impacts.flight, impacts.contact)):
                rates = [each for each in [self.rates[contact]] if any(each.weights)]
                functions = [impacts.contact_force if contact else impacts.gap, *rates]
                found[side, bool(contact)] = Watch(flow, functions, len(functions))
        return found


def first_reversal(rate: Affine, order: int | None) -> Callable:
    """A test for the first zero of the rate, which has a zero of this order at the start; None for a rate that vanishes
    throughout, in which none is searched."""
    if order is None or not any(rate.weights):
        return lambda coefficients, steps: None
    return first_zero(rate, order)
