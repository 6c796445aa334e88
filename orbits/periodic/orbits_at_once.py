"""The orbits of many machines that differ in numbers alone: guessed, solved, measured and certified together.

Each is found as `find` finds it, from its own guess, so that no answer depends on what else is asked. Where that does
not lead to a certified orbit of the family at once, `find` is left to decide.
"""

from collections.abc import Collection
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit, OrbitsError
from ..model.model import Model
from ..units import DIMENSIONS, LENGTH, Units
from .certificate import Certificate, certify, extremes
from .error_bound import error_bounds
from .family_search import Lateness
from .find import none_found, with_search
from .formulations import Cycles, equations_of, interpret
from .guess import Guesses, guesses
from .homotopy import MAX_CORRECTION
from .newton_kernel import NewtonKernel, Solutions, newton_kernel
from .single_shooting import SMALLEST_UNIT, Evaluation, Shooting


class Orbits(NamedTuple):
    """Certified orbits of one family, without units: the machines (k,) that have them, and their places (k,) among
    orbits (n,) as arrays and their certificates."""

    which: np.ndarray
    places: np.ndarray
    cycles: Cycles
    certificates: list[Certificate]

    def only(self, kept: np.ndarray) -> "Orbits":
        """Those of a mask (k,)."""
        return self._replace(which=self.which[kept], places=self.places[kept])

    @property
    def alphas(self) -> np.ndarray:
        """The launch speeds (k,)."""
        return self.cycles.u["alpha"][self.places]


class _Family(NamedTuple):
    """One family of machines with parameters (m, np) of one model, and the equations of its orbits."""

    model: Model
    names: tuple[str, ...]
    ps: np.ndarray
    family: int
    method: str
    equations: Shooting


def lowest_orbits(
    model: Model, names: tuple[str, ...], ps: np.ndarray, family: int
) -> tuple[list[Orbits], dict[int, NoOrbit]]:
    """The orbits of a family of least launch speed for machines with parameters (m, np), and by index of a machine why
    it has none; machines that are in neither are for `find` to decide, by which the others are the same."""
    method = "relative" if model.reduction else "half orbit"
    equations = equations_of(model, method, names)
    searched_at_once = not model.is_guessed and model.search is not None and model.reversor is not None
    if not (model.relative or searched_at_once) or len(equations.flows) > 1 or not equations.smooth:
        return [], {}
    asked = _Family(model, names, ps, family, method, equations)
    p = dict(zip(names, ps.T, strict=True))
    guess = guesses(model.relative, family, p) if model.relative else _no_guesses(model, names, ps)
    guessed = _from_guesses(asked, guess)
    single, found = guess.single, np.full(len(ps), np.inf)
    if guessed:
        found[guessed.which] = guessed.alphas
    left = np.flatnonzero(guess.own & ~(single & np.isfinite(found)))
    if not len(left) or model.search is None or equations.flows[0].phase.closed_form:
        return [guessed.only(single[guessed.which])] if guessed else [], {}
    searched, lowest, absent = _from_search(asked, left, found, guess)
    settled = single & np.isfinite(found)
    settled[[i for i, alpha in lowest.items() if alpha == found[i]]] = True
    parts = [guessed.only(settled[guessed.which])] if guessed else []
    if searched:
        each = zip(searched.which.tolist(), searched.alphas.tolist(), strict=True)
        best = np.array([lowest.get(machine) == alpha for machine, alpha in each], dtype=bool)
        parts.append(searched.only(best & ~settled[searched.which]))
    return parts, absent


def _no_guesses(model: Model, names: tuple[str, ...], ps: np.ndarray) -> Guesses:
    """For machines (m, np) whose families are searched at once: where they lift off, and no launch speeds."""
    liftoff, none = np.full(len(ps), np.nan), np.full(len(ps), np.nan)
    for i, p in enumerate(ps.tolist()):
        with suppress(OrbitsError):
            liftoff[i] = model.release(np.ones(1), dict(zip(names, p, strict=True)))[0]
    found = {"liftoff": liftoff, "alpha": none, "duration": none}
    return Guesses(found, np.isfinite(liftoff), np.zeros(len(ps), bool), {})


def _from_guesses(asked: _Family, guess: Guesses) -> Orbits | None:
    """The orbits that the guesses lead to."""
    which = np.flatnonzero(np.isfinite(guess.unknowns["alpha"]) & guess.own)
    if not len(which):
        return None
    us = np.column_stack([guess.unknowns[name][which] for name in asked.equations.statement.unknowns])
    solved, us, evaluation = _solved_together(asked.model, asked.equations, us, asked.ps[which])
    return _certified(asked, which[solved], us, evaluation)


def _from_search(
    asked: _Family, left: np.ndarray, found: np.ndarray, guess: Guesses
) -> tuple[Orbits | None, dict[int, float], dict[int, NoOrbit]]:
    """The orbits that a search of some machines (k,) finds; by machine the lowest launch speed, of these and of those
    `found` (m,), where all below it is known; and why machines have no orbit, of those whose guess was refused.

    A machine is left out where the search was stopped, or where a cell that may hold a lower orbit led to none.
    """
    assert asked.model.search is not None
    searches = [asked.model.search(dict(zip(asked.names, p, strict=True))) for p in asked.ps[left].tolist()]
    liftoffs = guess.unknowns["liftoff"][left]
    lateness = Lateness(asked.model, asked.method, asked.names, asked.ps[left], asked.family, searches, liftoffs)
    cells = lateness.cells(below=found[left])
    owners = np.repeat(np.arange(len(left)), [len(each.cells) for each in cells])
    bounds, abouts = (np.concatenate([each[i] for each in cells]) for i in (0, 1))
    # A cell about the orbit that is found holds that one, and those beyond are not asked for.
    own, (low, high) = found[left[owners]], bounds.T
    resolved = np.where((low <= own) & (own <= high), own, np.inf)
    lowest, absent = dict[int, float](), dict[int, NoOrbit]()
    below = np.flatnonzero((low < own) & np.isinf(resolved))
    orbits = _in_cells(asked, lateness, left, owners[below], bounds[below], abouts[below])
    if orbits:
        resolved[below[orbits.which]] = orbits.alphas
        orbits = orbits._replace(which=left[owners[below[orbits.which]]])
    for k, machine in enumerate(left.tolist()):
        mine = owners == k
        best = min(resolved[mine].min(initial=np.inf), found[machine])
        if cells[k].stopped or (np.isinf(resolved[mine]) & (bounds[mine, 0] < best)).any():
            continue
        if np.isfinite(best):
            lowest[machine] = float(best)
        elif machine in guess.refused:
            absent[machine] = with_search(guess.refused[machine], none_found(cells[k]))
    return orbits, lowest, absent


def _in_cells(
    asked: _Family, lateness: Lateness, left: np.ndarray, owners: np.ndarray, bounds: np.ndarray, abouts: np.ndarray
) -> Orbits | None:
    """The orbits in cells (k, 2) of launch speeds, each about a speed (k,) of the machine left[owner]; their `which`
    are the cells."""
    if not len(abouts):
        return None
    starts, ps = lateness.start(abouts, owners), asked.ps[left[owners]]
    known = np.flatnonzero(np.isfinite(starts).all(axis=1))
    if not len(known):
        return None
    kernel, place = _kernel_of(asked.model, asked.equations)
    solved = _at_value(kernel, starts[known], ps[known], place, with_motions=True)
    which, us = known[solved.which], solved.xs[:, :-1]
    orbits = _certified(asked._replace(ps=ps), which, us, solved.evaluation)
    if orbits is None:
        return None
    low, high = bounds[orbits.which].T
    return orbits.only((low <= orbits.alphas) & (orbits.alphas <= high))


def _kernel_of(model: Model, equations: Shooting) -> tuple[NewtonKernel, int]:
    """The kernel that solves the equations, and the place of the parameter that it may vary."""
    along = model.homotopy or equations.parameters[0]
    return newton_kernel(equations, along), equations.parameters.index(along)


def _solved_together(
    model: Model, equations: Shooting, us: np.ndarray, ps: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Evaluation | None]:
    """Which of the guesses (m, n) lead to a solution, these (k, n), and the equations there; the homotopy, if any, is
    taken in one step, which is the first that `find` tries."""
    kernel, place = _kernel_of(model, equations)
    if model.homotopy is None:
        found = _at_value(kernel, us, ps, place, with_motions=True)
        return found.which, found.xs[:, :-1], found.evaluation
    before = ps.copy()
    before[:, place] = 0.0
    first = _at_value(kernel, us, before, place, with_motions=False)
    guesses = first.xs[:, :-1] + first.directions[:, :-1]
    positive = [equations.statement.unknowns.index(name) for name in ("alpha", "duration")]
    ahead = np.flatnonzero((guesses[:, positive] > 0).all(axis=1))
    if not len(ahead):
        return ahead, guesses[ahead], None
    found = _at_value(kernel, guesses[ahead], ps[first.which[ahead]], place, with_motions=True)
    which, xs = ahead[found.which], found.xs[:, :-1]
    near = (np.abs(xs - guesses[which])[:, positive] <= MAX_CORRECTION * np.abs(xs[:, positive])).all(axis=1)
    evaluation = found.evaluation and found.evaluation[np.flatnonzero(near)]
    return first.which[which[near]], xs[near], evaluation


def _at_value(kernel: NewtonKernel, us: np.ndarray, ps: np.ndarray, place: int, with_motions: bool) -> Solutions:
    """The solutions that Newton's method comes to from guesses (m, n), all parameters (m, np) held."""
    xs = np.column_stack([us, ps[:, place]])
    rows, units = np.zeros(xs.shape), np.maximum(np.abs(xs), SMALLEST_UNIT)
    rows[:, -1] = 1.0
    return kernel(xs, rows, ps[:, place], units, ps, 1, with_motions)


def _certified(asked: _Family, which: np.ndarray, us: np.ndarray, evaluation: Evaluation | None) -> Orbits | None:
    """The solutions (k, n) for machines (k,) that are of the family and can be certified."""
    if not len(which):
        return None
    assert evaluation is not None
    ps, closing = asked.ps[which], np.tile(np.eye(us.shape[1] + 1)[-1], (len(us), 1))
    errors, refused = error_bounds(asked.equations, us, ps, evaluation, closing, quickly=True)
    kept = np.delete(np.arange(len(us)), list(refused))
    while len(kept):
        parts = us[kept], ps[kept], evaluation[kept], errors[kept]
        try:
            cycles = interpret(asked.model, asked.method, asked.equations, *parts)
            certificates = certify(asked.model, cycles)
        except NoOrbit as error:
            if error.index is None:
                raise
            kept = np.delete(kept, error.index)
            continue
        of_family = np.array([certificate.family == asked.family for certificate in certificates])
        return Orbits(which[kept], np.arange(len(kept)), cycles, certificates).only(of_family)
    return None


# Quantities of orbits that are found together, besides the rises of the heights; they are those of `orbits.quantities`.
NUMBERS_OF_MANY = (
    *("alpha", "flight_time", "contact_time", "period", "liftoff_extension", "error", "clearance", "stroke"),
    *("smallest_separation", "smallest_contact_force", "largest_contact_force", "landing_jerk", "loss_coefficient"),
)


def numbers_of(model: Model, orbits: Orbits, units: Units | None, wanted: Collection[str]) -> dict[str, np.ndarray]:
    """Some of `NUMBERS_OF_MANY` and the rises (n,) of the orbits as arrays, NaN for one that has none; in SI by units
    (n,)."""
    cycles, certificates = orbits.cycles, orbits.certificates
    contact = np.where(np.isfinite(cycles.contact_times), cycles.contact_times, np.nan)
    found = {"alpha": cycles.u["alpha"], "liftoff_extension": model.liftoff_extension(cycles.u, cycles.p)}
    found |= {"flight_time": cycles.flight_times, "contact_time": contact, "period": cycles.flight_times + contact}
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
