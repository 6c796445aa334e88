"""How a simulation continues, hop after hop: the parameters in force, and the injection at each lift-off."""

from dataclasses import dataclass

import numpy as np

from .impacts import LIFTOFF_ORDER, Impacts
from .launch_section import LaunchSection
from .points_of_contact import Exit
from .schedule import Decisions, Schedule


@dataclass(eq=False)
class Course:
    """The course of a simulation of one motion.

    lift_offs, time : it ends after this number of lift-offs, None for any, and at this time
    inject : added to the speed at each launch
    schedule, decisions : the parameters in force, and the feedback that decides on them, if any
    speed, launch : those of the launch of this hop, NaN and None where it did not begin with one
    count : the number of lift-offs so far
    """

    lift_offs: int | None
    time: float
    inject: float
    schedule: Schedule
    decisions: Decisions | None = None
    speed: float = np.nan
    launch: np.ndarray | None = None
    count: int = 0

    @property
    def driven(self) -> bool:
        """Whether parameters change in time."""
        return len(self.schedule.times) > 0

    def rules(self, now: float, x: np.ndarray, impacts: Impacts) -> tuple[Impacts, float]:
        """The impacts in force from now on, in a flight state (n,), and the time until which they are."""
        if self.decisions and (inputs := self.decisions.at(now, x)):
            self.schedule = Schedule(impacts.machine, inputs)
        p, until = self.schedule(now)
        if (p != impacts.p).any():
            impacts = Impacts(impacts.machine, dict(zip(impacts.values, p.tolist(), strict=True)))
        return impacts, until

    def lifted(self, impacts: Impacts, now: float, x: np.ndarray, way: Exit) -> tuple[np.ndarray, int] | None:
        """The flight state (n,) after a lift-off in a flight state (n,), with the injection, and the order of the zero
        of the gap there; None where the injection stops the machine."""
        model, after = impacts.model, way.opened(x, impacts.values)
        y = impacts.onto_contact @ after
        ((speed,), (is_launch,)) = impacts.liftoff(y[None])
        is_launch = bool(is_launch) and way.foot == 0
        if self.inject and not model.one_speed:
            (y,) = LaunchSection(impacts).injected(y[None], self.inject)
            if not np.isfinite(y).all():
                return None
            speed, after = speed + self.inject, model.embed @ y
        # A driven machine lifts off where it is; without inputs its state is moved onto the launch set.
        if is_launch and not (self.driven and self.inject == 0):
            speed = speed + self.inject
            if speed <= 0:
                return None
            (after,) = impacts.launch(np.array([speed]))
        self.speed = float(speed) if is_launch or self.driven or not model.one_speed else np.nan
        self.launch, self.count = None, self.count + 1
        if self.decisions:
            self.decisions.lift_off(now)
        # New inputs may pull immediately, and so may the end of the force along the ground on one of two feet.
        tolerance = impacts.options.touching * (1 + np.abs(after).max())
        pulls = self.driven and impacts.pressing(after[None])[0] < -tolerance
        if model.grazes:
            pulls |= impacts.flight.field(after[None], impacts.p)[0][0] @ impacts.feet[way.foot].speed > tolerance
        return after, 2 if pulls else LIFTOFF_ORDER
