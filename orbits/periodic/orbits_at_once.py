"""The orbits of many machines that differ only in numbers, guessed, solved, measured and certified together.

Each is found as in `find`, from its own guess, so no result depends on the other members. Where this does not lead
directly to a certified orbit of the family, `find` searches for this machine alone.
"""

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..flow import flow_of
from ..model import Machine, Model
from ..shooting import (
    NEWTON,
    Evaluation,
    NewtonKernel,
    Shooting,
    Solutions,
    equations_of,
    iterative,
    method_of,
    newton_kernel,
)
from .certification import Certified, Solved, certified, certified_orbit, orbits_of, solve_from
from .family_orbits import none_found, with_search
from .family_search import Lateness
from .guess import Guesses, guesses
from .homotopy import STEPS_OF_HOMOTOPY
from .orbit import Orbit


class TogetherOptions(NamedTuple):
    """How many motions are kept in memory together: fewer where they may have more steps."""

    motions: int = 1024  # of low families, on a law of few pieces
    low_families: int = 32  # the half flights of higher ones last longer
    few_pieces: int = 32  # a motion may end a step at each piece of a law


TOGETHER = TogetherOptions()


def motions_together(model: Model, names: tuple[str, ...], family: int) -> int:
    """The largest number of machines of a model for which the orbits of a family are to be found together."""
    return max(1, TOGETHER.motions // _lengthening(model, names, family))


def _lengthening(model: Model, names: tuple[str, ...], family: int) -> int:
    """The number of times that a motion of a family may have more steps than those of low families of smooth laws."""
    return max(1, family // TOGETHER.low_families) * max(1, flow_of(model.flight, names).breaks // TOGETHER.few_pieces)


class _Family(NamedTuple):
    """One family of machines with parameters (m, np) of one model, and the equations of its orbits."""

    model: Model
    names: tuple[str, ...]
    ps: np.ndarray
    family: int
    method: str
    equations: Shooting

    @property
    def most(self) -> int:
        """The largest number of steps of a motion that are recorded."""
        return self.equations.flows[0].control.max_block * _lengthening(self.model, self.names, self.family)


def lowest_orbits(
    model: Model, names: tuple[str, ...], ps: np.ndarray, family: int
) -> tuple[list[Certified], dict[int, NoOrbit]]:
    """The orbits of a family of least launch speed for machines with parameters (m, np), and the errors, by index, of
    machines without an orbit; the machines in neither are left to `find`, which agrees with these results."""
    method = iterative(method_of(model))
    equations = equations_of(model, method, names)
    searched_at_once = model.relative is None and model.search is not None and model.reversor is not None
    if not (model.relative or searched_at_once) or not equations.in_lanes:
        return [], {}
    sought = _Family(model, names, ps, family, method, equations)
    p = dict(zip(names, ps.T, strict=True))
    guess = guesses(model, family, p, len(ps))
    guessed = _from_guesses(sought, guess)
    single, found = guess.single, np.full(len(ps), np.inf)
    if guessed:
        found[guessed.which] = guessed.alphas
    left = np.flatnonzero(guess.own & ~(single & np.isfinite(found)))
    if not len(left) or model.search is None or equations.flows[0].phase.closed_form:
        return [guessed.only(single[guessed.which])] if guessed else [], {}
    searched, lowest, absent = _from_search(sought, left, found, guess)
    settled = single & np.isfinite(found)
    settled[[i for i, alpha in lowest.items() if alpha == found[i]]] = True
    parts = [guessed.only(settled[guessed.which])] if guessed else []
    if searched:
        each = zip(searched.which.tolist(), searched.alphas.tolist(), strict=True)
        best = np.array([lowest.get(machine) == alpha for machine, alpha in each], dtype=bool)
        parts.append(searched.only(best & ~settled[searched.which]))
    return parts, absent


def orbits_near(
    machines: Sequence[Machine], us: Sequence[np.ndarray], families: Sequence[int | None]
) -> list[Orbit | None]:
    """The orbits of machines, each of its own family (None: of any) and without dimensions, to which Newton's method
    converges from unknowns (n,) of the simplest statement; None where it does not."""
    orbits = dict[int, Orbit]()
    sought_by = [(machine.model, family) for machine, family in zip(machines, families, strict=True)]
    for model, family in dict.fromkeys(sought_by):
        these, began = [i for i, each in enumerate(sought_by) if each == (model, family)], time.perf_counter()
        part, guess = [machines[i] for i in these], np.array([us[i] for i in these])
        names, ps = tuple(part[0].values), np.array([list(machine.values.values()) for machine in part])
        method = iterative(method_of(model))
        equations = equations_of(model, method, names)
        if equations.in_lanes and family:
            if found := certified_near(model, names, ps, guess, family):
                each = orbits_of(part, method, equations, found, began)
                orbits |= {these[k]: orbit for k, orbit in each.items()}
            continue
        for i, machine, u in zip(these, part, guess, strict=True):
            with suppress(NoOrbit):
                orbit = certified_orbit(machine, solve_from(machine, method, u), began=began)
                orbits |= {i: orbit} if family in (None, orbit.family) else {}
    return [orbits.get(i) for i in range(len(machines))]


def certified_near(
    model: Model, names: tuple[str, ...], ps: np.ndarray, us: np.ndarray, family: int
) -> Certified | None:
    """The orbits of a family for machines with parameters (m, np) to which Newton's method converges from unknowns
    (m, n) of the simplest statement, whose motions can be integrated together."""
    method = iterative(method_of(model))
    sought = _Family(model, names, ps, family, method, equations_of(model, method, names))
    solved = _at_value(_kernel_of(model, sought.equations), us, ps, sought.most)
    return _certified(sought, solved.which, solved.xs[:, :-1], solved.evaluation)


def _from_guesses(sought: _Family, guess: Guesses) -> Certified | None:
    """The orbits found from the guesses."""
    which = np.flatnonzero(np.isfinite(guess.unknowns["alpha"]) & guess.own)
    if not len(which):
        return None
    us = np.column_stack([guess.unknowns[name][which] for name in sought.equations.statement.unknowns])
    solved, us, evaluation = _solved_together(sought, us, sought.ps[which])
    return _certified(sought, which[solved], us, evaluation)


def _from_search(
    sought: _Family, left: np.ndarray, found: np.ndarray, guess: Guesses
) -> tuple[Certified | None, dict[int, float], dict[int, NoOrbit]]:
    """The orbits that a search of some machines (k,) finds; by machine the lowest launch speed of these and of `found`
    (m,), where all orbits below it are known; and the errors of machines without an orbit whose guess was refused.

    A machine is left out where the search was stopped, or where a cell that may hold a lower orbit led to none.
    """
    assert sought.model.search is not None
    searches = [sought.model.search(dict(zip(sought.names, p, strict=True))) for p in sought.ps[left].tolist()]
    liftoffs = guess.unknowns["liftoff"][left]
    lateness = Lateness(sought.model, sought.method, sought.names, sought.ps[left], sought.family, searches, liftoffs)
    cells = lateness.cells(below=found[left])
    owners = np.repeat(np.arange(len(left)), [len(each.cells) for each in cells])
    bounds, abouts = (np.concatenate([each[i] for each in cells]) for i in (0, 1))
    # A cell about the orbit found already contains that orbit, and the cells beyond it are not solved.
    own, (low, high) = found[left[owners]], bounds.T
    resolved = np.where((low <= own) & (own <= high), own, np.inf)
    lowest, absent = dict[int, float](), dict[int, NoOrbit]()
    below = np.flatnonzero((low < own) & np.isinf(resolved))
    orbits = _in_cells(sought, lateness, left, owners[below], bounds[below], abouts[below])
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
        elif isinstance(refused := guess.refused.get(machine), NoOrbit):
            absent[machine] = with_search(refused, none_found(sought.model, cells[k]))
    return orbits, lowest, absent


def _in_cells(
    sought: _Family, lateness: Lateness, left: np.ndarray, owners: np.ndarray, bounds: np.ndarray, abouts: np.ndarray
) -> Certified | None:
    """The orbits in cells (k, 2) of launch speeds, each about a speed (k,) of the machine left[owner]; their `which`
    are the cells."""
    if not len(abouts):
        return None
    starts, ps = lateness.start(abouts, owners), sought.ps[left[owners]]
    known = np.flatnonzero(np.isfinite(starts).all(axis=1))
    if not len(known):
        return None
    kernel = _kernel_of(sought.model, sought.equations)
    solved = _at_value(kernel, starts[known], ps[known], sought.most)
    which, us = known[solved.which], solved.xs[:, :-1]
    orbits = _certified(sought._replace(ps=ps), which, us, solved.evaluation)
    if orbits is None:
        return None
    low, high = bounds[orbits.which].T
    return orbits.only((low <= orbits.alphas) & (orbits.alphas <= high))


def _kernel_of(model: Model, equations: Shooting) -> NewtonKernel:
    """The kernel that solves the equations, and may vary the parameter of the homotopy."""
    return newton_kernel(equations, model.homotopy or equations.parameters[0])


def _solved_together(
    sought: _Family, us: np.ndarray, ps: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Evaluation | None]:
    """The indices of the guesses (m, n) that lead to a solution, these solutions (k, n), and the equations there; the
    homotopy, if any, is taken in one step, which is the first that `find` tries."""
    equations, kernel = sought.equations, _kernel_of(sought.model, sought.equations)
    if sought.model.homotopy is None:
        found = _at_value(kernel, us, ps, sought.most)
        return found.which, found.xs[:, :-1], found.evaluation
    before = ps.copy()
    before[:, kernel.place] = 0.0
    first = _at_value(kernel, us, before)
    guesses = first.xs[:, :-1] + first.directions[:, :-1]
    positive = [equations.statement.unknowns.index(name) for name in ("alpha", "duration")]
    ahead = np.flatnonzero((guesses[:, positive] > 0).all(axis=1))
    if not len(ahead):
        return ahead, guesses[ahead], None
    found = _at_value(kernel, guesses[ahead], ps[first.which[ahead]], sought.most)
    which, xs = ahead[found.which], found.xs[:, :-1]
    most = STEPS_OF_HOMOTOPY.moved * np.abs(xs[:, positive])
    near = (np.abs(xs - guesses[which])[:, positive] <= most).all(axis=1)
    evaluation = found.evaluation and found.evaluation[np.flatnonzero(near)]
    return first.which[which[near]], xs[near], evaluation


def _at_value(kernel: NewtonKernel, us: np.ndarray, ps: np.ndarray, recorded: int = 0) -> Solutions:
    """The solutions to which Newton's method converges from guesses (m, n), with fixed parameters (m, np), and their
    motions of at most this number of `recorded` steps."""
    xs = np.column_stack([us, ps[:, kernel.place]])
    rows, units = np.zeros(xs.shape), np.maximum(np.abs(xs), NEWTON.smallest_unit)
    rows[:, -1] = 1.0
    return kernel(xs, rows, xs[:, -1], units, ps, 1, recorded > 0, recorded or None)


def _certified(sought: _Family, which: np.ndarray, us: np.ndarray, evaluation: Evaluation | None) -> Certified | None:
    """The solutions (k, n) for machines (k,) that are of the family and can be certified."""
    if not len(which):
        return None
    assert evaluation is not None
    solved = Solved(sought.model, sought.method, sought.equations, us, sought.ps[which], evaluation)
    found, _ = certified(solved, np.tile(np.eye(us.shape[1] + 1)[-1], (len(us), 1)), quickly=True)
    if found is None:
        return None
    families = found.certificates.column("family")[found.places]
    return found._replace(which=which[found.which]).only(families == sought.family)
