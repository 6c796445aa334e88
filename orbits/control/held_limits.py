"""The limits of an actuator, as bounds of the changes of its input that a feedback decides.

The bounds of power, and of a force that falls with the speed, apply where the cycle is fastest within each interval,
with a margin, since disturbed motions are faster. A motion that is faster than the margin allows may exceed them;
`HeldLimits.exceeded` reports this.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, finite_number
from .held_cycle import Cycle, Linearised, Plan


@dataclass(frozen=True)
class HeldLimits:
    """Bounds of the actuator; infinite where there is none.

    rate, stroke : of the rate of an actuator's state, and of a displacement
    force, power : of its force and its power on the machine, in both directions
    speed_force : (v0, F0): the actuator does not drive at speeds above v0; at a speed v below, its force is at most F0
        (1 - |v|/v0)
    """

    rate: float = np.inf
    stroke: float = np.inf
    force: float = np.inf
    power: float = np.inf
    speed_force: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.speed_force is not None:
            object.__setattr__(self, "speed_force", _speed_and_force(self.speed_force))
        numbers = [(name, getattr(self, name)) for name in ("rate", "stroke", "force", "power")]
        numbers = [each for each in numbers if not (isinstance(each[1], Real) and each[1] == np.inf)]
        for name, number in numbers:
            if not finite_number(name, number) > 0:
                raise InputError(f"{name} = {number:g}; a bound of the actuator must be above 0")

    def stated(self) -> dict[str, Any]:
        """The finite bounds."""
        return {name: x for name, x in asdict(self).items() if x is not None and x != np.inf}

    def forces(self, speed: np.ndarray) -> np.ndarray:
        """The largest forces at speeds."""
        with np.errstate(divide="ignore"):
            found = np.minimum(self.force, self.power / np.abs(speed))
        if self.speed_force is not None:
            v0, largest = self.speed_force
            found = np.minimum(found, largest * np.maximum(0.0, 1.0 - np.abs(speed) / v0))
        return found

    def speeds(self, force: np.ndarray) -> np.ndarray:
        """The largest speeds of a spring's end at forces in the spring."""
        with np.errstate(divide="ignore"):
            found = np.minimum(self.rate, self.power / np.abs(force))
        if self.speed_force is not None:
            v0, largest = self.speed_force
            found = np.minimum(found, v0 * np.maximum(0.0, 1.0 - np.abs(force) / largest))
        return found

    def shares(self, of: "Demand", rounding: float = 1e-9) -> dict[str, float]:
        """The largest share of each bound that a motion takes, by name; above 1 it exceeds the bound."""
        power = of.force * of.speed
        found = {
            name: float(np.abs(each).max(initial=0.0)) / getattr(self, name)
            for name, each in (("rate", of.rate), ("stroke", of.stroke), ("force", of.force), ("power", power))
        }
        if self.speed_force is not None:
            v0, largest = self.speed_force
            drives = (power > 0) & (np.abs(of.force) > rounding * largest)
            line = np.abs(of.force) / largest + np.abs(of.speed) / v0
            found["speed_force"] = float(line[drives].max(initial=0.0))
        return found

    def exceeded(self, of: "Demand", share: float = 1e-6) -> list[str]:
        """The names of the bounds that a motion exceeds by more than a share."""
        return [name for name, taken in self.shares(of).items() if taken > 1 + share]


def _speed_and_force(stated: Any) -> tuple[float, float]:
    """The bound of the force by the speed; raises `InputError` for an invalid one."""
    if not isinstance(stated, tuple | list) or len(stated) != 2:
        text = "the speed at which the driving force vanishes, and the force at rest"
        raise InputError(f"speed_force = {stated!r}; it must be two numbers, {text}")
    speed, force = (finite_number("speed_force", each) for each in stated)
    if not (speed > 0 and force > 0):
        raise InputError(f"speed_force = ({speed:g}, {force:g}): both numbers must be above 0")
    return speed, force


class Demand(NamedTuple):
    """What a motion asks of an actuator.

    force, speed : (k,) at the same instants
    rate, stroke : (m,) and (l,), the rates of the actuator's state and its displacements; empty where it has none
    """

    force: np.ndarray
    speed: np.ndarray
    rate: np.ndarray = np.empty(0)
    stroke: np.ndarray = np.empty(0)

    @classmethod
    def of(cls, kind: str, force: np.ndarray, speed: np.ndarray, inputs: np.ndarray, states: np.ndarray) -> "Demand":
        """That of a motion with these inputs (m,) and flight states (l, n), where the input is of a kind of `Cycle`."""
        none = np.empty(0)
        moves = kind == "displacement's rate"
        return cls(force, speed, none if kind == "force" else inputs, states[:, -1] if moves else none)


@dataclass(frozen=True)
class Room:
    """The room of the changes of inputs.

    low, high : (N,) of each
    reach : (k + 1,) of an actuator's state at the instants
    """

    low: np.ndarray
    high: np.ndarray
    reach: np.ndarray

    def cut(self, i: int, u: float, plan: Plan, states: np.ndarray, off: float) -> float:
        """The change of an input within its room, where the actuator's state is `off` that of the cycle, which it is
        at the instants (k + 1,), as the input begins. Where no input keeps the state within reach, that of the room
        which brings it nearest."""
        low, high = float(self.low[i]), float(self.high[i])
        if np.isfinite(self.reach).any():
            begin, end, last = int(plan.begins[i]), int(plan.ends[i]), i + 1 == len(plan.begins)
            following = [*range(begin + 1, len(plan.times) if last else int(plan.begins[i + 1]) + 1)]
            following += [*range(1, int(plan.begins[0]) + 1)] if last else []
            for n in following:
                time = plan.times[min(n, end) if n > begin else end] - plan.times[begin]
                low = max(low, (-self.reach[n] - states[n] - off) / time)
                high = min(high, (self.reach[n] - states[n] - off) / time)
        wanted = min(max(u, low), high) if low <= high else 0.5 * (low + high)
        return float(min(max(wanted, float(self.low[i])), float(self.high[i])))


def room_of(cycle: Cycle, plan: Plan, found: Linearised, limits: HeldLimits, margin: float) -> Room:
    """The room that limits leave; `margin` is the factor by which disturbed motions may be faster, or their springs
    harder, than the cycle."""
    k = len(plan.times)
    inputs = np.array([cycle.input_after(time) for time in plan.times[:-1]])
    low, high, reach = np.full(k - 1, -np.inf), np.full(k - 1, np.inf), np.full(k, np.inf)
    if cycle.kind == "displacement's rate":
        most = np.maximum(limits.speeds(margin * np.abs(found.force).max(1)), np.abs(inputs))
        low, high, reach[:] = -most - inputs, most - inputs, limits.stroke
    else:
        forces = limits.forces(margin * np.abs(found.speed).max(1))
        if cycle.kind == "force":
            low, high = -forces, forces
        else:
            most = np.maximum(limits.rate, np.abs(inputs))
            low, high = -most - inputs, most - inputs
            reach[:-1], reach[1:] = forces, np.minimum(reach[1:], forces)
    own = np.abs(found.states[:, -1]) if cycle.kind != "force" else 0.0
    pairs = [*zip(plan.begins.tolist(), plan.ends.tolist(), strict=True)]
    lows, highs = (np.array([of(each[a:b]) for a, b in pairs]) for of, each in ((np.max, low), (np.min, high)))
    return Room(lows, highs, np.maximum(reach, own))


def refuse_what_the_cycle_exceeds(cycle: Cycle, found: Linearised, limits: HeldLimits, bare: HeldLimits) -> None:
    """Raise `InputError` where the cycle itself exceeds a limit, with what it needs in the units of `limits`."""
    if cycle.kind != "displacement's rate" and np.isfinite(limits.stroke):
        raise InputError(
            f"stroke = {limits.stroke:g}: it bounds the displacement of a spring's end, but the actuator is a force; "
            "leave it out"
        )
    of = Demand.of(cycle.kind, found.force.ravel(), found.speed.ravel(), cycle.inputs, found.states)
    shares = bare.shares(of)
    for name in bare.exceeded(of):
        bound, share = getattr(limits, name), shares[name]
        needs = f"{share:.4g} times this force at its speeds" if name == "speed_force" else f"{share * bound:.4g}"
        raise InputError(
            f"{name} = {bound}: the hop itself needs {needs}; widen the bound, or keep a hop within it: "
            f"keep_hopping(..., {name}={bound})"
        )


def limits_in(limits: HeldLimits, sizes: Mapping[str, float]) -> HeldLimits:
    """Limits divided by sizes of "rate", "stroke", "force", "power" and "speed"."""
    pair = limits.speed_force and (limits.speed_force[0] / sizes["speed"], limits.speed_force[1] / sizes["force"])
    own = {name: getattr(limits, name) / sizes[name] for name in ("rate", "stroke", "force", "power")}
    return HeldLimits(**own, speed_force=pair)
