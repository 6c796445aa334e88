"""The certificate of an orbit: what was measured of it after it was solved, and whether it is a motion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..flow.flow import flow_of
from ..flow.trajectory import Trajectories
from ..model.model import Model
from ..model.phase import Phase
from ..numerics.quadrature import GAUSS, GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic.calls import ElementwiseFunction
from .admissibility import admissibility, count_families
from .error_bound import DOUBTFUL_RATIO, EPS, NARROW, ends_of_steps
from .formulations import NONE, Cycles, columns, or_none
from .local_law import by_launch_speed, launch_power, loss_coefficient

# An energy drift beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a
# feature of a law.
WORST_DRIFT = 1e-8


@dataclass(frozen=True)
class Certificate:
    """What was checked of an orbit after it was found; lengths, times and forces are in the machine's units.

    family : measured: the stationary points of the extension from lift-off to mid-flight, less one
    residual : largest of the equations that were solved
    error : bound on |alpha - true alpha|, from an independent integration; at a fold of a family it is measured across
        the curve, and alpha itself is known to the square root of rounding only
    energy_drift : largest change of energy over flight and contact, relative to the launch's kinetic energy
    clearance : lowest interior minimum of the contact point's height in flight, None where it has none
    smallest_separation : least distance within the machine over the cycle, None where no length is stated
    smallest_contact_force : lowest interior minimum of the force in contact, None where it has none (at both ends the
        force is 0, and normally it rises to one peak in between)
    largest_contact_force : its peak, None where the contact does not end
    landing_jerk : third derivative of the contact point's height at landing; negative on a motion
    loss_coefficient : C of the one-step map alpha + d -> alpha + d - C d**(4/3) on the stable side, 10 C on the other
    stable_side : "above" or "below" alpha
    violations : what makes it no motion, in words; empty for an admissible orbit
    unfolding : multiple of the energy gradient that the equations needed, None where they had no such unknown
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


# The names of the fields, in their order.
CERTIFICATE_FIELDS = tuple(Certificate.__dataclass_fields__)


def certify(model: Model, cycles: Cycles) -> list[Certificate]:
    """The certificates of solved orbits of one model; raises `NoOrbit` about the first that can have none."""
    jerk, clearance, smallest_force, largest_force, separation, violations = admissibility(model, cycles)
    changes, floors, gradients = _energy_changes(model, cycles)
    direction = by_launch_speed(lambda u: model.launch(u, cycles.p), cycles.u)
    with np.errstate(all="ignore"):
        power = launch_power(gradients.T, direction)
        launch = 0.5 * cycles.u["alpha"] * power
        drift = changes.max(1) / launch
        loss = _losses(model, cycles, jerk, power)
    finite = np.all(np.isfinite([cycles.error, cycles.residual, drift, jerk]), axis=0)
    finite &= np.all([np.isfinite(each) | (each == NONE) for each in (loss, separation, smallest_force)], axis=0)
    leaps = (changes > np.maximum(WORST_DRIFT * launch[:, None], DOUBTFUL_RATIO * floors)).any(1)
    for i in np.flatnonzero(~finite | leaps).tolist():
        overflow = "its numbers overflow; state the machine in units nearer to 1"
        reason = f"its energy drifts by {drift[i]:.1e}{NARROW}" if finite[i] else overflow
        raise NoOrbit(f"the orbit cannot be certified: {reason}").about(i)
    sides = np.where(cycles.gap_slope > 0, "above", "below").astype(object)
    sides[(loss == NONE) | (loss == 0)] = None
    families = count_families(model, cycles.halves, cycles.halves_per_flight)
    figures = (cycles.residual, cycles.error, drift, clearance, separation, smallest_force, largest_force, -jerk, loss)
    unfolding = cycles.u["unfolding"].tolist() if "unfolding" in cycles.u else [None] * len(cycles)
    rows = zip(families, *map(or_none, figures), sides.tolist(), violations, unfolding, strict=True)
    return [Certificate(*row) for row in rows]


def _losses(model: Model, cycles: Cycles, jerk: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Loss coefficients (m,), `NONE` where the gap opens the wrong way or does not change with the launch speed."""
    found, defined = np.full(len(cycles), NONE), (jerk > 0) & (cycles.gap_slope != 0)
    if defined.any():
        mass = model.impact_mass({name: values[defined] for name, values in cycles.p.items()})
        loss = loss_coefficient(mass, jerk[defined], np.abs(cycles.gap_slope[defined]), power[defined])
        found[defined] = np.where(loss == np.inf, np.nan, loss)  # a number too large is not `NONE`
    return found


@lru_cache(maxsize=64)
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    flow = flow_of(phase, parameters)
    x = ca.SX.sym("x", flow.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return ElementwiseFunction(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*flow.symbols(x, p)))]))


def _energy_changes(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest changes of energy on each half of a flight and on its contact, (m, halves + 1); how much of them the
    rounding of the states explains, of the same shape; and the energy's gradients (m, n) at launch."""
    changes, floors = np.zeros((2, len(cycles), cycles.halves_per_flight + 1))
    *flown, starts = _work(model.flight, model.flight_gradient, cycles.halves, cycles.p_of_halves)
    changes[:, :-1], floors[:, :-1] = (values.reshape(len(cycles), -1) for values in flown)
    if cycles.contacts:
        stood = _work(model.contact, model.contact_gradient, cycles.contacts, cycles.p_of_contacts)
        changes[cycles.with_contact, -1], floors[cycles.with_contact, -1], _ = stood
    return changes, floors, starts[:: cycles.halves_per_flight]


def _work(phase: Phase, gradient: Callable, motions: Trajectories, p: Mapping) -> tuple[np.ndarray, ...]:
    """The largest work (m,) of the gradient along each motion, on the straight lines between the ends of its steps; how
    much of that is rounding (m,); and the gradient at its start (m, n)."""
    flow, call = flow_of(phase, tuple(p)), gradients(phase, gradient, tuple(p))
    n, data = flow.size, flow.data_of(motions, columns(p.values()))
    states = motions.coefficients[:, :n, 0]
    moves = ends_of_steps(motions, n) - states
    points = states[:, None] + GAUSS_PLACES[:, None] * moves[:, None]
    rates = call(points.reshape(-1, n), np.repeat(data, GAUSS, axis=0))[0].reshape(-1, GAUSS, n)
    changes = np.cumsum(((GAUSS_WEIGHTS @ rates) * moves).sum(1))
    before = np.where(motions.first > 0, changes[motions.first - 1], 0.0)
    largest = motions.largest(changes - np.repeat(before, motions.counts))
    floors = EPS * motions.largest(states) * motions.largest(rates)
    return largest, floors, call(states[motions.first], data[motions.first])[0]
