"""The certificate of an orbit: what was measured of it after it was solved, and whether it is a motion."""

from dataclasses import dataclass

import numpy as np

from ..errors import NoOrbit
from ..model.model import Model
from .admissibility import admissibility, count_families
from .energy import energy_changes
from .error_bound import DOUBTFUL_RATIO, NARROW
from .local_law import by_launch_speed, launch_power, loss_coefficient
from .solution import NONE, Cycles, or_none

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
    checked = admissibility(model, cycles)
    changes, floors, gradients = energy_changes(model, cycles)
    direction = by_launch_speed(lambda u: model.launch(u, cycles.p), cycles.u)
    with np.errstate(all="ignore"):
        power = launch_power(gradients.T, direction)
        launch = 0.5 * cycles.u["alpha"] * power
        drift = changes.max(1) / launch
        loss = _losses(model, cycles, checked.jerk, power)
    finite = np.all(np.isfinite([cycles.error, cycles.residual, drift, checked.jerk]), axis=0)
    for values in (loss, checked.separation, checked.smallest_force):
        finite &= np.isfinite(values) | (values == NONE)
    leaps = (changes > np.maximum(WORST_DRIFT * launch[:, None], DOUBTFUL_RATIO * floors)).any(1)
    for i in np.flatnonzero(~finite | leaps).tolist():
        reason = "its numbers overflow; state the machine in units nearer to 1"
        if finite[i]:
            reason = f"its energy drifts by {drift[i]:.1e}{NARROW}"
        raise NoOrbit(f"the orbit cannot be certified: {reason}").about(i)
    figures = {
        "family": count_families(model, cycles.halves, cycles.halves_per_flight),
        "residual": cycles.residual.tolist(),
        "error": cycles.error.tolist(),
        "energy_drift": drift.tolist(),
        "clearance": or_none(checked.clearance),
        "smallest_separation": or_none(checked.separation),
        "smallest_contact_force": or_none(checked.smallest_force),
        "largest_contact_force": or_none(checked.largest_force),
        "landing_jerk": (-checked.jerk).tolist(),
        "loss_coefficient": or_none(loss),
        "stable_side": _stable_sides(loss, cycles.gap_slope),
        "violations": checked.violations,
        "unfolding": cycles.u["unfolding"].tolist() if "unfolding" in cycles.u else [None] * len(cycles),
    }
    return [Certificate(*row) for row in zip(*(figures[name] for name in CERTIFICATE_FIELDS), strict=True)]


def _losses(model: Model, cycles: Cycles, jerk: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Loss coefficients (m,), `NONE` where the gap opens the wrong way or does not change with the launch speed."""
    found, defined = np.full(len(cycles), NONE), (jerk > 0) & (cycles.gap_slope != 0)
    if defined.any():
        mass = model.impact_mass({name: values[defined] for name, values in cycles.p.items()})
        slope = np.abs(cycles.gap_slope[defined])
        loss = loss_coefficient(mass, jerk[defined], slope, power[defined])
        found[defined] = np.where(loss == np.inf, np.nan, loss)  # a number too large is not `NONE`
    return found


def _stable_sides(loss: np.ndarray, gap_slope: np.ndarray) -> list[str | None]:
    """On which side of alpha launches come nearer to it; None where nothing is lost."""
    sides = np.where(gap_slope > 0, "above", "below").astype(object)
    sides[(loss == NONE) | (loss == 0)] = None
    return sides.tolist()
