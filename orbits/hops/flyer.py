"""The one loop that flies motions, in lanes: arcs of flight and contact, and the events between them.

An arc ends at the first event of its phase: the gap of a foot closes, the contact force vanishes, a spring with
hysteresis reverses, or the machine falls or slips. A reset follows: an impact, a lift-off, or another branch of the
spring. Maps, simulations and multipliers are views of it: maps of the states in which hops end, simulations of their
arcs, and multipliers of the growth of small changes along these.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import FlowError
from ..flow import Events, StopTest, Trajectory, Watch, first_events, recorded_event
from .arcs import BRIEF, Arcs, Flown, Phase, Rules
from .hand_over import Landed, impulses, landed
from .hop_inputs import Course
from .hysteresis import Branches, first_reversal
from .impacts import CAP, LIFTOFF_ORDER, STATUS, STATUSES, status_of_failure
from .points_of_contact import LIFTS_OFF, REVERSES, STEPS_BACK, Exit
from .sticking_contact import FALLS, SLIPS, FallTest

CUT, DONE = "cut", "done"  # how an arc ends where other parameters come into force, or the time of a simulation is over


class Rounding(NamedTuple):
    """Where rounding decides how a hop ends.

    many_bounces : from this restitution on, the end is compared with that of a neighbouring launch
    neighbour : whose speeds are larger by this share, beyond the roundings of a flight
    parted : states that differ by a larger share belong to other motions
    first_repetition, repetition : from this number of impacts on, a motion that comes back to an earlier state, up to
        this share, repeats itself
    """

    many_bounces: float = 0.5
    neighbour: float = 1e-14
    parted: float = 1e-4
    first_repetition: int = 32
    repetition: float = 1e-13


ROUNDING = Rounding()


class Flyer:
    """Flies motions by the rules of their machine.

    cap : a hop is abandoned after this number of impacts
    after_impact : called with states (m, n), which are constant in contact, and losses (m,)
    thorough : whether slip and the fall of any height end a motion too, which is then followed alone
    course : of a simulation of one motion; None for hops up to sustained contact, or through it
    undecided : (course, rules, cap) -> whether rounding decides how the hop ends that has just landed
    """

    def __init__(
        self, rules: Rules, hops: Flown, cap: int = CAP, after_impact: Callable | None = None, *,
        thorough: bool = False, course: Course | None = None, undecided: Callable | None = None,
    ):  # fmt: skip
        self.hops, self.cap, self.after_impact, self.thorough, self.course = hops, cap, after_impact, thorough, course
        self.branches = rules if isinstance(rules, Branches) else None
        self.impacts = rules.first()  # those in force, of a spring with hysteresis those of launches
        self.undecided, self.time, self.until = undecided, course.time if course else np.inf, np.inf

    @property
    def endless(self) -> bool:
        """Whether phases may take any time, so that rest is an end."""
        return self.time == self.until == np.inf

    def to_contact(self) -> None:
        """Fly up to sustained contact, with the status "lifts_off", or to another end."""
        self._fly(contacts=False)
        self.hops.status[(self.hops.status == "") & self.hops.on_ground] = LIFTS_OFF

    def fly(self) -> None:
        """Fly to the ends of hops, also of those up to sustained contact; or to the end of a simulation."""
        self.hops.status[(self.hops.status == LIFTS_OFF) & self.hops.on_ground] = ""
        self._fly(contacts=True)

    def _fly(self, contacts: bool) -> None:
        hops, impact = self.hops, 0
        earlier, compared = np.full_like(hops.states, np.nan), ROUNDING.first_repetition
        while len(lanes := np.flatnonzero((hops.status == "") & (contacts | ~hops.on_ground))):
            self._update(lanes)
            down = hops.on_ground[lanes]
            for phase, own in self._phases(lanes[~down], False):
                self._flights(own, phase)
            if self.after_impact:
                self.after_impact(hops.states, hops.loss)
            for phase, own in self._phases(lanes[down], True):
                self._contacts(own, phase)
            if impact >= ROUNDING.first_repetition and not self.course and not self.branches:
                # Motions that repeat themselves, as on a heavy hand, have impacts without end.
                here, there = hops.states[lanes], earlier[lanes]
                repeats = np.abs(here - there).max(1) <= ROUNDING.repetition * np.abs(here).max(1)
                again = lanes[repeats & ~hops.on_ground[lanes] & (hops.status[lanes] == "")]
                hops.impacts[again], hops.status[again] = self.cap, "cap"
                if impact == compared:  # as in Brent's method for cycles
                    earlier, compared = hops.states.copy(), 2 * compared
            impact += 1

    def _phases(self, lanes: np.ndarray, contact: bool) -> Iterator[tuple[Phase, np.ndarray]]:
        """The phases of motions (k,), with those in each: on each branch of the spring, and alone where it sticks."""
        hops, branches = self.hops, self.branches
        if not branches:
            if len(lanes):
                yield Phase(contact, self.impacts, 1), lanes
            return
        states = Phase(contact, branches.of[1], 1).states(hops.states[lanes])
        side, hops.turning[lanes] = branches.branches(states, contact)
        for sign in (1, -1):
            if (own := lanes[side == sign]).size:
                yield Phase(contact, branches.of[sign], sign), own
        for i in np.flatnonzero(side == 0).tolist():
            yield Phase(contact, branches.stuck(states[i], contact), 0), lanes[[i]]

    def _update(self, lanes: np.ndarray) -> None:
        """Use the rules that are in force now, in a simulation whose parameters change."""
        if self.course and not self.branches and (self.course.driven or self.course.decisions):
            (now,), (x,) = self.hops.now[lanes].tolist(), self.hops.states[lanes]
            self.impacts, self.until = self.course.rules(now, x, self.impacts)

    def _watch(self, phase: Phase) -> Watch:
        """What a phase is watched for."""
        if self.branches and phase.side:
            return self.branches.watches[phase.side, phase.contact]
        if not phase.contact:
            return phase.impacts.flight_watch
        return phase.impacts.contact_watch if self.endless else phase.impacts.timed_watch

    def _orders(self, lanes: np.ndarray, watch: Watch, orders: np.ndarray) -> np.ndarray:
        """The orders (k, opening) of the zeros at the start: of gaps or forces (k, ·) and, where it is watched, of the
        rate of the spring."""
        return np.append(orders, self.hops.turning[lanes, None], 1)[:, : watch.opening] if self.branches else orders

    def _events(
        self, phase: Phase, starts: np.ndarray, limit: np.ndarray | float, orders: np.ndarray,
        stops: Sequence[StopTest] = (),
    ) -> tuple[Events, Trajectory | None]:  # fmt: skip
        """The first events from states (m, k) of a phase; of a simulation with the path."""
        wanted = phase.flow, starts, phase.impacts.p, self._watch(phase), limit, orders
        return recorded_event(*wanted, stops) if self.course else (first_events(*wanted, stops=stops), None)

    def _left(self, lanes: np.ndarray) -> np.ndarray | float:
        """The times (k,) up to the end of the simulation, or of the parameters in force."""
        return np.inf if self.endless else min(self.time, self.until) - self.hops.now[lanes]

    def _arrive(
        self, lanes: np.ndarray, phase: Phase, durations: np.ndarray, ends: np.ndarray, kind: str = "",
        status: str = "", path: Trajectory | None = None,
    ) -> None:  # fmt: skip
        """Go on to the ends of arcs, flight states (k, n), and record them, with the path of a single motion."""
        hops = self.hops
        if hops.record and len(lanes):
            begun, starts = hops.now[lanes], hops.states[lanes]
            hops.arcs.append(Arcs(phase, lanes, begun, durations, starts, ends, kind, ends, phase.impacts, path=path))
            hops.now[lanes] = begun + np.where(np.isnan(durations), 0.0, durations)
        hops.states[lanes] = ends
        if status:
            hops.status[lanes] = status

    def _mark(self, **event: Any) -> None:
        """Record the event at the ends of the latest arcs."""
        if self.hops.record:
            vars(self.hops.arcs[-1]).update(event)

    def _finish(self, lanes: np.ndarray, reason: Any = "", status: str = "lost") -> None:
        """End motions that cannot be followed."""
        self.hops.status[lanes] = status
        if reason:
            self.hops.reasons.update(dict.fromkeys(lanes.tolist(), reason))

    def _is_over(self, lanes: np.ndarray, durations: np.ndarray) -> np.ndarray:
        """Whether (k,) the time of the simulation is over as arcs end; these are cut there."""
        now = self.hops.now[lanes]
        return (durations >= self.time - now) | (now + durations >= self.time)

    def _flights(self, lanes: np.ndarray, phase: Phase) -> None:
        """Fly motions up to their next events."""
        hops, impacts, x, watch = self.hops, phase.impacts, self.hops.states[lanes], self._watch(phase)
        if (fresh := np.isnan(hops.left[lanes])).any():
            own = lanes[fresh]
            hops.left[own] = impacts.longest_flight(x[fresh])
            if impacts.model.grazes:
                hops.reach[own] = impacts.reach(x[fresh], hops.foot[own], hops.order[own] > 0)
            if self.course and hops.order[lanes] == LIFTOFF_ORDER:
                (self.course.launch,) = x
                if not impacts.feet[hops.foot[lanes[0]]].opens(x, impacts.p)[0]:
                    return self._finish(lanes, status="no_launch")
        limit = np.minimum(hops.left[lanes], self._left(lanes))
        opens = impacts.model.grazes | (np.arange(len(impacts.gaps)) == hops.foot[lanes, None])
        opening = hops.order[lanes, None] * opens
        falls = [FallTest(impacts.footing)] if self.thorough and impacts.footing.falls_by_formula else []
        orders = self._orders(lanes, watch, opening)
        found, path = self._events(phase, x, limit, orders, falls)
        which, times, rows = found.which, found.times, found.rows[:, : impacts.flight.size]
        for k, error in found.failed.items():
            self._finish(lanes[[k]], error.args[0], status_of_failure(error, "flight"))
        if self.branches and not phase.side and not found.failed:
            if path is None:
                path, _ = impacts.flight.run(x[0], impacts.p, float(times[0] if which[0] >= 0 else limit[0]))
            if not self._sticks(self.branches, lanes, phase, path):
                return None
        lands = (which >= 0) & (which < len(impacts.gaps))
        if not lands.all() or not self.endless:
            ends = (which >= 0) & (times < limit)
            for k in np.flatnonzero(~ends & (hops.status[lanes] == "")).tolist():
                self._fly_on(lanes[[k]], phase, x[k], limit[[k]], path)
            if not self.endless and (over := ends & self._is_over(lanes, times)).any():
                self._arrive(lanes[over], phase, times[over], rows[over], status=DONE, path=path)
                hops.now[lanes[over]], ends = self.time, ends & ~over
            lands &= ends
            turns = ends & ~lands & (which < watch.opening)
            fallen, closed = ends & ~lands & ~turns, turns & (impacts.gap(rows) <= 0)
            self._arrive(lanes[fallen], phase, times[fallen], rows[fallen], FALLS, FALLS, path)
            which[closed], lands, turns = 0, lands | closed, turns & ~closed
            hops.left[lanes[turns]] -= times[turns]
            self._reverse(lanes[turns], phase, times[turns], rows[turns], path)
            lanes, which, times, rows = lanes[lands], which[lands], times[lands], rows[lands]
        if impacts.model.grazes and len(lanes):
            which, passes, scuffs = impacts.touched(rows, hops.foot[lanes], hops.reach[lanes])
            for own, ending in ((passes, ""), (scuffs, FALLS)):
                self._arrive(lanes[own], phase, times[own], rows[own], ending, ending, path)
            own = lanes[passes]
            hops.left[own], hops.reach[own], hops.order[own] = hops.left[own] - times[passes], 0.0, 1
            lanes, times, rows, which = (each[~(passes | scuffs)] for each in (lanes, times, rows, which))
        if len(lanes):
            self._arrive(lanes, phase, times, rows, path=path)
            self._land(lanes, which)
        return None

    def _fly_on(
        self, lane: np.ndarray, phase: Phase, x: np.ndarray, limit: np.ndarray, path: Trajectory | None
    ) -> None:
        """What becomes of a flight in which nothing happens: it has no end, or the time or the parameters end it."""
        hops = self.hops
        if not hops.record:
            return self._finish(lane, status="carried_off")
        left, cut = hops.left[lane] - limit, self.until < min(self.time, *(hops.now[lane] + hops.left[lane]))
        over = not cut and self._is_over(lane, limit).any()
        try:
            if path is None and limit[0] >= BRIEF:
                path, _ = phase.flow.run(x, phase.impacts.p, float(limit[0]))
        except FlowError as error:
            return self._finish(lane, error.args[0], status_of_failure(error, "flight"))
        end = path.end[: len(x)] if path else x
        self._arrive(lane, phase, limit, end[None], status="" if cut else DONE if over else "carried_off", path=path)
        if over:
            hops.now[lane] = self.time
        if cut:
            hops.now[lane], hops.left[lane], hops.order[lane] = self.until, left, 0
            if not phase.impacts.model.grazes and phase.impacts.gap(hops.states[lane])[0] <= 0:
                self._land(lane, np.zeros(1, int))
        return None

    def _reverse(
        self, lanes: np.ndarray, phase: Phase, times: np.ndarray, ends: np.ndarray, path: Trajectory | None = None
    ) -> None:
        """Reverse the spring, whose other branch or sticking follows."""
        self._arrive(lanes, phase, times, ends, REVERSES, path=path)
        self.hops.turns[lanes], self.hops.order[lanes] = self.hops.turns[lanes] + 1, 0
        reason = f"its spring turned {self.cap} times in one {phase.flow.phase.name}"
        self._finish(lanes[self.hops.turns[lanes] > self.cap], reason)

    def _sticks(self, branches: Branches, lane: np.ndarray, phase: Phase, path: Trajectory) -> bool:
        """Whether a spring that sticks with a constant force keeps its extension on a path; else the motion is lost."""
        states = path.coefficients[:, : phase.flow.size, 0]
        branches.check_width(states, phase.contact)
        if np.abs(branches.rates[phase.contact](states)).max() <= phase.impacts.options.touching * (
            1 + np.abs(states).max()
        ):
            return True
        self._finish(lane, "its spring sticks while the force that holds it changes, which cannot be followed")
        return False

    def _land(self, lanes: np.ndarray, touches: np.ndarray) -> None:
        """Land on the feet that touch."""
        hops, rows = self.hops, self.hops.states[lanes]
        self._update(lanes)
        branches = self.branches
        after = _landed_on_branches(branches, rows, touches) if branches else landed(self.impacts, rows, touches)
        if hops.record:
            kind, event = np.where(after.held, "landing", "impact"), {"landed": after, "foot": touches}
            self._mark(kind=kind, after=after.state, impacts=self.impacts, **event)
        hops.states[lanes], hops.status[lanes], hops.on_ground[lanes] = after.state, after.ended, after.held
        hops.impacts[lanes] += 1
        hops.loss[lanes] += after.loss
        hops.order[lanes], hops.foot[lanes], hops.left[lanes], hops.turns[lanes] = after.order, after.foot, np.nan, 0
        hops.status[lanes[~after.held & (after.ended == "") & (hops.impacts[lanes] >= self.cap)]] = "cap"
        if self.course:
            self._land_on_course(self.course, lanes, rows[0], int(touches[0]), after)

    def _land_on_course(self, course: Course, lane: np.ndarray, x: np.ndarray, foot: int, after: Landed) -> None:
        """End a simulation at a landing on a foot in a flight state (n,) where it slips, or where rounding decides."""
        (ended,), (last,) = after.ended.tolist(), self.hops.arcs[-1].durations
        if ended and ended != SLIPS:
            self._finish(lane, STATUSES[ended], ended)
        footing, slips = self.impacts.footing, ended == SLIPS
        if not ended and footing.friction is not None:
            slips = footing.slips_at_landing(impulses(self.impacts, x, foot, after), float(last))
        if slips:
            self._arrive(lane, Phase(False, self.impacts, 1), np.full(1, np.nan), after.state, SLIPS, SLIPS)
        elif after.held[0] and self.undecided and self.undecided(course, self.branches or self.impacts, self.cap):
            self._finish(lane, status="undecided")

    def _contacts(self, lanes: np.ndarray, phase: Phase) -> None:
        """Stand up to the next events."""
        hops, impacts = self.hops, phase.impacts
        if self.branches and not len(lanes := self._that_stand_on(lanes, phase)):
            return
        ys, watch, limit = phase.states(hops.states[lanes]), self._watch(phase), self._left(lanes)
        path = None
        if (self.thorough and impacts.footing.watched_alone) or not phase.side:
            times, rows, outcome = np.full(len(ys), np.nan), ys.copy(), np.full(len(ys), "", STATUS)
        else:
            if self.endless and (self.branches or not impacts.contact.phase.closed_form):
                limit = impacts.options.batch_contact * (1 + np.abs(ys).max(1))
            orders = self._orders(lanes, watch, impacts.grazes(ys).T | (hops.order[lanes, None] == 1))
            found, path = self._events(phase, ys, limit, orders)
            times, rows = found.times, found.rows[:, : impacts.contact.size]
            names = [*(each.outcome for each in impacts.exits), REVERSES if self.branches else FALLS, ""]
            outcome = np.where(np.isinf(times), impacts.most_turns[1], np.array(names, STATUS)[found.which])
        for k in np.flatnonzero((outcome == "") | (np.isinf(times) & hops.record)).tolist():
            times[k], outcome[k], rows[k], last = self._contact_alone(lanes[[k]], phase, ys[k])
            path = last if self.course else None
        hops.ends[lanes], ends = rows, rows @ impacts.model.embed.T
        hops.contacts[lanes] = np.where(outcome == LIFTS_OFF, times, np.nan)
        if not self.endless:
            outcome[self._is_over(lanes, times)] = DONE
        back, turns = outcome == STEPS_BACK, outcome == REVERSES
        if (lifts := back | (outcome == LIFTS_OFF)).any():
            self._arrive(lanes[lifts], phase, times[lifts], ends[lifts], path=path)
            self._lift_off(lanes[lifts], phase, back[lifts])
        self._reverse(lanes[turns], phase, times[turns], ends[turns], path)
        others = ~lifts & ~turns
        if not hops.record:
            hops.status[lanes[others]] = outcome[others]
            return
        for k in np.flatnonzero(others).tolist():
            name, kind = str(outcome[k]), outcome[k] if outcome[k] in (SLIPS, FALLS) else ""
            self._arrive(lanes[[k]], phase, times[[k]], ends[[k]], kind, name.replace(CUT, ""), path)
            if name == DONE:
                hops.now[lanes[k]] = self.time
            elif name == CUT:
                self._stand_on(lanes[[k]], rows[k])

    def _that_stand_on(self, lanes: np.ndarray, phase: Phase) -> np.ndarray:
        """The motions (k,) of a spring with hysteresis that stand on: others rest, or lift off as the force jumps."""
        hops, impacts, turns = self.hops, phase.impacts, self.hops.turns[lanes]
        # One coordinate that sticks is at rest, and after some turns it never lifts off, see `ContactStop`.
        if self.endless and impacts.model.one_speed:
            hops.status[lanes[(turns == impacts.options.turns) | (phase.side == 0)]] = "rests"
        leaps = (hops.status[lanes] == "") & (turns > 0) & (impacts.pressing(hops.states[lanes]) < 0)
        if (own := lanes[leaps]).size:
            hops.ends[own] = phase.states(hops.states[own])
            self._arrive(own, phase, np.full(len(own), np.nan), hops.states[own])
            self._lift_off(own, phase, np.zeros(len(own), bool))
        return lanes[(hops.status[lanes] == "") & ~leaps]

    def _contact_alone(
        self, lane: np.ndarray, phase: Phase, y: np.ndarray
    ) -> tuple[float, str, np.ndarray, Trajectory | None]:
        """How long a contact from a state (k,) lasts, how it ends, in which state, and its path."""
        reverses, left = None, np.inf if self.endless else float(np.min(self._left(lane)))
        if self.branches:
            reverses = first_reversal(
                self.branches.rates[True], int(self.hops.turning[lane[0]]) if phase.side else None
            )
        path, outcome, reason = phase.impacts.sustained_contact(y, left, reverses)
        if reason:
            self.hops.reasons[int(lane[0])] = reason
        if path is None:
            return np.nan, str(outcome), y, None
        if self.branches and not phase.side and not self._sticks(self.branches, lane, phase, path):
            return np.nan, "lost", y, None
        return float(path.times[-1]), outcome or CUT, path.end[: len(y)], path

    def _stand_on(self, lane: np.ndarray, y: np.ndarray) -> None:
        """Stand on with other parameters, or lift off: the force may vanish by rounding, or because of them."""
        self.hops.now[lane], self.hops.order[lane] = self.until, 0
        self._update(lane)
        impacts, tolerance = self.impacts, self.impacts.options.touching * (1 + np.abs(y).max())
        force, lifts_off = impacts.force_at_start(impacts.exits[0], y, impacts.p, tolerance)
        if lifts_off or force <= 0:
            self._lift_off(lane, Phase(True, impacts, 1), np.zeros(1, bool))

    def _lift_off(self, lanes: np.ndarray, phase: Phase, back: np.ndarray) -> None:
        """Leave the ground, some with a step `back`, in other labels."""
        hops, impacts = self.hops, phase.impacts
        if self.course:
            return self._lift_off_on_course(self.course, lanes, phase, impacts.exits[int(back[0])])
        status = np.full(len(lanes), LIFTS_OFF, STATUS)
        if back.any():  # a launch in other labels, where the same point opens
            way, own = impacts.exits[1], lanes[back]
            status[back] = "leaves_elsewhere" if way.foot else LIFTS_OFF
            hops.ends[own] = phase.states(way.opened(hops.states[own], impacts.values))
        if self.branches:
            hops.speeds[lanes], launches = impacts.liftoff(hops.ends[lanes])
            status[~launches] = "leaves_elsewhere"
        hops.status[lanes], hops.on_ground[lanes] = status, False
        self._mark(kind="lift-off", step=-back.astype(int))
        return None

    def _lift_off_on_course(self, course: Course, lane: np.ndarray, phase: Phase, way: Exit) -> None:
        """Lift off in a simulation, and continue to the next hop."""
        hops = self.hops
        self._update(lane)
        impacts = phase.impacts if self.branches else self.impacts
        if (found := course.lifted(impacts, float(hops.now[lane[0]]), hops.states[lane[0]], way)) is None:
            return self._finish(lane, status="rests")
        hops.states[lane], hops.order[lane] = found
        event = {"foot": way.foot, "step": -int(way.labels is not None), "speed": course.speed}
        self._mark(kind="lift-off", impacts=impacts, after=hops.states[lane], **event)
        hops.impacts[lane], hops.turns[lane], hops.on_ground[lane] = 0, 0, False
        hops.foot[lane], hops.left[lane] = way.foot, np.nan
        hops.status[lane] = DONE if course.count == course.lift_offs else ""
        return None


def _landed_on_branches(branches: Branches, rows: np.ndarray, touches: np.ndarray) -> Landed:
    """The effect of landings by the rules of the branches that hold after them."""
    sides = branches.landed(rows)
    parts = {sign: np.flatnonzero(sides == sign) for sign in np.unique(sides).tolist()}
    found = [landed(branches.of[sign], rows[own], touches[own]) for sign, own in parts.items()]
    order = np.argsort(np.concatenate([*parts.values()]))
    return Landed(*(np.concatenate(columns)[order] for columns in zip(*found, strict=True)))
