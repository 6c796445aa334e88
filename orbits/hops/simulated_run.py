"""A simulation while it runs: flights, impacts and contacts, one after the other, with their legs and events."""

import numpy as np

from ..errors import FlowError
from ..flow.first_events import FirstOf, first_zero
from ..flow.trajectory import Trajectory
from ..model.machine import Machine
from ..units import TIME, Message, Quantity
from .feet import LIFTS_OFF, STEPS_BACK, Exit, unheld
from .flyer import ROUNDING, hops_of_speeds, hops_of_states
from .footing import FALLS, SLIPS, FallTest
from .hand_over import landed
from .impacts import LIFTOFF_ORDER, STATUSES, Impacts, status_of_failure
from .launch_section import LaunchSection
from .schedule import Decisions, Feedback, Schedule
from .simulated import ContactEvent, Leg, Simulation

TOUCHING = 1e-9  # a gap, gap speed or contact force below this, relative to the state, is zero: rounding is smaller


class SimulatedRun:
    """The state of a simulation while it runs."""

    def __init__(
        self, impacts: Impacts, inject: float, hops: int | None, time: float, cap: int, inputs: Schedule,
        feedback: Feedback | None = None,
    ):  # fmt: skip
        self.decisions = Decisions(feedback) if feedback is not None else None
        self.impacts, self.inject, self.hops = impacts, inject, hops
        self.time, self.cap, self.inputs = time, cap, inputs
        self.legs, self.events, self.launches = list[Leg](), list[ContactEvent](), list[float]()
        self.now, self.impact_count, self.liftoff_count, self.reason = 0.0, 0, 0, ""
        self.launch: np.ndarray | None = None  # the state in which the hop began, where it began with a lift-off
        self.foot, self.stance = 0, 0  # the number of the foot that opens, and how many steps were taken
        self.foothold = 0.0  # the place along the ground from which that of what sticks is counted

    branch: int | None = None  # that of the leg, of a spring with hysteresis

    @property
    def machine(self) -> Machine:
        """The machine that is simulated."""
        return self.impacts.machine

    def simulate(
        self, x: np.ndarray, order: int | None, alpha: float | None, foot: int = 0, start: float = 0.0
    ) -> Simulation:
        """Alternate flights, from a zero of this order of the gap of a foot, and contacts, order None, up to the end's
        status; what sticks begins at the place `start`."""
        self.launches += [] if alpha is None else [alpha]
        self.foot, status = foot, None
        self.foothold = start
        if self.decisions and order == LIFTOFF_ORDER:
            self.decisions.lift_off(self.now)
        while status is None:
            if order is None:
                status, x = self.contact(x)
                order = self.order_of_liftoff(x)
            else:
                status, x, order = self.flight(x, order)
        launches = np.array(self.launches)
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, self.machine, self.reason)

    def flight(self, x: np.ndarray, order: int) -> tuple[str | None, np.ndarray, int | None]:
        """Fly until a gap closes: the status at an end, the state after the impact, and the order of the zero of the
        gap there that opens, None where contact follows."""
        until, closed = self.update_parameters(x), False
        self.launch = x if order == LIFTOFF_ORDER else self.launch
        last = self.now + float(self.impacts.longest_flight(x))
        if order == LIFTOFF_ORDER and not self.impacts.feet[self.foot].opens(x[None], self.impacts.p)[0]:
            return "no_launch", x, order
        while not closed:
            left, feet = min(self.time, last, until) - self.now, self.impacts.feet
            tests = [first_zero(each.gap, order * (i == self.foot)) for i, each in enumerate(feet)]
            tests += [FallTest(self.impacts.footing)] if self.impacts.footing.heights else []
            touches = FirstOf(*tests)
            try:
                path, _ = self.impacts.flight.run(x, self.impacts.p, left, stop=touches if tests[1:] else tests[0])
            except FlowError as error:
                self.reason = error.args[0]
                return status_of_failure(error, "flight"), x, order
            closed = path.times[-1] < left
            cut = not closed and until < min(self.time, last)
            ended = FALLS if touches.which == len(feet) else None if closed or cut else "carried_off"
            if status := self.add_leg("flight", path, ended, until if cut else None):
                return status, x, order
            x = path.end[: len(x)]
            self.foot = touches.which or 0
            closed |= bool(feet[self.foot].gap(x) <= 0)
            until, order = self.update_parameters(x), 0
        return self.land(x)

    def land(self, x: np.ndarray) -> tuple[str | None, np.ndarray, int | None]:
        """Land on the foot that touches, see `flight`."""
        impacts, name = self.impacts, self.impacts.feet[self.foot].name
        found = landed(impacts, x[None], np.array([self.foot]))
        (held,), (after,), (loss,), (wait,) = found.held, found.state, found.loss, found.wait
        (step,), ended, self.impact_count = found.step.tolist(), str(found.ended[0]), self.impact_count + 1
        if step and impacts.descends:  # on a slope the next foot stands lower
            label = impacts.model.relabelling
            before = (label.inverse if step > 0 else label)(after, impacts.values)
            loss += float(-np.diff(self.energies(np.array([before, after])))[0])
        self.add_event("landing" if held else "impact", x, after, float(loss), float(wait), name)
        self.foothold += sum(x[impacts.footing.sticks].tolist())
        if impacts.footing.slips_at_landing(x, float(self.legs[-1].path.times[-1])):
            return self.slip(after, " as it lands"), after, None
        self.stance, self.foot = self.stance + step, int(found.foot[0])
        self.reason = STATUSES[ended] if ended else self.reason
        if held:
            return ("undecided" if self.undecided() else None), after, None
        return (ended or ("cap" if self.impact_count >= self.cap else None)), after, int(found.order[0])

    def undecided(self) -> bool:
        """Whether rounding decides how the hop ends that has just landed, by the test of the map for its launch."""
        impacts, alpha = self.impacts, np.array(self.launches[-1:])
        if impacts.restitution < ROUNDING.many_bounces or self.launch is None:
            return False
        if not impacts.model.one_speed:
            if len(self.inputs.times) > 0 or self.branch is not None:
                return False  # such hops have no map
            return bool(hops_of_states(impacts, self.launch[None], self.cap).status[0] == "undecided")
        launched = (alpha > 0).any() and np.array_equal(impacts.launch(alpha)[0], self.launch)
        return bool(launched and self.statuses(alpha)[0] == "undecided")

    def statuses(self, alpha: np.ndarray) -> np.ndarray:
        """The statuses (m,) of the impacts of hops with launch speeds (m,)."""
        return hops_of_speeds(self.impacts, alpha, self.cap).status

    def contact(self, x: np.ndarray) -> tuple[str | None, np.ndarray]:
        """Stay in contact until lift-off: the status if the simulation ends, and the state after lift-off."""
        y, outcome = self.impacts.onto_contact @ x, None
        while outcome is None:
            until = self.update_parameters(self.impacts.model.embed @ y)
            path, outcome, self.reason = self.impacts.sustained_contact(y, min(self.time, until) - self.now)
            if path is None:
                return self.slip(self.impacts.model.embed @ y) if outcome == SLIPS else outcome, x
            cut = outcome is None and until < self.time
            ended = None if cut or outcome in (LIFTS_OFF, STEPS_BACK) else outcome
            if status := self.add_leg("contact", path, ended, until if cut else None):
                return self.slip(self.impacts.model.embed @ path.end[: len(y)]) if status == SLIPS else status, x
            y = path.end[: self.impacts.contact.size]
            self.update_parameters(self.impacts.model.embed @ y)
            if cut:  # The force may vanish by rounding, or because the new inputs make it vanish.
                tolerance = TOUCHING * (1 + np.abs(y).max())
                force, lifts_off = force_at_start(self.impacts, self.impacts.exits[0], y, self.impacts.p, tolerance)
                outcome = "lifts_off" if lifts_off or force <= 0 else None
        return self.liftoff(y, x, self.impacts.exits[int(outcome == STEPS_BACK)])

    def slip(self, x: np.ndarray, how: str = "") -> str:
        """The status of a foot that slips now, in a flight state, with the event and the reason."""
        self.add_event(SLIPS, x, x, 0.0)
        text = "the foot slips{how} at t = {time:.6g}: slipping is not simulated"
        self.reason = Message(text, how=how, time=Quantity(self.now, TIME))
        return SLIPS

    def liftoff(self, y: np.ndarray, x: np.ndarray, way: Exit | None = None) -> tuple[str | None, np.ndarray]:
        """Lift off from a contact state: the status at an end, and the flight state, `x` if an injection stops it."""
        impacts, driven = self.impacts, len(self.inputs.times) > 0
        before = after = impacts.model.embed @ y
        self.foot, name = (way.foot, impacts.feet[way.foot].name) if way else (0, "")
        if way and way.labels:
            after, self.stance = way.opened(before, impacts.values), self.stance - 1
            y = impacts.onto_contact @ after
        (speed,), (is_launch,) = impacts.liftoff(y[None])
        is_launch &= self.foot == 0
        if self.inject and not impacts.model.one_speed:
            (y,) = LaunchSection(impacts).injected(y[None], self.inject)
            if not np.isfinite(y).all():
                return "rests", x
            speed, after = float(speed) + self.inject, impacts.model.embed @ y
        # A driven machine lifts off where it is; without inputs its state is moved onto the launch set.
        if is_launch and not (driven and self.inject == 0):
            speed = float(speed) + self.inject
            if speed <= 0:
                return "rests", x
            after = impacts.launch(np.array([speed]))[0]
        self.add_event("lift-off", before, after, foot=name)
        has_speed = is_launch or driven or not impacts.model.one_speed
        self.launches.append(float(speed) if has_speed else np.nan)
        self.impact_count, self.liftoff_count = 0, self.liftoff_count + 1
        if self.decisions:
            self.decisions.lift_off(self.now)
        return ("done" if self.liftoff_count == self.hops else None), after

    def order_of_liftoff(self, x: np.ndarray) -> int:
        """The order of the gap's zero at lift-off: 2 where new inputs pull immediately, else `LIFTOFF_ORDER`."""
        pulls = len(self.inputs.times) > 0 and self.impacts.pressing(x[None])[0] < -TOUCHING * (1 + np.abs(x).max())
        return 2 if pulls else LIFTOFF_ORDER

    def update_parameters(self, x: np.ndarray) -> float:
        """Use the parameters that the schedule sets now, or a feedback by the flight state; returns the time until
        which they are in force."""
        if self.decisions and (inputs := self.decisions.at(self.now, x)):
            self.inputs = Schedule(self.machine, inputs)
        p, until = self.inputs(self.now)
        if (p != self.impacts.p).any():
            self.impacts = Impacts(self.impacts.machine, dict(zip(self.impacts.values, p.tolist(), strict=True)))
        return until

    def add_leg(self, phase: str, path: Trajectory, status: str | None, until: float | None = None) -> str | None:
        """Store a leg, which ends at `until` if not None; returns "done" at the end of the time, else `status`."""
        self.legs.append(Leg(phase, self.now, path, branch=self.branch, stance=self.stance, foothold=self.foothold))
        if phase == "flight":
            for when, kind in unheld(self.impacts.model, path, self.impacts.values):
                state = path(when)[: self.impacts.flight.size]
                self.add_event(kind, state, state, 0.0, when, "standing foot")
        lasted = float(path.times[-1])
        over = until is None and (lasted >= self.time - self.now or self.now + lasted >= self.time)
        self.now = self.time if over else self.now + lasted if until is None else until
        if status == FALLS and not over:
            embed, rows = self.impacts.model.embed, path.end
            x = rows[: len(embed)] if phase == "flight" else embed @ rows[: embed.shape[1]]
            name = self.impacts.footing.fallen(x, phase == "contact")
            self.add_event(FALLS, x, x, 0.0, foot=name)
            where = "" if name in self.impacts.footing.heights else ", while another point stands"
            text = "the {name} falls to the ground at t = {time:.6g}{where}"
            self.reason = Message(text, name=name, time=Quantity(self.now, TIME), where=where)
        return "done" if over else status

    def add_event(
        self, kind: str, before: np.ndarray, after: np.ndarray, loss: float | None = None, wait: float = 0.0,
        foot: str = "",
    ) -> None:  # fmt: skip
        """Store an event that happens `wait` after the end of the last leg, with the difference of the energies where
        its loss is not known."""
        first, *last = self.energies(np.array([before] if loss is not None else [before, after])).tolist()
        lost = loss if loss is not None else first - last[0]
        self.events.append(ContactEvent(kind, self.now + wait, before, after, first, lost, foot))

    def energies(self, x: np.ndarray) -> np.ndarray:
        """The energies (m,) of flight states (m, n)."""
        return self.impacts.energies(x)


def force_at_start(impacts: Impacts, way: Exit, y: np.ndarray, p: np.ndarray, tolerance: float) -> tuple[float, bool]:
    """The force of an exit in a contact state, and whether it is 0 up to a tolerance and falls, so that it opens."""
    path, _ = impacts.contact.run(y, p, tolerance)
    force, rise = way.force.series(path.coefficients)[0, :2]
    return float(force), bool(abs(force) <= tolerance and rise < 0)
