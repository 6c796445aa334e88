"""Impacts of a machine in flight, and the sustained contact that may follow.

An impact of restitution e turns the speed s of the gap into -e s. With e = 0 the machine stays in contact where the
contact force presses, and leaves immediately where the contact would have to pull. A foot that sticks loses its speed
along the ground at every impact, and the restitution is that of the gap alone. A contact ends where its force
vanishes. For most springs that happens on the launch set. If the spring's force does not rise throughout, contact may
also end elsewhere, or at the extension of a launch while the machine moves down.
"""

from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import BreaksDown, FlowError, InputError, OutOfRange, RunsAway, finite_number
from ..flow import FirstOf, StopTest, Trajectory, Watch, flow_of
from ..model import CONTACT_FORCE, Affine, Machine, Model, check_machine
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS, Crossings
from ..periodic import gradients
from ..shooting import vector
from ..symbolic import ElementwiseFunction, cached
from ..units import LIFTOFF_SPEED, Message, Quantity
from .points_of_contact import REVERSES, Exit, Foot, exits_of, feet_of
from .sticking_contact import FALLS, SLIPS, FallTest, Footing, SlipTest

# The endings of a hop other than "lifts_off" (of a map) and "done" (of a simulation).
STATUSES = {
    "rests": "the contact never ends, or the launch speed with the injection is not above 0",
    "leaves_elsewhere": "the contact ends where no launch begins, or with a step back: a simulation continues, a "
    "map ends",
    "no_launch": "the contact would not open, because a strong damper stops a slow launch",
    "collapses": "the spring collapses, in contact or in flight",
    "stays": "the contact of a machine of several coordinates has not ended after many of its oscillations",
    "carried_off": "the flight does not end, for example since a machine that steps has fallen over",
    "out_of_range": "the motion reaches a place where a law is not defined, such as outside a measured table",
    "lost": "the motion could not be followed, for example since it takes too many steps",
    "cap": "one hop has too many impacts, like a wheel that rolls down a steep slope: simulate it for a time",
    "rattles": "changes of foot lose nothing, as at small angles, and no contact ever holds: state the angle",
    "unstated": "a foot lands with a speed, and its impact needs masses in the plane: state their Mass(across=)",
    "slips": "the foot needs more than the stated friction, or would have to pull as it lands, but slipping cannot be "
    "simulated",
    "falls": "a stated height of a machine that sticks, such as that of its body, reaches the ground; or a rocking "
    "block lies on its side; or the other foot touches while one stands, and two standing feet cannot be simulated",
    "undecided": "after many bounces, rounding decides how the hop ends",
    "invalid": "the launch speed is not a number above 0, or no launch has these numbers",
}
STATUS = f"<U{max(map(len, STATUSES))}"  # the type of arrays of statuses
FASTEST_LAUNCH = 1e15  # a launch speed beyond this has no digits left for the motion between two impacts
CAP = 10_000  # a hop is abandoned after this many impacts
LIFTOFF_ORDER = 3  # order of the gap's zero at a lift-off


class ImpactOptions(NamedTuple):
    """The tolerances of impacts and contacts. Times are relative to the size of the state that a phase starts from."""

    longest_flight: float = 1e4  # a flight that lasts longer, in its ballistic times, does not end
    longest_step: float = 500.0  # one of a machine that steps: nothing throws it up, and it has fallen over before
    longest_contact: float = 1e6  # a contact that lasts longer, which grows as sqrt(mass ratio), does not end
    batch_contact: float = 1e3  # contacts are integrated as a batch up to this time, unfinished ones then one by one
    # Bounces are summed as a geometric series once the pressing acceleration changes by less than this share while they
    # last. Their effect on the rest of the motion is of third order in that time.
    summed_change: float = 1e-8
    no_force: float = 2e-15  # a contact force below this, relative to the state, may vanish
    slowest_bounce: float = 1e-15  # a slower one, relative to the state, is rounding and without a force never ends
    # A contact that ends within this relative distance of a launch state is taken to end there, so that lossless hops
    # stay lossless to the last bit. Two lift-offs that close would be one fold of the spring's force.
    launch_distance: float = 1e-7
    energy_panels: int = 32  # straight panels between the origin and a state along which its energy is integrated
    turns: int = 3  # after this many zeros of its speed a contact never ends, see `ContactStop`
    turns_of_several: int = 100  # of the launched coordinate's speed until a contact of several coordinates is given up
    # A contact whose rates are all below this is at rest: an overdamped one reaches rest without turning.
    still: float = 1e-12
    # A gap, gap speed or contact force below this, relative to the state, is zero: rounding is smaller.
    touching: float = 1e-9
    grazing: float = 1e-12  # a contact force below this, relative to the state, vanishes
    # Where the height of a point that passes the ground in mid-flight changes with its gap by a smaller share than
    # where it opened, it is close to the standing point, and passes.
    passing: float = 0.5
    # An impulse that would pull one of two feet is made up for where the accelerations change by a smaller share until
    # the force on this foot has done so.
    unloaded: float = 0.1
    same_liftoff: float = 1e-12  # extensions at lift-off that differ by a smaller share are rounding


class ContactStop:
    """A `stop` of the contact's flow: at lift-off, or as soon as it is known that lift-off never comes.

    speed : the coordinate of the contact that is its speed; None where rest is not searched
    several : whether the contact has several coordinates
    grazes : for each of the model's exits, whether the contact begins with its force at 0 and rising, as after a
        lossless landing
    outcome : that of an exit, "slips", "falls", "rests", "stays", or None while the contact lasts

    Trajectories of one coordinate do not cross in the phase plane. Once the speed has changed its sign three times,
    the rest of the trajectory, with damping or without, stays inside the part passed so far, and it never ends. The
    contact of several coordinates may end after any time; it is given up after many turns.
    """

    def __init__(self, impacts: "Impacts", speed: Affine | None, grazes: Iterable[bool] = (False, False)):
        self.size, self.exits, self.speed = impacts.contact.size, impacts.exits, speed
        self.still = impacts.options.still
        grazes = [*grazes]
        self.force_zeros, self.speed_zeros = [Crossings(int(each)) for each in grazes], Crossings()
        self.slips = SlipTest(impacts.footing, grazes)
        self.falls = FallTest(impacts.footing, contact=True)
        self.turns_left, self.over = impacts.most_turns
        self.outcome: str | None = None

    def __call__(self, coefficients: np.ndarray, steps: np.ndarray) -> tuple[int, float] | None:
        """The step at which the contact ends, and the time in that step; None while it lasts."""
        pairs = zip(self.exits, self.force_zeros, strict=False)
        ends = [zeros(each.force.series(coefficients), steps)[:1] for each, zeros in pairs]
        last, still = self._rest(self.speed, coefficients, steps) if self.speed else ([], [])
        slips, fall = self.slips(coefficients, steps), [*filter(None, [self.falls(coefficients, steps)])]
        first = min([*(end for each in ends for end in each), *last, *still, *slips, *fall], default=None)
        if first is not None:
            exits = [each.outcome for each, end in zip(self.exits, ends, strict=True) if first in end]
            others = [name for name, places in ((SLIPS, slips), (FALLS, fall), ("rests", still)) if first in places]
            self.outcome = [*exits, *others, self.over][0]
        return first

    def _rest(self, speed: Affine, coefficients, steps) -> tuple[list[tuple[int, float]], list[tuple[int, float]]]:
        """Places from which the force never ends the contact: the last turn, and where a step starts at rest."""
        turns = self.speed_zeros(speed.series(coefficients), steps)
        last, self.turns_left = turns[self.turns_left - 1 : self.turns_left], self.turns_left - len(turns)
        still = np.flatnonzero(np.abs(coefficients[:, : self.size, 1]).max(1) < self.still)[:1]
        return last, [(int(i), float(steps[i])) for i in still]


class Impacts:
    """The impacts and contacts of a machine with its restitution, at its own parameters or at other `values` of them.

    bounce_order : order of the gap's zero where the machine leaves immediately after an impact
    flight, contact : the flows of the two phases
    feet, exits : the points that may touch in flight, and the ways in which a contact ends
    footing : what sticks in contact
    gaps : those of the feet that are watched, in flight
    gap, gap_speed : the gap of the first foot as a function of the flight state, and the weights of its speed
    contact_force, force_index : the contact force as a function of the rows of the contact's motion, and its place
        among the quantities that the contact watches
    onto_contact : matrix (k, n) from flight states with closed gap to contact states

    Raises `InputError` for anything but a machine with a restitution.
    """

    def __init__(self, machine: Machine, values: Mapping | None = None, options: ImpactOptions | None = None):
        check_machine(machine, "restitution")
        if machine.model.hysteretic:
            several = "a machine whose spring has hysteresis can be simulated, or mapped from launch speeds"
            raise InputError(f"{several}; for anything else use the law's `.mean`")
        self.machine, self.options = machine, options or ImpactOptions()
        model, self.restitution = machine.model, float(machine.restitution)
        if self.restitution > 0 and model.changes_contact:
            raise InputError(
                f"restitution = {self.restitution:g}: a {model.name} must have the restitution 0, since one of its "
                "feet stands at all times, and after a rebound none would"
            )
        self.model, self.values = model, dict(values or machine.values)
        self.p, names = vector(self.values), tuple(self.values)
        self.bounce_order = 1 if self.restitution > 0 else 2
        self.flight, self.contact = flow_of(model.flight, names), flow_of(model.contact, names)
        self.feet, self.exits = feet_of(model, self.flight, self.values), exits_of(model)
        self.gaps = [each.gap for each in (self.feet[:1] if model.grazes else self.feet)]
        self.gap, self.contact_force = self.gaps[0], self.exits[0].force
        self.force_index = self.exits[0].row - self.contact.size
        self.footing = Footing(model, self.flight, self.contact, self.values)
        self.onto_contact = np.linalg.pinv(model.embed)

    @cached_property
    def flight_watch(self) -> Watch:
        """What a flight is watched for: the gaps of the feet, and what closes as the machine falls over."""
        gaps = [*self.gaps, *(each.gap for each in self.footing.tilts)]
        return Watch(self.flight, gaps, opening=len(self.gaps))

    @cached_property
    def contact_watch(self) -> Watch:
        """What a contact is watched for: the forces of the exits, and the height that falls; after some turns of its
        speed it never ends."""
        timed = self.timed_watch
        return Watch(self.contact, timed.functions, timed.opening, (self.model.contact_speed, self.most_turns[0]))

    @cached_property
    def timed_watch(self) -> Watch:
        """What a contact of limited time is watched for."""
        falls, forces = self.model.standing_gap(self.values), [each.force for each in self.exits]
        return Watch(self.contact, [*forces, falls] if falls else forces, len(forces))

    def first(self) -> "Impacts":
        """The impacts by which launches are, as of `Branches`."""
        return self

    @property
    def most_turns(self) -> tuple[int, str]:
        """The number of turns of its speed after which a contact never ends, and the status then."""
        return (self.options.turns, "rests") if self.model.one_speed else (self.options.turns_of_several, "stays")

    def landing(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """The effect of impacts at flight states (m, n) with closed gap: whether (m,) sustained contact follows,
        immediately or after infinitely many bounces; the states (m, n) after the impact, which move away where it
        bounces; the loss of energy (m,); the time (m,) that infinitely many bounces take; and whether (m,) the contact
        force rises from 0."""
        e, m = self.restitution, len(x)
        own = np.array([[*self.gap_speed, e]]), self.flight.data(x, self.p), self._contact_data(x)
        stuck, direction, found, *bounces = landing_function(self.model, tuple(self.values), e > 0)(x, *own)
        speed, pressing, mass, loss = found.T
        held, wait = pressing >= 0, np.zeros(m)
        # A force that vanishes by rounding presses if it rises, as the gap does not open then.
        if (rises := ~held & (pressing >= -self.options.no_force * (1 + np.abs(x).max(1)))).any():
            rises[rises] = self.gap_rates(stuck[rises])[0] < 0
            held |= rises
        if e > 0:
            closing, jerk, snap = bounces[0].T
            # All bounces to come are summed where the acceleration that closes the gap hardly changes while they last.
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                wait = 2 * e * np.abs(speed) / (1 - e) / closing if e < 1 else np.full(m, np.inf)
                change = wait * (np.abs(jerk) + 0.5 * wait * np.abs(snap))
                summed = (closing > 0) & (change <= self.options.summed_change * closing)
            held &= summed | (np.abs(speed) <= self.options.slowest_bounce * np.abs(x).max(1))
            wait = np.where(held & summed, wait, 0.0)
            left = np.where(held, 0.0, e)
            after, loss = stuck - (left * speed)[:, None] * direction, loss - 0.5 * mass * (left * speed) ** 2
            return held, after, loss, wait, held & rises
        return held, stuck, loss, wait, rises

    def _contact_data(self, x: np.ndarray) -> np.ndarray:
        """The data of the contact at flight states (m, n); impacts change no place, and so no piece."""
        return self.contact.data(x @ self.onto_contact.T if self.contact.phase.pieces else x, self.p)

    def direction(self, x: np.ndarray) -> np.ndarray:
        """The change (m, n) of flight states (m, n) per change of the gap's speed in an impact; (1, n) where it is the
        same for all."""
        rows = self.model.impact(list(x.T), self.values)
        if not any(map(np.ndim, rows)):
            return np.array([rows], dtype=float)
        return np.stack(np.broadcast_arrays(*rows, x[:, 0])[:-1], axis=1)

    @cached_property
    def change_after(self) -> ca.Function:
        """(flight state, a small change of it, the multiple of its gap speed that impacts remove) -> the change after
        the impact, whose direction may depend on where it happens."""
        x, change, factor = self.flight.vector_field.x, ca.SX.sym("change", self.flight.size), ca.SX.sym("factor")
        direction = ca.vertcat(*self.model.impact(ca.vertsplit(x), self.values))
        stuck = ca.vertcat(*self.model.landed(ca.vertsplit(x), self.values)) if self.model.sticks else x
        after = stuck - (factor - bool(self.model.sticks)) * ca.dot(ca.DM(self.gap_speed), x) * direction
        return ca.Function("change_after", [x, change, factor], [ca.densify(ca.jtimes(after, x, change))])

    @cached_property
    def change_let_go(self) -> tuple[ca.Function, ...]:
        """For a landing on each foot, (flight state, a small change of it) -> the change after the other one was let
        go, in its labels; for feet that stick."""
        x, change = self.flight.vector_field.x, ca.SX.sym("change", self.flight.size)
        planar = self.model.planar
        maps = () if planar is None else (planar.handed_back, planar.handed_over)
        after = [ca.vertcat(*each(ca.vertsplit(x), self.values)) for each in maps if each]
        return tuple(ca.Function("let_go", [x, change], [ca.densify(ca.jtimes(each, x, change))]) for each in after)

    @cached_property
    def share_slope(self) -> ca.Function:
        """(flight state in which the machine stands) -> the gradient (1, n) of the share that a hand-over leaves."""
        x = self.flight.vector_field.x
        share = ca.SX(self.model.share_left(ca.vertsplit(x), self.values))
        return ca.Function("share_slope", [x], [ca.densify(ca.jacobian(share, x))])

    def shares_of_landing(self, x: np.ndarray, foot: Foot, ps: np.ndarray) -> np.ndarray:
        """The jerks (m, 1 + sticks) of the gap of a foot and of what sticks, over that of the gap, at flight states
        (m, n) with parameters (m, np)."""
        first = self.feet[0] if self.model.grazes else foot
        jerks = np.array([each.rates(x, ps)[0] for each in (first, *self.footing.held)]).T
        return jerks / jerks[:, :1]

    def reach(self, x: np.ndarray, foot: np.ndarray, opens: np.ndarray) -> np.ndarray:
        """The slopes (m,) of the height by the gap of feet (m,) that are open at flight states (m, n), or that open;
        0 for feet that have passed the ground."""
        gaps = np.array([each.gap(x) for each in self.feet])[foot, np.arange(len(x))]
        return np.where(opens | (gaps > 0), np.maximum(self.slopes(x, foot), 0.0), 0.0)

    def slopes(self, x: np.ndarray, foot: np.ndarray) -> np.ndarray:
        """The slopes (m,) of the height of the contact point by the gap of feet (m,), where it is closed."""
        weights = np.array([each.gap.weights for each in self.feet])[foot]
        place = int(np.argmax(np.abs(weights[0])))
        series = np.stack([np.where(np.arange(x.shape[1]) == place, 0.0, x), weights], axis=2)
        return self.model.height_of(self.values).series(series)[:, 1]

    def touched(self, x: np.ndarray, foot: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The feet (m,) that touch at flight states (m, n) in which the gap vanishes, after the feet (m,) opened with
        this `reach`; whether (m,) the foot only passes there; and whether (m,) it is still behind."""
        slopes = self.slopes(x, foot)
        ahead, near = reach == 0, slopes < self.options.passing * reach
        return np.where(ahead, 1 - foot, foot), ~ahead & near, ahead & (slopes >= 0)

    def projection(self, x: np.ndarray, shares: np.ndarray, ps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a tangential landing takes away from flight states (m, n) in which the machine stands, with parameters
        (m, np): the matrix (m, n, 2 + sticks), which is to be multiplied by the rows (2 + sticks, n) of the gap, its
        speed and those of what sticks; and these rows.

        shares : (m, 1 + sticks), the jerks of these over that of the gap
        """
        flat = landing_directions(self.model, tuple(self.values))(x, self.flight.data(x, ps))
        away, commutators = (each.reshape(len(x), -1, x.shape[1]) for each in flat)
        basis = np.concatenate([away, np.einsum("ms,msn->mn", shares, commutators)[:, None]], axis=1).swapaxes(1, 2)
        speeds = [each.speed for each in self.footing.held]
        rows = np.vstack([np.array(self.gap.weights), self.gap_speed, *speeds])
        return basis @ np.linalg.inv(rows @ basis), rows

    def launch(self, alpha: ArrayLike) -> np.ndarray:
        """Flight states (m, n) at lift-off with launch speeds (m,)."""
        liftoff = self.model.release(alpha, self.values) if self._one_release is None else self._one_release
        rows = self.model.launch({"liftoff": liftoff, "alpha": alpha}, self.values)
        states = np.empty((len(np.asarray(alpha)), len(rows)))
        for column, row in enumerate(rows):
            states[:, column] = row
        return states

    @cached_property
    def _one_release(self) -> float | None:
        """The extension at lift-off, where it is the same at all speeds."""
        slow, fast = self._releases if self.model.conservative else (0.0, 1.0)  # a damper's depend on the speed
        return float(slow) if slow == fast and self.one_liftoff else None

    def opens(self, x: np.ndarray) -> np.ndarray:
        """Whether the gap opens (m,) at launch states (m, n), where it and its first two derivatives vanish."""
        return self.feet[0].opens(x, self.p)

    def longest_flight(self, x: np.ndarray) -> np.ndarray:
        """The time () or (m,) after which a flight from states (n,) or (m, n) counts as endless."""
        # NumPy takes nine times as long along the short axis.
        longest = self.options.longest_flight if self.model.plain else self.options.longest_step
        return longest * (1 + np.abs(x.T.copy()).max(0))

    def longest_contact(self, y: np.ndarray) -> float:
        """The time after which a contact from a state (k,) counts as endless."""
        return float(self.options.longest_contact * (1 + np.abs(y).max()))

    def sustained_contact(
        self, y: np.ndarray, left: float = np.inf, reverses: StopTest | None = None
    ) -> tuple[Trajectory | None, str | None, str]:
        """Follow the contact from a state (k,) for at most the time `left`: its motion, its outcome and the reason.

        The outcome is "lifts_off", a status, None at the end of the time, or that of the test whether a spring
        `reverses`. Rest is only searched when the time is not limited. The motion is None where it could not be
        integrated.
        """
        endless = left == np.inf
        limit = self.longest_contact(y) if endless else left
        if self.footing.slips_at_once(y):
            return None, SLIPS, ""
        speed = self.model.contact_speed if endless and (self.model.one_speed or not reverses) else None
        end = ContactStop(self, speed, self.grazes(y[None])[:, 0])
        first = FirstOf(end, *([reverses] if reverses else ()))
        try:
            path, _ = self.contact.run(y, self.p, limit, stop=first)
        except FlowError as error:
            return None, status_of_failure(error, "contact"), error.args[0]
        if first.which == 1:
            return path, REVERSES, ""
        if end.outcome or not endless:
            return path, end.outcome, ""
        return path, "collapses" if np.abs(path.end).max() > limit else "rests", ""

    def forces_of_exits(self, z: np.ndarray) -> np.ndarray:
        """The forces (exits, m) of the exits at flight states (m, n) that stand."""
        forces = self.contact.field(z @ self.onto_contact.T, self.p)[1]
        return np.stack([forces[:, each.row - self.contact.size] for each in self.exits])

    def force_at_start(self, way: Exit, y: np.ndarray, p: np.ndarray, tolerance: float) -> tuple[float, bool]:
        """The force of an exit in a contact state (k,), and whether it is 0 up to a tolerance and falls: it opens."""
        path, _ = self.contact.run(y, p, tolerance)
        force, rise = way.force.series(path.coefficients)[0, :2]
        return float(force), bool(abs(force) <= tolerance and rise < 0)

    @cached_property
    def force_slope(self) -> ca.Function:
        """(contact state, data) -> the gradient (1, k) of the contact force, and the force."""
        graph = self.contact.vector_field
        force = graph.field(graph.x, graph.p)[1][self.force_index]
        return ca.Function("force_slope", [graph.x, graph.p], [ca.jacobian(force, graph.x), force])

    def force_gradient(self, y: np.ndarray) -> np.ndarray:
        """The gradient (k,) of the contact force at a contact state (k,)."""
        return self.force_slope(y, self.contact.data(y[None], self.p)[0])[0].full().ravel()

    @cached_property
    def force_gradients(self) -> ElementwiseFunction:
        """(contact state, data) -> the gradient of the contact force, at several states."""
        y, data = self.force_slope.sx_in()
        return ElementwiseFunction(ca.Function("gradients", [y, data], [self.force_slope(y, data)[0].T]))

    def grazes(self, ys: np.ndarray) -> np.ndarray:
        """Whether (exits, m) the force of each exit vanishes at contact states (m, k), up to rounding, as that on the
        landed point does at a lossless landing. Where one coordinate moves and one point stands this makes no
        difference, and False is returned."""
        found = np.zeros((len(self.exits), len(ys)), bool)
        if not self.model.one_speed or self.model.changes_contact:
            forces, tolerance = self.contact.field(ys, self.p)[1], self.options.grazing * (1 + np.abs(ys).max(1))
            for i, each in enumerate(self.exits):
                if i or not self.model.one_speed:
                    found[i] = np.abs(forces[:, each.row - self.contact.size]) <= tolerance
        return found

    def liftoff(self, ys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speeds (m,) of contact states (m, k) whose force vanishes, and whether (m,) each is the launch with it."""
        speed, x = self.model.contact_speed(ys), ys @ self.model.embed.T
        if not self.model.one_speed:
            return speed, np.zeros(len(ys), bool)
        forward = speed > 0
        distance = np.abs(x - self.launch(np.where(forward, speed, 1.0))).max(1)
        return speed, forward & (distance <= self.options.launch_distance * (1 + np.abs(x).max(1)))

    def energy(self, x: ArrayLike) -> float:
        """The energy of a flight state (n,), see `energies`."""
        return float(self.energies(np.asarray(x, dtype=float)[None])[0])

    def energies(self, x: np.ndarray) -> np.ndarray:
        """The energies (m,) of flight states (m, n), relative to rest with the spring unloaded and the gap closed: the
        integrals of their gradients along straight lines from there."""
        rest = np.array(self.model.rest(self.values) if self.model.rest else np.zeros(self.flight.size), dtype=float)
        edges = [np.linspace(0.0, 1.0, self.options.energy_panels + 1)] * len(x)
        if self.model.flight.pieces:  # A panel may not reach across a breakpoint of the law.
            begin, breaks = self.flight.coordinate @ rest, np.array(self.flight.piece_table(self.p)[0])
            for i, reach in enumerate((x - rest) @ self.flight.coordinate):
                places = (breaks - begin) / reach if reach else np.zeros(0)
                edges[i] = np.unique([*edges[i], *places[(places > 0) & (places < 1)]])
        owner = np.repeat(np.arange(len(x)), [len(each) - 1 for each in edges])
        widths = np.concatenate([*map(np.diff, edges)])[:, None]
        shares = (np.concatenate([each[:-1] for each in edges])[:, None] + widths * GAUSS_PLACES)[:, :, None]
        points = (shares * (x - rest)[owner, None] + rest).reshape(-1, len(rest))
        gradient = gradients(self.model.flight, self.model.flight_gradient, tuple(self.values))
        (slopes,) = gradient(points, self.flight.data(points, self.p))
        along = np.einsum("pgn,pn->pg", slopes.reshape(*shares.shape[:2], -1), (x - rest)[owner])
        return np.bincount(owner, (along * (widths * GAUSS_WEIGHTS)).sum(1), len(x))

    def energy_gradient(self, x: np.ndarray) -> np.ndarray:
        """The gradient (n,) of the energy at a flight state (n,)."""
        gradient = gradients(self.model.flight, self.model.flight_gradient, tuple(self.values))
        return np.array(gradient(x[None], self.flight.data(x[None], self.p))[0][0])

    @property
    def gap_speed(self) -> np.ndarray:
        """Weights (n,) of the gap's speed as a function of the flight state, whose speeds are states themselves."""
        return self.feet[0].speed

    def pressing(self, x: np.ndarray) -> np.ndarray:
        """The contact force (m,) at flight states (m, n) with closed gap and no gap speed."""
        return self.contact.field(x @ self.onto_contact.T, self.p)[1][:, self.force_index]

    def gap_rates(self, x: np.ndarray) -> np.ndarray:
        """Third and fourth derivative (2, m) of the gap in time at flight states (m, n)."""
        return self.feet[0].rates(x, self.p)

    @cached_property
    def never_lose(self) -> bool:
        """Whether impacts lose nothing, as those on a hand of infinite mass, which moves on as before."""
        x = self.flight.vector_field.x
        return ca.SX(self.model.impact_mass(ca.vertsplit(x), self.values)).is_zero()

    @property
    def descends(self) -> bool:
        """Whether gravity may add energy at a step, as on a slope; damped machines count among these."""
        return self.model.symmetry is not None and self.model.reversor is None

    @property
    def ends_by_energy(self) -> bool:
        """Whether the energy alone decides if the contact ends with a launch, where the contact force is linear."""
        return not self.model.changes_contact and not self.descends

    @cached_property
    def _releases(self) -> np.ndarray:
        """The extensions (2,) at lift-off with the speeds 1 and 2."""
        return self.model.release(np.array([1.0, 2.0]), self.values)

    @cached_property
    def one_liftoff(self) -> bool:
        """Whether the energy at lift-off determines the launch speed: it is conserved, and all launches have the same
        configuration."""
        if not self.model.conservative or self.descends:
            return False
        slow, fast = self._releases
        return bool(abs(fast - slow) <= self.options.same_liftoff * abs(slow))

    @cached_property
    def launch_inertia(self) -> float:
        """Twice the part of the energy at launch due to its speed, over the square of the speed; for an inertia that
        varies, at the configuration of the launch with speed 1, which is that of all where there is `one_liftoff`."""
        liftoff = self._releases[0] if self.one_liftoff else self.model.release(np.ones(1), self.values)[0]
        launch = np.array(self.model.launch({"liftoff": liftoff, "alpha": 1.0 + 1e-30j}, self.values), dtype=complex)
        # The launch speed changes speeds alone, and the energy's gradient with respect to these involves no law.
        direction, moved = launch.imag * 1e30, launch.imag != 0
        q = [0.0] * (self.model.flight.pieces.size if self.model.flight.pieces else 0)
        gradient = np.array([float(g) for g in self.model.flight_gradient(launch.real.tolist(), self.values, q)])
        return float(gradient[moved] @ direction[moved])


class _Stated:
    """A machine as a key: machines with the same model, parameters and restitution have the same impacts."""

    def __init__(self, machine: Machine):
        check_machine(machine, "restitution")
        self.machine = machine
        self.key = machine.model, *machine.values.items(), machine.restitution

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Stated) and self.key == other.key


def impacts_of(machine: Machine) -> Impacts:
    """The `Impacts` of a machine; those of the latest machines are stored, with all that was found for them."""
    return _latest_impacts(_Stated(machine))


@lru_cache(maxsize=16)
def _latest_impacts(stated: _Stated) -> Impacts:
    return Impacts(stated.machine)


@cached
def landing_function(model: Model, names: tuple[str, ...], bounces: bool) -> ElementwiseFunction:
    """(flight state with closed gap; weights of the gap's speed and the restitution; data of flight and contact) -> the
    state after a plastic impact; the direction of impacts; the speed of the gap, the contact force after a plastic
    impact, the mass of impacts and the energy that a plastic one loses; and where it `bounces` the acceleration that
    closes the gap after a plastic impact, and the third and fourth derivative of the gap after one that bounces."""
    flight, contact = flow_of(model.flight, names).vector_field, flow_of(model.contact, names)
    x, p, q, w = flight.x, flight.p, contact.vector_field.p, ca.SX.sym("w", flight.size + 1)
    known, values, _ = flow_of(model.flight, names).symbols(x, p)
    direction, speed, mass = (
        ca.vertcat(*model.impact(known, values)),
        ca.dot(w[:-1], x),
        model.impact_mass(known, values),
    )
    stuck = ca.vertcat(*model.landed(known, values)) if model.sticks else x - speed * direction
    lost = model.lost_at(known, values) if model.sticks else 0.5 * mass * speed**2
    row = [*model.contact.states, *model.contact.watch].index(CONTACT_FORCE) - contact.size
    force = contact.vector_field.field(ca.DM(np.linalg.pinv(model.embed)) @ stuck, q)[1][row]
    results = [stuck, direction, ca.vertcat(speed, force, mass, lost)]
    if bounces:
        rates = flight.field(x, p)[0]
        jerk = ca.jtimes(ca.dot(w[:-1], rates), x, rates)
        series = ca.Function("series", [x, p, w], [ca.vertcat(jerk, ca.jtimes(jerk, x, rates))])
        closing = -ca.dot(w[:-1], flight.field(stuck, p)[0])
        results.append(ca.vertcat(closing, series(stuck - w[-1] * speed * direction, p, w)))
    return ElementwiseFunction(ca.Function("landing", [x, w, p, q], [*map(ca.densify, results)]))


@cached
def landing_directions(model: Model, names: tuple[str, ...]) -> ElementwiseFunction:
    """(flight state, parameters of these names with the data of a piece) -> the directions D in which impacts change
    the state, one after the other, and their commutators with the rates f, which are f' D - D' f."""
    flow = flow_of(model.flight, names)
    x, p = ca.SX.sym("x", flow.size), ca.SX.sym("p", len(names) + (flow.phase.pieces.size if flow.phase.pieces else 0))
    known, values, data = flow.symbols(x, p)
    field = ca.vertcat(*model.flight.field(known, values, data))
    rows = [model.impact(known, values), *(model.sticking(known, values)[0] if model.sticking else ())]
    directions = [ca.densify(ca.vertcat(*row)) for row in rows]
    commutators = [ca.jtimes(field, x, each) - ca.jtimes(each, x, field) for each in directions]
    found = [ca.vertcat(*directions), ca.densify(ca.vertcat(*commutators))]
    return ElementwiseFunction(ca.Function("directions", [x, p], found))


def status_of_failure(error: FlowError, phase: str) -> str:
    """The status of a machine whose flight or contact could not be integrated to its end."""
    if isinstance(error, OutOfRange):
        return "out_of_range"
    if isinstance(error, RunsAway) and phase == "flight":
        return "carried_off"
    return "collapses" if isinstance(error, RunsAway | BreaksDown) else "lost"


def no_launch(alpha: float) -> Message:
    """The reason why a machine does not leave the ground at a launch speed."""
    text = "alpha = {alpha:g} is not a launch: the damper is too strong for the contact to open"
    return Message(text, alpha=Quantity(alpha, LIFTOFF_SPEED))


def injected(inject: object, unit: float = 1.0) -> float:
    """The checked addition to launch speeds, which are in this unit."""
    if abs(number := finite_number("inject", inject)) > FASTEST_LAUNCH * unit:
        raise InputError(f"inject = {number:g}; it must be at most {FASTEST_LAUNCH * unit:g}, like a launch speed")
    return number
