"""From solved unknowns to certified orbits: error bounds, cycles and certificates of m solutions together."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from ..errors import InputError, OrbitsError
from ..laws import UNIT_FORCE
from ..model import Machine, Model
from ..records import NONE, Records
from ..running import exclusive
from ..shooting import (
    Cycles,
    Evaluation,
    NodedSolution,
    Shooting,
    by_pieces,
    equations_of,
    error_bounds,
    interpret,
    refused_by_unfolding,
    solved,
    solved_with_nodes,
    vector,
    with_nodes,
)
from .certificate import Certificate, certify
from .cycle_shape import Shape, StepMaps
from .friction import with_friction
from .orbit import Orbit, orbit_of
from .quantities import in_weights, motion_numbers, run_numbers


@dataclass(frozen=True, eq=False)
class Solved:
    """Solutions (m, n) of the equations of a model's method, with parameters (m, np).

    evaluation : the equations at the solutions
    errors : bounds (m,) on the errors of the launch speeds; None where they have to be measured
    by_nodes : the same solutions of equations with nodes, by which errors are measured where motions amplify small
        changes; None where they do not
    """

    model: Model
    method: str
    equations: Shooting
    us: ndarray
    ps: ndarray
    evaluation: Evaluation
    errors: ndarray | None = None
    by_nodes: "Solved | None" = None

    @classmethod
    def of(cls, model: Model, method: str, found: NodedSolution) -> "Solved":
        """One solution that has nodes where it asks for them."""
        ps, by_nodes = found.p[None], None
        if found.division:
            by_nodes = cls(model, method, found.equations, found.x[None], ps, found.evaluation)
        return cls(model, method, found.undivided, found.u[None], ps, found.whole, by_nodes=by_nodes)

    def only(self, which: ndarray) -> "Solved":
        """Some of the solutions, in an order (k,)."""
        errors = None if self.errors is None else self.errors[which]
        found = replace(self, us=self.us[which], ps=self.ps[which], evaluation=self.evaluation[which], errors=errors)
        return found if self.by_nodes is None else replace(found, by_nodes=self.by_nodes.only(which))

    @property
    def cycles(self) -> Cycles:
        """The motions of the solutions, whose errors are known."""
        assert self.errors is not None
        return interpret(self.model, self.method, self.equations, self.us, self.ps, self.evaluation, self.errors)


def solve_from(machine: Machine, method: str, u: ndarray) -> Solved:
    """The solution to which a method's corrector converges from unknowns (n,); raises `NoOrbit` without convergence."""
    equations, p = equations_of(machine.model, method, tuple(machine.values)), vector(machine.values)
    solve = equations.multiple_shooting if method == "shooting" else None
    return Solved.of(machine.model, method, solved_with_nodes(equations, u, p, solve))


def corrector(method: str, equations: Shooting, vary: str | None) -> Callable:
    """The function (u, p) -> solution near u with the equations there, of a method, as in `solved`."""
    return equations.multiple_shooting if method == "shooting" else partial(solved, equations, vary=vary)


def known_solutions(
    model: Model, method: str, names: tuple[str, ...], us: ndarray, ps: ndarray, errors: ndarray
) -> Solved:
    """Known solutions, with the bounds (m,) on their errors; with nodes where the motions amplify small changes.

    us : unknowns (m, n), with any further ones after those of an orbit
    ps : parameters (m, np) of these names

    Raises `InputError` for unknowns of another method, and `NoOrbit` where there is no solution near them.
    """
    equations = equations_of(model, method, names)
    if us.shape[1] < equations.size:
        raise InputError("this family was not followed by the method that its settings name")
    us = us[:, : equations.size]
    evaluation = with_nodes(equations, us, ps, equations.evaluate_all(us, ps))
    return Solved(model, method, equations, us, ps, evaluation, errors)


class Certified(NamedTuple):
    """Certified orbits: which (k,) of the solutions they are, and their places (k,) among the cycles (n,) and the
    certificates of these."""

    which: ndarray
    places: ndarray
    cycles: Cycles
    certificates: Records[Certificate]

    def only(self, chosen: ndarray) -> "Certified":
        """The orbits selected by a mask (k,), or by indices in an order."""
        return self._replace(which=self.which[chosen], places=self.places[chosen])

    @property
    def alphas(self) -> ndarray:
        """The launch speeds (k,)."""
        return self.cycles.u["alpha"][self.places]


def certified(
    solved: Solved,
    closing: ndarray | None = None,
    quickly: bool = False,
    refused: Mapping[int, OrbitsError] | None = None,
) -> tuple[Certified | None, dict[int, OrbitsError]]:
    """The solutions that can be certified, None without any, and the errors, by index, of the others.

    closing, quickly : as in `error_bounds`
    refused : the errors, by index, of solutions that are excluded already
    """
    why, errors, left = dict(refused or {}), solved.errors, np.arange(len(solved.us))
    if errors is None:
        by, nodes = solved.by_nodes or solved, solved.by_nodes is not None
        solutions = by.equations, by.us, by.ps, by.evaluation
        errors, doubtful = error_bounds(*solutions, closing, quickly, by_nodes=nodes)
        why = {**refused_by_unfolding(solved.equations, solved.us), **doubtful, **why}
        solved = replace(solved, errors=errors)
    if why:
        left = np.delete(left, list(why))
        if not len(left):
            return None, why
        solved = solved.only(left)
    cycles = solved.cycles
    certificates, wrong = certify(solved.model, cycles)
    certificates = with_friction(solved.model, cycles, certificates)
    why |= {int(left[i]): error for i, error in wrong.items()}
    places = np.delete(np.arange(len(left)), list(wrong))
    return (Certified(left[places], places, cycles, certificates) if len(places) else None), why


def certified_orbit(machine: Machine, solved: Solved, *, began: float) -> Orbit:
    """The certified orbit of one solution, whose search `began` at that `time.perf_counter`; dimensionless.

    Raises `NoOrbit` when the orbit cannot be certified.
    """
    found, refused = certified(solved)
    if found is None:
        raise refused[0]
    if noise := next((pieces.noise for flow in solved.equations.flows if (pieces := flow.phase.pieces)), None):
        slopes = by_pieces(solved.equations, solved.us, solved.ps, solved.evaluation)
        deviation, per_unit = (None, None) if slopes is None else noise(slopes)
        if per_unit is not None:
            per_unit *= machine.values.get(UNIT_FORCE, 1.0)  # a law in SI of an orbit without units
        numbers = {"alpha_noise": deviation, "alpha_per_noise": per_unit}
        columns = {name: np.array([NONE if value is None else value]) for name, value in numbers.items()}
        found = found._replace(certificates=found.certificates.replaced(**columns))
    return orbits_of([machine], solved.method, solved.equations, found, began)[0]


def orbits_of(
    machines: Sequence[Machine], method: str, equations: Shooting, found: Certified, began: float
) -> dict[int, Orbit]:
    """The orbits, without dimensions, of certified solutions for machines of one model, by the index of each."""
    model, cycles, orbits = machines[0].model, found.cycles, dict[int, Orbit]()
    forces = found.certificates.column("largest_contact_force")
    numbers = motion_numbers(model, cycles) | run_numbers(model, cycles)
    numbers |= {"peak_force_in_weights": in_weights(model, cycles.p, forces)}
    contacts = dict(zip(cycles.with_contact.tolist(), cycles.contacts or (), strict=True))
    extension = model.extension.weights
    for which, place in zip(found.which.tolist(), found.places.tolist(), strict=True):
        machine, each = machines[which], ((name, float(values[place])) for name, values in numbers.items())
        own: dict[str, Any] = {name: None if value == NONE else value for name, value in each}
        p, knees = machine.values, tuple(model.knees(machine.values)) if model.knees else ()
        mirror = model.mirror if model.reversor else None
        steps, heights = None if model.plain else _step_maps(model, p), model.heights(p)
        orbits[which] = Orbit(
            machine=machine.describe(),
            **own,
            flight=cycles.flight[place],
            contact=contacts.get(place),
            shape=Shape(
                model.reversor, mirror, model.embed, heights, model.springs, knees, steps, extension, model.segments
            ),
            certificate=found.certificates[place],
            method=method,
            skipped=_skipped(model, p, method),
            seconds=time.perf_counter() - began,
            source=machine,
        )
    return orbits


def _step_maps(model: Model, p: Mapping[str, float]) -> StepMaps:
    """The maps of a model that steps, for values of its parameters."""
    back, there, label = (
        tuple(map(float, each.shifts(p))) for each in (model.reversal, model.contact_reversal, model.relabelling)
    )
    return StepMaps(back, there, tuple(map(float, model.relabelling.signs)), label)


@exclusive
def orbit_from(machine: Machine, method: str, u: tuple[float, ...] | ndarray, error: float) -> Orbit:
    """The whole orbit of a machine whose unknowns by this method are known, in the machine's units.

    u : without dimensions; further ones after those of an orbit are left out
    error : of its launch speed, without dimensions

    Raises `InputError` for unknowns of another method.
    """
    us, ps = np.array([u]), vector(machine.values)[None]
    return orbit_of_solved(
        machine, known_solutions(machine.model, method, tuple(machine.values), us, ps, np.array([error]))
    )


def orbit_of_solved(machine: Machine, solved: Solved) -> Orbit:
    """The whole orbit of one solution for a machine, in the machine's units; raises `NoOrbit`."""
    return orbit_of(machine, certified_orbit(machine, solved, began=time.perf_counter()))


def _skipped(model: Model, p: Mapping, method: str) -> tuple[str, ...]:
    """The steps that the method did not need, in words."""
    few, share = method in ("relative", "half orbit"), "only its first half" if model.reversor else "once"
    integrated = f"{share}, for its duration and the checks, not for the search"
    skipped = {
        "flight: closed form, nothing integrated": method == "closed form",
        "search: one scalar equation, no solver": method == "closed form",
        "flight: only the extension is integrated, 2 states of 4": method == "relative",
        "flight: only half is integrated, by time reversal": few or (method == "shooting" and bool(model.reversor)),
        "search: Newton on a few unknowns from a measured guess, no Ipopt": few,
        f"contact: {'closed form' if model.contact.closed_form else integrated}": True,
        "separation of the masses: no rest length given": model.separation(p) is None,
        "compilation: no motion is integrated in steps": method == "closed form" and bool(model.contact.closed_form),
    }
    return tuple(words for words, applies in skipped.items() if applies)
