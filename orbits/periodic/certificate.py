"""The certificate of an orbit: its properties computed from its motions alone, and the violated conditions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..flow.flow import flow_of
from ..flow.trajectory import Trajectories
from ..io import fields_in_line
from ..model.model import CONTACT_FORCE, LANDED_FORCE, Model
from ..model.phase import Affine, Phase, weighted_sum
from ..model.state_formula import StateFormula
from ..numerics.polynomial_roots import PiecewisePolynomials, evaluate, powers
from ..numerics.quadrature import GAUSS_PLACES, GAUSS_WEIGHTS
from ..records import NONE, Records
from ..shooting.error_bound import DOUBTFUL_RATIO, EPS, NARROW
from ..shooting.formulations import Cycles, vectors
from ..symbolic.caches import cached
from ..symbolic.kernels import ElementwiseFunction
from ..units import LENGTH, TIME, Message, Quantity
from .loss_coefficient import (
    MOST_LEFT,
    by_launch_speed,
    hand_over_factors,
    jerk_jumps,
    jerks,
    launch_power,
    loss_coefficient,
)

# An energy drift beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a
# feature of a law.
WORST_DRIFT = 1e-8
# A stationary point this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7
# Rounding moves the middle by at most this share, where small changes grow ten million times on the way there.
LARGEST_MIDDLE = 0.1
# What rounding makes of a state, in last digits of the largest one of its motion.
ROUNDED_STATE = 256.0
# The gap is stationary at the end of a half flight when its rate there, times the time of that half, is below this
# share of the largest gap: in a mirrored motion the rate vanishes but for rounding, which is far smaller.
STATIONARY = 1e-6
# Rounding of the loss coefficient besides the errors that its parts share with alpha, in units of the last place.
LOSS_ROUNDING = 16
# Up to this many polynomials are searched together; of more, the arrays leave the processor's cache.
MOST_TOGETHER = 500
_SIDES = np.array([None, "above", "below"], dtype=object)
Violation = tuple[int, str]  # the index of the orbit, and the violation in words


@dataclass(frozen=True)
class Certificate:
    """The results of the checks of an orbit after it was found; lengths, times and forces are in the machine's units.

    family : counted on the orbit: the stationary points of the extension after lift-off up to mid-flight, less one
    residual : largest of the equations that were solved
    error : bound on |alpha - true alpha|, from an independent integration; at a fold of a family it is measured across
        the curve, and alpha itself is known to the square root of rounding only
    energy_drift : largest change of energy over flight and contact, relative to the launch's kinetic energy
    clearance : lowest interior minimum of the contact point's height in flight, None where it has none
    smallest_separation : least distance within the machine over the cycle, None where no length is stated
    smallest_contact_force : lowest interior minimum of the force in contact, None where it has none (at both ends the
        force is 0, and normally it has one maximum in between)
    largest_contact_force : its maximum, None where the contact does not end
    landing_jerk : third derivative of the contact point's height at landing; negative on a motion
    loss_coefficient : C of the one-step map alpha + d -> alpha + d - C |d|**(4/3) of plastic landings on the side of
        alpha where hops land once; on the other, where they bounce once, it is 10 C. Where a launch is more than a
        speed, a hop loses the energy C dE/dalpha |d|**(4/3) if alpha alone is changed, and C has the sign of alpha.
        None where a law has a corner at lift-off, so that the landing jerk jumps
    stable_side : "above", the side from which it attracts; None for an orbit that is no motion, where the loss is not
        known to differ from 0, and where a launch is more than a speed: `multipliers` says there what attracts
    violations : the conditions of a motion that it violates, in words; empty for an admissible orbit
    loss_error : estimate of the error of `loss_coefficient`, None where there is none
    unfolding : multiple of the energy gradient added to the equations of motion; None where this is not an unknown
    alpha_noise : standard deviation of alpha from the noise of the rows of a measured law; None without noise, where it
        is not known, and along a family
    alpha_per_noise : where that noise is not known, the standard deviation of alpha for each unit of the standard
        deviation of a row's force; else None
    bounce_side : "above" or "below", the side of alpha on which hops land with a bounce; None where the loss is not
        known to differ from 0
    bounce_factor : what a hop loses on that side over what it loses on the other, where a landing with a speed is a
        hand-over; None for 10, where it is not
    friction_needed : the largest share of the force across the ground in that along it, over the phases in which
        something stands; None where the machine does not state where its masses are across, where a foot lifts, and
        where the ground would have to pull
    friction_error, friction_time : an estimate of its error, and the time in the cycle at which it is needed first
    smallest_stance_force : the least force across the ground on what stands in flight, None where nothing does
    stance_judged : whether it is a violation that this force is not positive, None where nothing stands in flight
    """

    family: int
    residual: float
    error: float
    energy_drift: float
    clearance: float | None
    smallest_separation: float | None
    smallest_contact_force: float | None
    largest_contact_force: float | None
    landing_jerk: float
    loss_coefficient: float | None
    stable_side: str | None
    violations: tuple[str, ...]
    unfolding: float | None = None
    loss_error: float | None = None
    alpha_noise: float | None = None
    alpha_per_noise: float | None = None
    bounce_side: str | None = None
    bounce_factor: float | None = None
    friction_needed: float | None = None
    friction_error: float | None = None
    friction_time: float | None = None
    smallest_stance_force: float | None = None
    stance_judged: bool | None = None

    def __post_init__(self) -> None:
        if self.stable_side and self.bounce_side is None:
            # Files of version 0.1.0 name one side alone, the one without a bounce.
            object.__setattr__(self, "bounce_side", "below" if self.stable_side == "above" else "above")
            object.__setattr__(self, "stable_side", "above")

    def __repr__(self) -> str:
        return fields_in_line(self, "family", "error", "clearance", "loss_coefficient", "violations")


def certify(model: Model, cycles: Cycles) -> tuple[Records[Certificate], dict[int, NoOrbit]]:
    """The certificates of solved orbits (m,) of one model, and the errors, by index, of orbits that can have none."""
    curves = _curves(model, cycles)
    jerk, clearance, collisions = _gaps(model, cycles, curves)
    separation, meetings = _separations(model, cycles, curves)
    smallest_force, largest_force, pulls = _contact_forces(model, cycles, curves)
    violations: list[tuple[str, ...]] = [()] * len(cycles)
    for i, reason in (*collisions, *pulls, *meetings):
        violations[i] += (reason,)
    changes, floors, gradients = _energy_changes(model, cycles)
    slope = model.liftoff_slope(cycles.u, cycles.p) if model.liftoff_slope else None
    direction = by_launch_speed(lambda u: model.launch(u, cycles.p), cycles.u, slope)
    with np.errstate(all="ignore"):
        power = launch_power(gradients.T, direction)
        launch = 0.5 * cycles.u["alpha"] * power
        drift = changes.max(1) / launch
        loss, bounce_factor = _losses(model, cycles, jerk, power)
    finite = np.all(np.isfinite([cycles.error, cycles.residual, drift, jerk]), axis=0)
    finite &= np.all([np.isfinite(each) | (each == NONE) for each in (loss, separation, smallest_force)], axis=0)
    leaps = (changes > np.maximum(WORST_DRIFT * launch[:, None], DOUBTFUL_RATIO * floors)).any(1)
    refused = dict[int, NoOrbit]()
    for i in (~finite | leaps).nonzero()[0].tolist():
        overflow = "its numbers overflow; state the machine in units nearer to 1"
        reason = f"its energy drifts by {drift[i]:.1e}{NARROW}" if finite[i] else overflow
        refused[i] = NoOrbit(f"the orbit cannot be certified: {reason}")
    families = _families(model, curves["extension"], cycles.halves_per_flight)
    with np.errstate(all="ignore"):
        share = 4 / 3 * cycles.slope_error / np.abs(cycles.gap_slope) + LOSS_ROUNDING * EPS
        losses_off = np.where((loss == NONE) | ~np.isfinite(share), NONE, np.abs(loss) * share)
    # The sides of a loss that may be 0 are not known.
    known = (loss != NONE) & (losses_off != NONE) & (losses_off < np.abs(loss))
    motion = np.array([not each for each in violations], dtype=bool)
    columns: dict[str, Any] = {
        "family": families,
        "residual": cycles.residual,
        "error": cycles.error,
        "energy_drift": drift,
        "clearance": clearance,
        "smallest_separation": separation,
        "smallest_contact_force": smallest_force,
        "largest_contact_force": largest_force,
        "landing_jerk": -jerk,
        "loss_coefficient": loss,
        "stable_side": _SIDES[np.where(known & motion & model.one_speed, 1, 0)],
        "violations": violations,
        "unfolding": cycles.u.get("unfolding", np.full(len(cycles), NONE)),
        "loss_error": losses_off,
        "bounce_side": _SIDES[np.where(known, np.where(cycles.gap_slope > 0, 2, 1), 0)],
        "bounce_factor": bounce_factor,
    }
    return Records(Certificate, columns), refused


def _losses(model: Model, cycles: Cycles, jerk: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Loss coefficients (m,), `NONE` where the gap opens the wrong way or does not change with the launch speed, and
    where its jerk jumps; and the `bounce_factor` (m,) of each."""
    found, factors = np.full((2, len(cycles)), NONE)
    defined, shares = (jerk > 0) & (cycles.gap_slope != 0), np.zeros(len(cycles))
    defined &= ~_jerk_jumps(model, cycles, jerk)
    states = _landing_states(model, cycles)
    if model.changes_contact:
        # Where the share that is left is not known, or is nearly all, no such law holds.
        shares[:] = model.share_left(model.relabelling.image(list(states), cycles.p), cycles.p)
        defined &= shares < MOST_LEFT
    if defined.any():
        p = {name: values[defined] for name, values in cycles.p.items()}
        mass = mass_of_landing(model, states[:, defined], p, _thirds(model, cycles, jerk)[:, defined])
        loss = loss_coefficient(mass, jerk[defined], np.abs(cycles.gap_slope[defined]), power[defined])
        if model.changes_contact:
            late, early = np.transpose([hand_over_factors(max(rho, 0.0)) for rho in shares[defined].tolist()])
            loss, factors[defined] = loss * late, early / late
        found[defined] = np.where(loss == np.inf, np.nan, loss)  # a number too large is not `NONE`
    return found, factors


def _jerk_jumps(model: Model, cycles: Cycles, jerk: np.ndarray) -> np.ndarray:
    """`jerk_jumps` (m,) at the lift-offs, which the landings mirror."""
    flow, count = flow_of(model.flight, tuple(cycles.p)), len(cycles)
    if flow.is_smooth:
        return np.zeros(count, dtype=bool)
    x = cycles.halves.coefficients[cycles.halves.first[:: cycles.halves_per_flight], : flow.size, 0]
    p = vectors({name: np.broadcast_to(values, count) for name, values in cycles.p.items()}, count)
    return jerk_jumps(flow, model.gap(cycles.p).weights, x, p, jerk, EPS * cycles.gap_slope * cycles.u["alpha"])


def _thirds(model: Model, cycles: Cycles, jerk: np.ndarray) -> np.ndarray:
    """The third derivatives (1 + sticks, m) of the gap and of what sticks at landing."""
    c, first = cycles.halves.coefficients, cycles.halves.first
    return np.array([-jerk, *(6 * c[first, model.flight.states.index(name), 3] for name in model.sticks)])


def mass_of_landing(model: Model, states: np.ndarray, p: Mapping, thirds: np.ndarray) -> Any:
    """Twice the energy (m,) that landings near the orbit's lose, over the square of the gap's speed: the speeds of what
    sticks are to that as the third derivatives."""
    if model.sticking is None:
        return model.impact_mass(states, p)
    shares, masses = thirds / thirds[0], model.sticking(states, p)[1]
    return weighted_sum([weighted_sum(row, shares) for row in masses], shares)


def _landing_states(model: Model, cycles: Cycles) -> np.ndarray:
    """The flight states (n, m) at landing: mirror images of those at launch, or the starts of the halves that are
    integrated from landing backwards."""
    first = cycles.halves.first[cycles.halves_per_flight - 1 :: cycles.halves_per_flight]
    states = cycles.halves.coefficients[first, : len(model.flight.states), 0].T
    if model.reversor is None:
        return states
    return np.array(np.broadcast_arrays(*model.reversal.image(list(states), cycles.p)))


@cached
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    flow = flow_of(phase, parameters)
    x = ca.SX.sym("x", flow.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return ElementwiseFunction(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*flow.symbols(x, p)))]))


def _energy_changes(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest changes of energy on each half of a flight and on its contact, (m, halves + 1); the part of them that
    the rounding of the states explains, of the same shape; and the energy's gradients (m, n) at launch."""
    changes, floors = np.zeros((2, len(cycles), cycles.halves_per_flight + 1))
    *flown, starts = _work(model.flight, model.flight_gradient, cycles.halves, cycles.p_of_halves)
    changes[:, :-1], floors[:, :-1] = (values.reshape(len(cycles), -1) for values in flown)
    if cycles.contacts:
        stood = _work(model.contact, model.contact_gradient, cycles.contacts, cycles.p_of_contacts)
        changes[cycles.with_contact, -1], floors[cycles.with_contact, -1], _ = stood
    return changes, floors, starts[:: cycles.halves_per_flight]


@cached
def _works(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """The work of an energy gradient on straight lines and its largest component there, (start, end, parameters with
    the data of a piece)."""
    at = gradients(phase, gradient, parameters).function
    start, p = at.sx_in()
    end = ca.SX.sym("end", start.numel())
    rates = ca.horzcat(*[at(start + place * (end - start), p) for place in GAUSS_PLACES.tolist()])
    work = ca.dot(rates @ ca.DM(GAUSS_WEIGHTS), end - start)
    return ElementwiseFunction(ca.Function("works", [start, end, p], [work, ca.mmax(ca.fabs(rates))]))


def _work(phase: Phase, gradient: Callable, motions: Trajectories, p: Mapping) -> tuple[np.ndarray, ...]:
    """The largest work (m,) of the gradient along each motion, on the straight lines between the ends of its steps; the
    part of it that is rounding (m,); and the gradient at its start (m, n)."""
    flow, names, first = flow_of(phase, tuple(p)), tuple(p), motions.first
    data, states = flow.mesh_data(motions, vectors(p, len(motions))), motions.coefficients[:, : flow.size, 0]
    works, rates = _works(phase, gradient, names)(states, motions.step_ends[:, : flow.size], data)
    changes = np.cumsum(works)
    before = np.where(first > 0, changes[first - 1], 0.0)
    largest = motions.largest(changes - np.repeat(before, motions.counts))
    floors = EPS * motions.largest(states) * motions.largest(rates)
    return largest, floors, gradients(phase, gradient, names)(states[first], data[first])[0]


class _Curve(NamedTuple):
    """A function on m motions, as coefficients (N, K + 1), with its zeros or stationary points (r,).

    owner, times : the motion of each place, and the time in that motion
    rising : whether the function, or its rate, rises there
    values, ends : the function at the places (r,) and at the ends of the motions (m,)
    """

    motions: Trajectories
    series: np.ndarray
    owner: np.ndarray
    times: np.ndarray
    rising: np.ndarray
    values: np.ndarray
    ends: np.ndarray

    def lowest(self, middles: np.ndarray | None = None, sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """The lowest value (m,) of the function times a sign on each motion, and its time (m,); with `middles`, that of
        the function's minima alone, `NONE` without one, the ends of these motions (e,) being minima and no others."""
        each, among, starts, ends = np.arange(len(self.ends)), self.inside & self.rising, np.zeros(0, int), middles
        if ends is None:
            among, starts, ends = np.ones(len(self.owner), bool), each, each
        owner = np.concatenate([self.owner[among], starts, ends])
        begins = self.series[self.motions.first[starts], 0]
        values = sign * np.concatenate([self.values[among], begins, self.ends[ends]])
        times = np.concatenate([self.times[among], np.zeros(len(starts)), self.motions.ends[ends]])
        lowest, when = np.full(len(each), NONE), np.zeros(len(each))
        order = np.argsort(-values, kind="stable")  # of several assignments to one motion the last, the lowest, counts
        lowest[owner[order]], when[owner[order]] = values[order], times[order]
        return lowest, when

    @property
    def inside(self) -> np.ndarray:
        """Whether each place (r,) is not the end of its motion."""
        return self.times < self.motions.ends[self.owner] * (1 - MIDDLE)

    def at_ends(self, order: int) -> np.ndarray:
        """The derivative (m,) of this order at the ends of the motions."""
        last, size = self.motions.last, self.series.shape[1]
        # The powers of a short step come first: the coefficients of the derivative may be beyond all numbers.
        terms = self.series[last, order:] * powers(self.motions.steps[last], size - order)
        return terms @ np.prod([np.arange(order - i, size - i) for i in range(order)], axis=0)


def turns_and_zeros(sought: Mapping[Any, tuple[Trajectories, np.ndarray, bool, int]]) -> dict[Any, _Curve]:
    """Functions on motions with their zeros or stationary points, which are all found in one search.

    sought : by name the motions, the function (N, K + 1) on them, whether the zeros of its rate are sought or its own,
        and the order of the zero of the searched function at the start of each motion, which is divided out exactly
    """
    if len(sought) > 1 and sum(len(series) for _, series, *_ in sought.values()) > MOST_TOGETHER:
        return {name: turns_and_zeros({name: one})[name] for name, one in sought.items()}
    motions, series, by_rate, orders = zip(*sought.values(), strict=True)
    firsts = np.cumsum([0, *map(len, motions)])
    parts = zip(*((each.starts, each.steps, each.counts) for each in motions), strict=True)
    starts, steps, counts = map(np.concatenate, parts)
    functions, sizes = np.concatenate(series) if len(series) > 1 else series[0], np.diff(firsts)
    polynomials = PiecewisePolynomials(functions, steps, counts)
    order, rate = (np.repeat(values, sizes) for values in (orders, by_rate))
    owner, piece, t = polynomials.roots(order, stationary=rate)
    step, last = polynomials.first[owner] + piece, polynomials.last
    values, times = evaluate(functions[step], t), starts[step] + t
    ends = evaluate(functions[last], steps[last])
    places, found = np.searchsorted(owner, firsts).tolist(), dict[str, _Curve]()
    for i, name in enumerate(sought):
        here, each = slice(places[i], places[i + 1]), slice(firsts[i], firsts[i + 1])
        mine = owner[here] - firsts[i], times[here], polynomials.rising[here], values[here]
        found[name] = _Curve(motions[i], series[i], *mine, ends[each])
    return found


def extremes(motions: Trajectories, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest values (m,) on motions of a function with coefficients (N, K + 1)."""
    curve = turns_and_zeros({"all": (motions, series, True, 0)})["all"]
    return curve.lowest()[0], -curve.lowest(sign=-1.0)[0]


def _curves(model: Model, cycles: Cycles) -> dict[str, _Curve]:
    """The functions on the motions that a certificate checks: gap, force, separations and the extension with their
    stationary points, and the forces with their zeros too."""
    halves, contacts, distance = cycles.halves, cycles.contacts, model.separation(cycles.p_of_halves)
    # Each half starts from a zero of order three of the gap, so of order two of its rate, and the contact force from a
    # simple one.
    gap, extension = halves.series(model.gap(cycles.p_of_halves)), halves.series(model.extension)
    sought = {"gap": (halves, gap, True, 2), "extension": (halves, extension, True, 0)}
    if model.landing_gap:
        sought["landing gap"] = (halves, halves.series(model.landing_gap(cycles.p_of_halves)), True, 0)
    if distance:
        for i, motions in enumerate(cycles.flown(model)):
            sought[f"separation {i}"] = (motions, motions.series(distance), True, 0)
    for name, height in _above_ground(model, cycles.p_of_halves).items():
        for i, motions in enumerate(cycles.flown(model)):
            sought[f"{name} {i}"] = (motions, motions.series(height), True, 0)
    if contacts:
        for name, order in _forces_of(model).items():
            force = contacts.coefficients[:, contacts.names.index(name)]
            sought[name], sought[f"zeros of {name}"] = (contacts, force, True, 0), (contacts, force, False, order)
        if distance:
            apart = model.separation(cycles.p_of_contacts)
            for i, motions in enumerate(cycles.stood(model)):
                sought[f"separation in contact {i}"] = (motions, motions.series(apart, model.embed), True, 0)
        for name, height in _above_ground(model, cycles.p_of_contacts).items():
            for i, motions in enumerate(cycles.stood(model)):
                sought[f"{name} in contact {i}"] = (motions, motions.series(height, model.embed), True, 0)
    return turns_and_zeros(sought)


def _above_ground(model: Model, p: Mapping) -> dict[str, Any]:
    """The heights that have to stay above the ground, by the words of their violation: of machines that move along it
    those of all that does not land."""
    gap, each = model.gap(p), model.heights(p).items() if model.sticks else ()
    return {f"{name} touches the ground": height for name, height in each if not _is_gap(height, gap)}


def _is_gap(height: Affine | StateFormula, gap: Affine) -> bool:
    """Whether a height is the gap, whose weights are numbers."""
    if isinstance(height, StateFormula) or any(map(np.ndim, (*height.weights, height.offset))):
        return False
    return height == gap


def _forces_of(model: Model) -> dict[str, int]:
    """The forces that have to press in contact, each with the order of its zero where the contact begins: only on the
    point that has landed it vanishes there."""
    return {CONTACT_FORCE: 0, LANDED_FORCE: 1} if model.changes_contact else {CONTACT_FORCE: 1}


def count_families(model: Model, halves: Trajectories, per_flight: int) -> np.ndarray:
    """The families of flights: the stationary points of the extension between lift-off and mid-flight; `per_flight` of
    the halves belong to each flight."""
    found = turns_and_zeros({"extension": (halves, halves.series(model.extension), True, 0)})
    return _families(model, found["extension"], per_flight)


def _families(model: Model, extension: _Curve, per_flight: int) -> np.ndarray:
    """`count_families` from the stationary points of the extension. The one left out is mid-flight, where the extension
    is stationary unless the second half has another one."""
    rest, rate, ends = np.abs(extension.at_ends(1)), np.abs(extension.at_ends(2)), extension.motions.ends
    # Rounding moves mid-flight where the extension is nearly constant there.
    moved = np.divide(2 * rest, rate, out=np.zeros(len(ends)), where=rate > 0)
    middle = np.clip(moved, MIDDLE * ends, LARGEST_MIDDLE * ends) if model.turns_midway else 0.0 * ends
    owner = extension.owner[extension.times < (ends - middle)[extension.owner]] // per_flight
    return np.bincount(owner, minlength=len(extension.motions) // per_flight) // per_flight


def _gaps(model: Model, cycles: Cycles, curves: Mapping[str, _Curve]) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """Jerks of the gap at lift-off (m,), the lowest interior minima (m,) of the gaps, `NONE` without one, and their
    violations."""
    halves, gap = cycles.halves, curves["gap"]
    jerk = (6 * gap.series[halves.first, 3]).reshape(-1, cycles.halves_per_flight).min(1)
    if cycles.halves_per_flight == 1 and not flow_of(model.flight, tuple(cycles.p)).is_smooth:
        jerk = _jerks_at_launch(model, cycles)
        gap = _without_rounding(gap, jerk)
    # The end of a half, mid-flight, may be a minimum too.
    still = np.abs(gap.at_ends(1)) * halves.ends < STATIONARY * halves.largest(gap.series[:, :1])
    middles = ((gap.at_ends(2) > 0) & still).nonzero()[0]
    clearance, when = _least_of_halves(cycles, *gap.lowest(middles))
    violations = list[Violation]()
    for i in (jerk <= 0).nonzero()[0].tolist():
        text = "the gap opens the wrong way at landing (landing jerk {jerk:.3g}, must be negative)"
        violations.append((i, Message(text, jerk=Quantity(-jerk[i], "landing_jerk"))))
    lowest = {"gap": (clearance, when)}
    if landing := curves.get("landing gap"):  # which is open at the start, and is as wide as the gap in mid-flight
        lowest["landing gap"] = landing.lowest()
        clearance = np.minimum(clearance, landing.lowest(np.zeros(0, int))[0])
    text = "{meets} at t = {time:.6g} of the flight (height {height:.3g})"
    for name, (heights, times) in lowest.items():
        for i in (heights <= 0).nonzero()[0].tolist():
            time, height = Quantity(times[i], TIME), Quantity(heights[i], "clearance")
            violations.append((i, Message(text, meets=model.violations[name], time=time, height=height)))
    return jerk, clearance, violations


def _jerks_at_launch(model: Model, cycles: Cycles) -> np.ndarray:
    """The jerks (m,) of the gap at lift-off by the equations of motion."""
    flow, halves = flow_of(model.flight, tuple(cycles.p)), cycles.halves
    x = halves.coefficients[halves.first, : flow.size, 0]
    return jerks(flow, model.gap(cycles.p).weights, x, vectors(cycles.p_of_halves, len(halves)))


def _without_rounding(gap: _Curve, jerk: np.ndarray) -> _Curve:
    """The gaps without stationary points at which rounding decides on their signs: so soon after lift-off that gaps
    with these jerks (m,) are less than what rounding makes of the states."""
    rounding = ROUNDED_STATE * EPS * gap.motions.largest(gap.motions.coefficients[:, :, 0])
    opened = np.cbrt(6 * rounding / np.maximum(jerk, rounding))
    later = gap.times > opened[gap.owner]
    owner, times, rising, values = (each[later] for each in (gap.owner, gap.times, gap.rising, gap.values))
    return gap._replace(owner=owner, times=times, rising=rising, values=values)


def _least_of_halves(cycles: Cycles, values: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least (m,) of the values on the halves of each flight, and its time (m,) in the flight."""
    values, times = (array.reshape(-1, cycles.halves_per_flight) for array in (values, times))
    half, each = values.argmin(1), np.arange(len(values))
    when = times[each, half]
    return values[each, half], np.where(half == 0, when, cycles.flight_times - when)


def _contact_forces(
    model: Model, cycles: Cycles, curves: Mapping[str, _Curve]
) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """The lowest interior minima (m,) of the contact forces, and their peaks (m,), `NONE` where there are none; and the
    contacts that do not end or that have to pull."""
    (least, peaks), violations = np.full((2, len(cycles)), NONE), [*cycles.without_contact.items()]
    if not cycles.contacts:
        return least, peaks, violations
    contacts, these, highest = cycles.contacts, cycles.with_contact, list[np.ndarray]()
    for name, order in _forces_of(model).items():
        force, zeros = curves[name], curves[f"zeros of {name}"]
        pulls = model.violations["landed pull" if name == LANDED_FORCE else "pull"]
        # Mid-contact itself may be a minimum.
        still = model.reversor is not None and not model.changes_contact
        middles = (force.at_ends(2) > 0).nonzero()[0] if still else np.zeros(0, int)
        least[these] = np.minimum(least[these], force.lowest(middles)[0])
        highest.append(-force.lowest(sign=-1.0)[0])
        # A whole contact ends on another zero of the force than the one that it starts from.
        inside = np.full(len(zeros.times), True) if model.reversor else zeros.inside
        owner, times = zeros.owner[inside][::-1].tolist(), zeros.times[inside][::-1].tolist()
        pulling = dict(zip(owner, times, strict=True))  # the first of each
        at_once = force.series[contacts.first, order] <= 0
        at_once[[*pulling]] = False
        places = [(int(these[i]), time) for i, time in sorted(pulling.items())]
        text = "{pulls} in contact at t = {time:.6g}"
        violations += [(i, Message(text, pulls=pulls, time=Quantity(time, TIME))) for i, time in places]
        text = "{pulls} as soon as the contact begins"
        violations += [(i, Message(text, pulls=pulls)) for i in these[at_once].tolist()]
    peaks[these] = highest[0] if len(highest) == 1 else np.maximum(*highest)
    return least, peaks, violations


def _separations(model: Model, cycles: Cycles, curves: Mapping[str, _Curve]) -> tuple[np.ndarray, list[Violation]]:
    """Least separations (m,) over the cycles, and the orbits where they, or heights above the ground, are not positive;
    where the contact does not end, the flight is checked all the same."""
    found, violations = np.full(len(cycles), NONE), list[Violation]()
    if "separation 0" in curves:
        found, violations = _least_of_all(cycles, curves, "separation", model.violations["separation"], "separation")
    for name in _above_ground(model, cycles.p):
        violations += _least_of_all(cycles, curves, name, name, "height")[1]
    return found, violations


def _least_of_all(
    cycles: Cycles, curves: Mapping[str, _Curve], of: str, words: str, what: str
) -> tuple[np.ndarray, list[Violation]]:
    """The least values (m,) of one function over the cycles, and those that are not positive as violations in words."""
    found = np.full(len(cycles), NONE)
    least, when = _least_of_halves(cycles, *curves[f"{of} 0"].lowest())
    where, everything = np.full(len(cycles), "flight", dtype=object), np.arange(len(cycles))
    for name, phase, owners, wholes in (
        (f"{of} 1", "flight", everything, cycles.flight_times),
        (f"{of} in contact 0", "contact", cycles.with_contact, None),
        (f"{of} in contact 1", "contact", cycles.with_contact, cycles.contact_times),
    ):
        if name in curves:
            low, times = curves[name].lowest()
            lower = low < least[owners]
            these = owners[lower]
            times = times if wholes is None else wholes[owners] - times
            least[these], where[these], when[these] = low[lower], phase, times[lower]
    found[cycles.with_contact] = least[cycles.with_contact]
    violations = list[Violation]()
    for i in (~(least > 0)).nonzero()[0].tolist():
        text, time = "{meets} at t = {time:.6g} of the {phase} ({what} {least:.3g})", Quantity(when[i], TIME)
        numbers = {"time": time, "phase": where[i], "what": what, "least": Quantity(least[i], LENGTH)}
        violations.append((i, Message(text, meets=words, **numbers)))
    return found, violations
