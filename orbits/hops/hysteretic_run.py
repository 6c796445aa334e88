"""A simulation of a machine whose spring has hysteresis, while it runs: its legs end at reversals too."""

from typing import Any

import numpy as np

from ..errors import FlowError
from ..flow.first_events import FirstOf, first_zero
from ..flow.trajectory import Trajectory
from ..model.machine import Machine
from ..model.phase import Affine
from .footing import FALLS, FallTest
from .hysteresis import Branches, first_reversal
from .impacts import LIFTOFF_ORDER, TURNS, ContactStop, status_of_failure
from .simulated_run import SimulatedRun

SLIPPED = 1e-9  # a spring that sticks moves slower, relative to the state, where its constant force keeps it


class HystereticRun(SimulatedRun):
    """A simulation of a machine with hysteresis: its legs end at reversals of the spring too."""

    def __init__(self, branches: Branches, *arguments: Any):
        super().__init__(branches.first(), *arguments)
        self.branches = branches

    @property
    def machine(self) -> Machine:
        """The machine with hysteresis."""
        return self.branches.machine

    def energies(self, x: np.ndarray) -> np.ndarray:
        """The energies (m,) of flight states (m, n), by the mean law."""
        return self.branches.mean.energies(x)

    def flight(self, x: np.ndarray, order: int) -> tuple[str | None, np.ndarray, int | None]:
        """Fly until the gap closes, see `SimulatedRun.flight`."""
        self.launch = x if order == LIFTOFF_ORDER else self.launch
        last, held = self.now + float(self.impacts.longest_flight(x)), False
        (side, turning), turns = self.branches.branch(x), 0
        self.use(side, x)
        if order == LIFTOFF_ORDER and not self.impacts.opens(x[None])[0]:
            return "no_launch", x, order
        while not held:
            left = min(self.time, last) - self.now
            reverses = first_reversal(self.branches.rate, turning if side else None)
            stop = FirstOf(first_zero(self.impacts.gap, order), reverses, FallTest(self.impacts.footing))
            try:
                path, _ = self.impacts.flight.run(x, self.impacts.p, left, stop=stop)
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "flight"), x, order
            self.branches.check_width(path.coefficients[:, : len(x), 0])
            if not side and self.slips(path, len(x), self.branches.rate):
                return "lost", x, order
            closed = path.times[-1] < left and stop.which == 0
            ended = FALLS if stop.which == 2 else None if path.times[-1] < left else "carried_off"
            if status := self.add_leg("flight", path, ended):
                return status, x, order
            x, order = path.end[: len(x)], 0
            if held := closed or bool(self.impacts.gap(x) <= 0):
                continue
            if (turns := turns + 1) > self.cap:
                self.reason = f"its spring turned {self.cap} times in one flight"
                return "lost", x, order
            self.add_event("reversal", x, x, 0.0)
            side, turning = self.branches.branch(x)
            self.use(side, x)
        self.impacts = self.branches.of[int(self.branches.landed(x[None])[0])]
        (held,), (after,), (loss,), (wait,) = self.impacts.landing(x[None])
        self.impact_count += 1
        self.add_event("landing" if held else "impact", x, after, float(loss), float(wait))
        if held:
            self.impacts = self.branches.first()  # whose launches are those of the machine
            return ("undecided" if self.undecided() else None), after, None
        return ("cap" if self.impact_count >= self.cap else None), after, self.impacts.bounce_order

    def statuses(self, alpha: np.ndarray) -> np.ndarray:
        """The statuses (m,) of hops with launch speeds (m,)."""
        return self.branches.hops(alpha, self.cap)[2]

    def contact(self, x: np.ndarray) -> tuple[str | None, np.ndarray]:
        """Stay in contact until lift-off, see `SimulatedRun.contact`."""
        y, model, turns, endless = self.impacts.onto_contact @ x, self.branches.model, 0, self.time == np.inf
        while turns <= self.cap:
            side, turning = self.branches.branch(y, contact=True)
            # One coordinate that sticks is at rest, and after some turns it never lifts off, see `ContactStop`.
            if endless and model.one_speed and (not side or turns == TURNS):
                return "rests", x
            self.use(side, y, contact=True)
            impacts = self.impacts
            if turns and impacts.pressing((model.embed @ y)[None])[0] < 0:
                return self.liftoff(y, x)  # the force jumps at a reversal
            limit = impacts.longest_contact(y) if endless else self.time - self.now
            lifts = ContactStop(impacts, model.contact_speed if endless and model.one_speed else None)
            stop = FirstOf(lifts, first_reversal(self.branches.rate_in_contact, turning if side else None))
            try:
                path, _ = impacts.contact.run(y, impacts.p, limit, stop=stop)
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "contact"), x
            self.branches.check_width(path.coefficients[:, : impacts.contact.size, 0], contact=True)
            if not side and self.slips(path, impacts.contact.size, self.branches.rate_in_contact):
                return "lost", x
            never = "collapses" if np.abs(path.end).max() > limit else "rests"
            outcome = lifts.outcome if stop.which == 0 else never if stop.which is None and endless else None
            if status := self.add_leg("contact", path, None if outcome == "lifts_off" else outcome):
                return status, x
            y = path.end[: impacts.contact.size]
            if outcome == "lifts_off":
                return self.liftoff(y, x)
            x, turns = model.embed @ y, turns + 1
            self.add_event("reversal", x, x, 0.0)
        self.reason = f"its spring turned {self.cap} times in one contact"
        return "lost", x

    def use(self, side: int, state: np.ndarray, contact: bool = False) -> None:
        """Go on with the impacts of a branch, or with those of the spring that sticks."""
        self.branch, self.impacts = side, self.branches.on(side, state, contact)

    def slips(self, path: Trajectory, size: int, rate: Affine) -> bool:
        """Whether a phase with a spring that sticks and a constant force is not its motion, with the reason."""
        states = path.coefficients[:, :size, 0]
        if np.abs(rate(states)).max() <= SLIPPED * (1 + np.abs(states).max()):
            return False
        self.reason = "its spring sticks while the force that keeps it changes, which is not followed"
        return True
