"""The certificate of an orbit: its properties computed from its motions alone, and the violated conditions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import NoOrbit
from ..flow import flow_of
from ..io import fields_in_line
from ..model import Model, weighted_sum
from ..records import NONE, Records
from ..shooting import EPS, ERRORS, NARROW, Cycles, vectors
from .energy_changes import energy_changes
from .loss_coefficient import (
    LOSSES,
    bounce_factors,
    by_launch_speed,
    hand_over_factors,
    jerk_jumps,
    launch_power,
    loss_coefficient,
)
from .motion_conditions import checked_functions, contact_forces_of, families_of, gaps_of, separations_of

# An energy drift beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a
# feature of a law.
WORST_DRIFT = 1e-8
# Rounding of the loss coefficient besides the errors that its parts share with alpha, in units of the last place.
LOSS_ROUNDING = 16
_SIDES = np.array([None, "above", "below"], dtype=object)


@dataclass(frozen=True)
class Certificate:
    """The results of the checks of an orbit after it was found; lengths, times and forces are in the machine's units.

    family : counted on the orbit: one less than the number of stationary points of the extension from lift-off to
        mid-flight
    residual : largest of the equations that were solved
    error : bound on |alpha - true alpha|, from an independent integration. At a fold of a family it is measured across
        the curve, and alpha itself is known only to the square root of rounding
    energy_drift : largest change of energy over flight and contact, relative to the launch's kinetic energy
    clearance : lowest interior minimum of the contact point's height in flight, and of the height in contact of the
        point that lands next if that is another one; None if there is no minimum
    smallest_separation : least distance within the machine over the cycle; None where no length is stated
    smallest_contact_force : lowest interior minimum of the force in contact; None if it has none (the force is 0 at
        both ends, and normally has one maximum in between). Of a machine that sticks and stands in flight, it is
        the least force on a foot over the cycle, without the instants at which the foot lands or lifts off
    largest_contact_force : its maximum; None where the contact does not end
    landing_jerk : third derivative of the contact point's height at landing; negative on a motion
    loss_coefficient : C of the one-step map alpha + d -> alpha + d - C |d|**(4/3) of plastic landings, on the side of
        alpha where hops land once; on the other side, where they bounce once, it is 10 C. Where a launch has several
        numbers, a hop loses the energy C dE/dalpha |d|**(4/3) if only alpha changes, and C has the sign of alpha. None
        where a law has a corner at lift-off, so that the landing jerk jumps
    stable_side : "above", the side from which the orbit attracts if impacts lose energy, that is, unless the
        restitution is 1; `attraction_width` is how far. None for an orbit that is not a motion, where the loss is not
        known to differ from 0, and where a launch has several numbers: there `multipliers` determines the stability
    violations : the conditions of a motion that it violates, in words; empty for an admissible orbit
    loss_error : estimate of the error of `loss_coefficient`; None without one
    unfolding : multiple of the energy gradient added to the equations of motion; None where this is not an unknown
    alpha_noise : standard deviation of alpha due to the noise of the rows of a measured law; None without noise, where
        it is not known, and along a family
    alpha_per_noise : where the noise is not known, the standard deviation of alpha per unit of the standard deviation
        of a row's force; else None
    bounce_side : "above" or "below", the side of alpha on which hops land with a bounce; None where the loss is not
        known to differ from 0
    bounce_factor : the loss of a hop on that side over its loss on the other side, if a landing with a speed changes
        the standing foot; None means 10, the factor of all other machines
    friction_needed : the coefficient of friction that the orbit needs: the largest ratio of the force along the ground
        to the force across it, while a foot stands. None where the machine does not state the horizontal places of its
        masses, where a foot lifts, and where the ground would have to pull
    friction_error, friction_time : an estimate of its error, and the first time in the cycle at which it is needed
    smallest_stance_force : the least force across the ground on the foot that stands in flight; None if none stands
    stance_judged : whether a force that is not positive there is a violation; None if no foot stands in flight
    robustness : how far above alpha launches converge to the orbit with plastic landings (restitution 0), to leading
        order: the `attraction_width()`, an estimate that is valid up to some 5 % of alpha; None if the orbit is not
        known to attract
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
    robustness: float | None = None

    def __post_init__(self) -> None:
        if self.stable_side and self.bounce_side is None:
            # Files of version 0.1.0 name one side alone, the one without a bounce.
            object.__setattr__(self, "bounce_side", "below" if self.stable_side == "above" else "above")
            object.__setattr__(self, "stable_side", "above")

    def losses_in_words(self, restitution: float) -> str:
        """The note of a table on the losses of hops on both sides of the orbit, for impacts with this restitution;
        empty where the loss is not known to differ from 0."""
        if (factors := self._factors(restitution)) is None:
            return "   (of plastic landings)" if restitution else ""
        above, below = (f"{each:.4g} C" for each in factors)
        if restitution:
            return f"   (of plastic landings; with restitution {restitution:g}, {above} above and {below} below)"
        return f"   ({above} above)" if self.bounce_side == "above" else f"   ({below} below)"

    def attraction_width(self, restitution: float = 0.0) -> float | None:
        """How far above alpha launches converge to the orbit, to leading order, for impacts with this restitution.

        A launch alpha + d loses c d**(4/3), with c = C, or 10 C where it bounces, and stays above alpha for d below
        c**-3. This width is returned, in the unit of launch speeds; None if the orbit is not known to attract. It is an
        estimate for widths far below alpha; `ReturnMap.basin` computes the true width from the map.
        """
        if not self.stable_side or not self.loss_coefficient or (factors := self._factors(restitution)) is None:
            return None
        lost = factors[0] * self.loss_coefficient
        return 1 / lost / lost / lost

    def _factors(self, restitution: float) -> tuple[float, float] | None:
        """What hops lose above and below the orbit as multiples of C, where impacts have this restitution; None where
        it is not known."""
        if self.bounce_side is None or restitution > LOSSES.most_left**2:
            return None
        late, early = bounce_factors(restitution) if restitution else (1.0, self.bounce_factor or 10.0)
        return (early, late) if self.bounce_side == "above" else (late, early)

    def __repr__(self) -> str:
        return fields_in_line(self, "family", "error", "clearance", "loss_coefficient", "violations")


def certify(model: Model, cycles: Cycles) -> tuple[Records[Certificate], dict[int, NoOrbit]]:
    """The certificates of solved orbits (m,) of one model, and the errors, by index, of orbits that can have none."""
    curves = checked_functions(model, cycles)
    jerk, clearance, collisions = gaps_of(model, cycles, curves)
    separation, meetings = separations_of(model, cycles, curves)
    smallest_force, largest_force, pulls = contact_forces_of(model, cycles, curves)
    violations: list[tuple[str, ...]] = [()] * len(cycles)
    for i, reason in (*collisions, *pulls, *meetings):
        violations[i] += (reason,)
    changes, floors, gradients = energy_changes(model, cycles)
    slope = model.liftoff_slope(cycles.u, cycles.p) if model.liftoff_slope else None
    direction = by_launch_speed(lambda u: model.launch(u, cycles.p), cycles.u, slope)
    with np.errstate(all="ignore"):
        power = launch_power(gradients.T, direction)
        launch = 0.5 * cycles.u["alpha"] * power
        drift = changes.max(1) / launch
        loss, bounce_factor = _losses(model, cycles, _jerk_of_gap(model, cycles, jerk), power)
    finite = np.all(np.isfinite([cycles.error, cycles.residual, drift, jerk]), axis=0)
    finite &= np.all([np.isfinite(each) | (each == NONE) for each in (loss, separation, smallest_force)], axis=0)
    leaps = (changes > np.maximum(WORST_DRIFT * launch[:, None], ERRORS.doubtful_ratio * floors)).any(1)
    refused = dict[int, NoOrbit]()
    for i in (~finite | leaps).nonzero()[0].tolist():
        overflow = "its numbers overflow; choose units that make the machine's numbers nearer to 1"
        reason = f"its energy drifts by {drift[i]:.1e}{NARROW}" if finite[i] else overflow
        refused[i] = NoOrbit(f"the orbit cannot be certified: {reason}")
    families = families_of(model, curves["extension"], cycles.halves_per_flight)
    with np.errstate(all="ignore"):
        share = 4 / 3 * cycles.slope_error / np.abs(cycles.gap_slope) + LOSS_ROUNDING * EPS
        losses_off = np.where((loss == NONE) | ~np.isfinite(share), NONE, np.abs(loss) * share)
    # The sides of a loss that may be 0 are not known.
    known = (loss != NONE) & (losses_off != NONE) & (losses_off < np.abs(loss))
    attracts = known & np.array([not each for each in violations], dtype=bool) & model.one_speed
    with np.errstate(all="ignore"):
        lost = loss * np.where(cycles.gap_slope > 0, 1.0, np.where(bounce_factor == NONE, 10.0, bounce_factor))
        robustness = np.where(attracts, 1 / lost**3, NONE)
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
        "stable_side": _SIDES[np.where(attracts, 1, 0)],
        "violations": violations,
        "unfolding": cycles.u.get("unfolding", np.full(len(cycles), NONE)),
        "loss_error": losses_off,
        "bounce_side": _SIDES[np.where(known, np.where(cycles.gap_slope > 0, 2, 1), 0)],
        "bounce_factor": bounce_factor,
        "robustness": robustness,
    }
    return Records(Certificate, columns), refused


def _jerk_of_gap(model: Model, cycles: Cycles, jerk: np.ndarray) -> np.ndarray:
    """The jerks (m,) of the gap's coordinate at lift-off, from those of the height of the contact point."""
    if model.height is None:
        return jerk
    each = slice(None, None, cycles.halves_per_flight)
    return 6 * cycles.halves.series(model.gap(cycles.p_of_halves), steps=cycles.halves.first)[each, 3]


def _losses(model: Model, cycles: Cycles, jerk: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Loss coefficients (m,), `NONE` where the gap opens the wrong way or does not change with the launch speed, and
    where its jerk jumps; and the `bounce_factor` (m,) of each."""
    found, factors = np.full((2, len(cycles)), NONE)
    defined, shares = (jerk > 0) & (cycles.gap_slope != 0), np.zeros(len(cycles))
    defined &= ~_jerk_jumps(model, cycles, jerk)
    states = _landing_states(model, cycles)
    if model.changes_contact and not model.sticks:
        # Where the share that is left is not known, or is nearly all, no such law holds.
        shares[:] = model.share_left(model.relabelling.image(list(states), cycles.p), cycles.p)
        defined &= shares < LOSSES.most_left
    if defined.any():
        p = {name: values[defined] for name, values in cycles.p.items()}
        mass = mass_of_landing(model, states[:, defined], p, _thirds(model, cycles, jerk)[:, defined])
        loss = loss_coefficient(mass, jerk[defined], np.abs(cycles.gap_slope[defined]), power[defined])
        if model.changes_contact and not model.sticks:
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
    gap = jerk if model.grazes else -jerk  # the reversor keeps the jerk of a coordinate that it turns over
    return np.array([gap, *(6 * c[first, model.flight.states.index(name), 3] for name in model.sticks)])


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
