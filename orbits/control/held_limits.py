"""What an actuator can do, as bounds of the changes of its input that a feedback decides.

The bounds of power and of a force that falls with the speed are taken where the cycle is fastest within each interval,
with a margin, since disturbed motions are faster: what is decided then holds them whatever is measured.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any

import numpy as np

from ..errors import InputError, finite_number
from .held_cycle import Cycle, Linearised, Plan


@dataclass(frozen=True)
class HeldLimits:
    """Bounds of what acts; infinite where there is none.

    rate, stroke : of the rate of an actuator's state, and of a displacement
    force, power : of its force and its power on the machine, in both directions
    speed_force : (v0, F0): faster than v0 it does not drive, and at a speed v below with a force of F0 (1 - |v|/v0) at
        most
    """

    rate: float = np.inf
    stroke: float = np.inf
    force: float = np.inf
    power: float = np.inf
    speed_force: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.speed_force is not None and np.shape(self.speed_force) != (2,):
            raise InputError(
                f"speed_force = {self.speed_force!r}; it is two numbers, the speed at which no force is left to drive, "
                "and the force at rest"
            )
        numbers = [(name, getattr(self, name)) for name in ("rate", "stroke", "force", "power")]
        numbers = [each for each in numbers if not (isinstance(each[1], Real) and each[1] == np.inf)]
        for name, number in (*numbers, *(("speed_force", each) for each in self.speed_force or ())):
            if not finite_number(name, number) > 0:
                raise InputError(f"{name} = {number:g}: a bound of what acts is above 0")

    def stated(self) -> dict[str, Any]:
        """The bounds that there are."""
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

    def exceeded(self, force: np.ndarray, speed: np.ndarray, share: float = 1e-9) -> list[str]:
        """The names of the bounds that forces at speeds (k,) exceed."""
        power = force * speed
        found = {"force": bool((np.abs(force) > self.force * (1 + share)).any())}
        found["power"] = bool((np.abs(power) > self.power * (1 + share)).any())
        if self.speed_force is not None:
            v0, largest = self.speed_force
            line = largest * np.maximum(0.0, 1.0 - np.abs(speed) / v0)
            found["speed_force"] = bool((np.abs(force) > line * (1 + share) + share * largest)[power > 0].any())
        return [name for name, is_so in found.items() if is_so]


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
        at the instants (k + 1,), as the input begins."""
        low, high = float(self.low[i]), float(self.high[i])
        if np.isfinite(self.reach).any():
            begin, end, last = int(plan.begins[i]), int(plan.ends[i]), i + 1 == len(plan.begins)
            following = [*range(begin + 1, len(plan.times) if last else int(plan.begins[i + 1]) + 1)]
            following += [*range(1, int(plan.begins[0]) + 1)] if last else []
            for n in following:
                time = plan.times[min(n, end) if n > begin else end] - plan.times[begin]
                low = max(low, (-self.reach[n] - states[n] - off) / time)
                high = min(high, (self.reach[n] - states[n] - off) / time)
        return float(min(max(u, low), high)) if low <= high else 0.5 * (low + high)


def room_of(cycle: Cycle, plan: Plan, found: Linearised, limits: HeldLimits, margin: float) -> Room:
    """The room that limits leave; `margin` is the factor by which disturbed motions may be faster, or their springs
    harder, than the cycle."""
    k = len(plan.times)
    inputs = np.array([cycle.input_after(time) for time in plan.times[:-1]])
    low, high, reach = np.full(k - 1, -np.inf), np.full(k - 1, np.inf), np.full(k, np.inf)
    if cycle.kind == "displacement's rate":
        most = np.maximum(limits.speeds(margin * found.force), np.abs(inputs))
        low, high, reach[:] = -most - inputs, most - inputs, limits.stroke
    else:
        forces = limits.forces(margin * found.speed)
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


def limits_in(limits: HeldLimits, sizes: Mapping[str, float]) -> HeldLimits:
    """Limits divided by sizes of "rate", "stroke", "force", "power" and "speed"."""
    pair = limits.speed_force and (limits.speed_force[0] / sizes["speed"], limits.speed_force[1] / sizes["force"])
    own = {name: getattr(limits, name) / sizes[name] for name in ("rate", "stroke", "force", "power")}
    return HeldLimits(**own, speed_force=pair)
