"""The orbits of many machines that differ in numbers alone: guessed, solved, measured and certified together.

Each is found as `find` finds it, from its own guess, so that no answer depends on what else is asked. Where that does
not lead to a certified orbit of the family at once, `find` is left to decide.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..model.model import Model
from ..model.units import DIMENSIONS, LENGTH, Units
from .certificate import Certificate, certify, extremes
from .error_bound import error_bounds
from .find import MAX_CORRECTION
from .formulations import Cycles, equations_of, interpret
from .newton_kernel import NewtonKernel, Solutions, newton_kernel
from .single_shooting import SMALLEST_UNIT, Evaluation, Shooting


class Orbits(NamedTuple):
    """Certified orbits of one family, without units: which of the machines (k,) have them, the orbits as arrays, and
    their certificates."""

    which: np.ndarray
    cycles: Cycles
    certificates: list[Certificate]


def orbits_of_many(model: Model, names: Sequence[str], ps: np.ndarray, family: int) -> Orbits | None:
    """The orbits of a family of machines with parameters (m, np); None where none is found at once.

    The machines left out have no such orbit, or one that takes more than its guess and Newton's method, and are for
    `find` to decide.
    """
    if model.guesses is None:
        return None
    guess = model.guesses(family, dict(zip(names, ps.T, strict=True)))
    which = np.flatnonzero(np.isfinite(guess["alpha"]))
    method = "relative" if model.reduction else "half orbit"
    equations = equations_of(model, method, tuple(names))
    if not (len(which) and len(equations.flows) == 1 and equations.smooth):
        return None
    us, ps = np.column_stack([guess[name][which] for name in equations.statement.unknowns]), ps[which]
    solved, us, evaluation = _solved_together(model, equations, us, ps)
    if not len(solved):
        return None
    assert evaluation is not None
    return _certified(model, method, equations, which[solved], us, ps[solved], evaluation, family)


def _solved_together(
    model: Model, equations: Shooting, us: np.ndarray, ps: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Evaluation | None]:
    """Which of the guesses (m, n) lead to a solution, these (k, n), and the equations there; the homotopy, if any, is
    taken in one step, which is the first that `find` tries."""
    along = model.homotopy or equations.parameters[0]
    kernel, place = newton_kernel(equations, along), equations.parameters.index(along)
    if model.homotopy is None:
        found = _at_value(kernel, us, ps, place, record=True)
        return found.which, found.xs[:, :-1], found.evaluation
    before = ps.copy()
    before[:, place] = 0.0
    first = _at_value(kernel, us, before, place, record=False)
    guesses = first.xs[:, :-1] + first.directions[:, :-1]
    positive = [equations.statement.unknowns.index(name) for name in ("alpha", "duration")]
    ahead = np.flatnonzero((guesses[:, positive] > 0).all(axis=1))
    found = _at_value(kernel, guesses[ahead], ps[first.which[ahead]], place, record=True)
    which, xs = ahead[found.which], found.xs[:, :-1]
    near = (np.abs(xs - guesses[which])[:, positive] <= MAX_CORRECTION * np.abs(xs[:, positive])).all(axis=1)
    evaluation = found.evaluation and found.evaluation[np.flatnonzero(near)]
    return first.which[which[near]], xs[near], evaluation


def _at_value(kernel: NewtonKernel, us: np.ndarray, ps: np.ndarray, place: int, record: bool) -> Solutions:
    """The solutions that Newton's method comes to from guesses (m, n), all parameters (m, np) held."""
    xs = np.column_stack([us, ps[:, place]])
    rows, units = np.zeros(xs.shape), np.maximum(np.abs(xs), SMALLEST_UNIT)
    rows[:, -1] = 1.0
    return kernel(xs, rows, ps[:, place], units, ps, 1, record)


def _certified(
    model: Model, method: str, equations: Shooting, which: np.ndarray, us: np.ndarray, ps: np.ndarray,
    evaluation: Evaluation, family: int,
) -> Orbits | None:  # fmt: skip
    """The solutions (k, n) of the family that can be certified."""
    closing = np.tile(np.eye(us.shape[1] + 1)[-1], (len(us), 1))
    errors, refused = error_bounds(equations, us, ps, evaluation, closing, quickly=True)
    kept = np.delete(np.arange(len(us)), list(refused))
    while len(kept):
        parts = us[kept], ps[kept], evaluation[kept], errors[kept]
        try:
            cycles = interpret(model, method, equations, *parts)
            certificates = certify(model, cycles)
        except NoOrbit as error:
            if error.index is None:
                raise
            kept = np.delete(kept, error.index)
            continue
        others = [i for i, certificate in enumerate(certificates) if certificate.family != family]
        if not others:
            return Orbits(which[kept], cycles, certificates)
        kept = np.delete(kept, others)
    return None


# Quantities of orbits that are found together, besides the rises of the heights; they are those of `orbits.quantities`.
NUMBERS_OF_MANY = (
    *("alpha", "flight_time", "contact_time", "period", "liftoff_extension", "error", "clearance", "stroke"),
    *("smallest_separation", "smallest_contact_force", "largest_contact_force", "landing_jerk", "loss_coefficient"),
)


def numbers_of(model: Model, orbits: Orbits, units: Units | None, wanted: Collection[str]) -> dict[str, np.ndarray]:
    """Some of `NUMBERS_OF_MANY` and the rises (k,) of orbits, NaN for one that has none; in SI by units (k,)."""
    cycles, certificates = orbits.cycles, orbits.certificates
    contact = np.where(np.isfinite(cycles.contact_times), cycles.contact_times, np.nan)
    found = {"alpha": cycles.u["alpha"], "liftoff_extension": cycles.u["liftoff"], "flight_time": cycles.flight_times}
    found |= {"contact_time": contact, "period": cycles.flight_times + contact}
    if "stroke" in wanted:
        found["stroke"] = _stroke(model, cycles)
    heights = model.rises(cycles.p_of_halves)
    for name in heights.keys() & set(wanted):
        series = cycles.halves.series(heights[name])
        rise = extremes(cycles.halves, series)[1] - series[cycles.halves.first, 0]
        found[name] = rise.reshape(len(cycles), -1).max(axis=1)
    for name in set(NUMBERS_OF_MANY) & set(wanted) - found.keys():
        found[name] = np.array([getattr(certificate, name) for certificate in certificates], dtype=float)  # None is NaN
    if units:
        found = {name: values * units.of(DIMENSIONS.get(name, LENGTH)) for name, values in found.items()}
    return found


def _stroke(model: Model, cycles: Cycles) -> np.ndarray:
    """The range (k,) of the extension over the cycles, NaN where the contact does not end."""
    low, high = extremes(cycles.halves, cycles.halves.series(model.extension))
    stroke, these = np.full(len(cycles), np.nan), cycles.with_contact
    if cycles.contacts:
        low, high = low.reshape(len(cycles), -1).min(axis=1), high.reshape(len(cycles), -1).max(axis=1)
        least, most = extremes(cycles.contacts, cycles.contacts.series(model.extension, model.embed))
        stroke[these] = np.maximum(high[these], most) - np.minimum(low[these], least)
    return stroke
