"""Machines with tuned numbers, for designs, and the orbits of any machines near known unknowns.

The tuned numbers are unknowns of half an orbit in addition to those of the motion. So the same equations make them
functions of the designed parameters, and their derivatives follow like those of the launch.
"""

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model import STEP_LENGTH, Machine, Statement
from ..numerics import Array
from ..periodic import (
    LONGEST_START,
    METHOD,
    Orbit,
    Solved,
    StartLike,
    Tuning,
    certified_orbit,
    continued_tuned,
    find,
    first_tuned,
    in_units_of,
    orbits_near,
    prescribable,
    solved_near,
    stated_unknowns,
    tuned_equations,
    tuned_statement,
    tuned_values,
    tuning_of,
)
from ..shooting import NodedSolution, Shooting, vector
from .design_problem import formula_names, names_along
from .design_quantities import base_statement


@dataclass(frozen=True, eq=False)
class TunedMachine:
    """A machine with tuned numbers, as a `Machine`: its values are followed by the prescribed quantities, which may so
    be varied.

    machine : with the values of the tuned numbers
    tuned : their names
    at : the prescribed quantities of half an orbit, in the machine's units
    """

    machine: Any
    tuned: tuple[str, ...]
    at: Mapping[str, float]

    model = property(lambda self: self.machine.model)
    units = property(lambda self: self.machine.units)
    restitution = property(lambda self: self.machine.restitution)
    rest_length = property(lambda self: self.machine.rest_length)

    @property
    def values(self) -> dict[str, float]:
        return {**self.machine.values, **self.at}

    def with_values(self, **values: float) -> Self:
        at = {name: float(values.get(name, x)) for name, x in self.at.items()}
        own = {name: x for name, x in values.items() if name not in at or name in self.machine.values}
        return replace(self, machine=self.machine.with_values(**own) if own else self.machine, at=at)

    def describe(self) -> dict[str, Any]:
        return self.machine.describe()

    @property
    def tuning(self) -> Tuning:
        """The names of what is tuned, with the prescribed values."""
        return Tuning(self.tuned, self.at, {})

    @property
    def equations(self) -> Shooting:
        """Equations of half an orbit with the tuned numbers among the unknowns; their parameters are the `values`."""
        return tuned_equations(self.machine, self.tuned, tuple(self.at))

    def near(self, u: Array, family: int | None) -> "tuple[TunedMachine, Orbit]":
        """The machine with tuned values, and its orbit of a family (None: of any) without dimensions, near unknowns
        (n,) of its equations; raises `NoOrbit`, `FlowError` or `InputError` where there is none."""
        equations, p, began = self.equations, vector(self.values), time.perf_counter()
        guess = NodedSolution(equations, None, u, p, equations.evaluate_all(u[None], p[None]))
        found = solved_near(self.machine, guess, u, p)
        if (longest := found.u[equations.durations].max()) >= LONGEST_START:
            raise NoOrbit(f"it lasts {longest:.3g} units of its own time, too long to be found again")
        found = replace(found, p=equations.with_tuned(found.u[None], p[None])[0])
        tuned = self.with_values(**tuned_values(equations, found.u))
        solved = Solved.of(self.model, METHOD, found)
        orbit = certified_orbit(tuned, solved, began=began)
        if family not in (None, orbit.family):
            raise NoOrbit(f"it is of family {orbit.family}")
        return tuned, orbit

    def certified(self, orbit: Orbit) -> Orbit:
        """Its orbit, found once more from the dimensionless one and certified as by `find`."""
        own, start = start_of_tuned(self.machine, self.tuning, self.equations, unknowns_of(self, orbit))
        return find(own, start=start, tune=self.tuned, at=self.at)


def tuning_of_designs(machine: Machine, tune: Any, at: Any, varied: Iterable[str]) -> Tuning:
    """The tuned parameters and prescribed quantities of designs over `varied` parameters; raises `InputError` where
    they cannot be those."""
    tuning = tuning_of(machine, tune, at)
    if twice := [name for name in varied if name in (*tuning.names, *tuning.values)]:
        raise InputError(f"'{twice[0]}' is varied, so it cannot be tuned or prescribed too: leave it out of one")
    if tuning.extremes:
        known = ", ".join(prescribable(machine.model))
        raise InputError(
            f"at '{next(iter(tuning.extremes))}': it depends on the whole motion and gives no equation of half an "
            f"orbit; designs can be tuned to {known}, and find(machine, tune=..., at=...) finds one orbit"
        )
    return tuning


def with_tuning(machine: Machine, tune: Any, at: Any, varied: Iterable[str]) -> Any:
    """A machine itself, or with its tuned numbers where some are to be tuned, or have to be; raises `InputError` where
    they cannot be those of designs over `varied` parameters."""
    if tune is None and at is None and not machine.model.sticks:
        return machine
    tuning = tuning_of_designs(machine, tune, at, varied)
    return TunedMachine(machine, tuning.names, tuning.at)


def start_of_tuned(
    machine: Machine, tuning: Tuning, equations: Shooting, us: np.ndarray
) -> tuple[Machine, dict[str, float]]:
    """The machine with the tuned values of a solution (n,), and the start from which `find` finds that solution."""
    u = dict(zip(equations.statement.unknowns, us.tolist(), strict=True))
    own = machine.with_values(**{name: u[name] for name in tuning.names})
    stated = {name: x for name, x in u.items() if name in (*own.model.half_unknowns, "contact_duration")}
    return own, in_units_of(own, stated) | ({STEP_LENGTH: u[STEP_LENGTH]} if STEP_LENGTH in u else {})


def untuned(machine: Any) -> Any:
    """The machine itself, where some of its numbers are tuned."""
    return machine.machine if isinstance(machine, TunedMachine) else machine


def tuned_numbers(machine: Any) -> tuple[str, ...]:
    """The names of a machine's numbers that are tuned."""
    return machine.tuned if isinstance(machine, TunedMachine) else ()


def statement_of_orbits(machine: Any) -> Statement:
    """The statement whose unknowns are varied with a machine's parameters: the simplest one, or that which is tuned."""
    if isinstance(machine, TunedMachine):
        return tuned_statement(machine.model, machine.tuned, tuple(machine.at))
    return base_statement(machine.model)


def unknowns_of(machine: Any, orbit: Orbit) -> Array:
    """The unknowns (n,) of a machine's statement at a dimensionless orbit."""
    known = machine.model.launch_at(orbit.flight.coefficients[0, :, 0].tolist())
    known |= {"alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    if orbit.contact_time is not None:
        known["contact_duration"] = orbit.contact_time / 2
    known |= {name: machine.values[name] for name in statement_of_orbits(machine).tuned}
    return np.array([known[name] for name in statement_of_orbits(machine).unknowns])


def names_of_designs(machine: Any) -> list[str]:
    """The names that formulas of a machine's designs may use."""
    if not isinstance(machine, TunedMachine):
        return formula_names(machine)
    return names_along(machine.machine)


def motions_near(
    machines: Sequence[Machine], us: Sequence[Array], families: Sequence[int | None]
) -> list[tuple[Machine, Orbit] | None]:
    """Machines with their dimensionless orbits, as `orbits_near` finds these; tuned numbers have their values there."""
    if not any(isinstance(machine, TunedMachine) for machine in machines):
        found = orbits_near(machines, us, families)
        return [(machine, orbit) if orbit else None for machine, orbit in zip(machines, found, strict=True)]
    tuned = list[Any]()
    for machine, u, family in zip(machines, us, families, strict=True):
        tuned.append(None)
        with suppress(NoOrbit, FlowError, InputError):
            tuned[-1] = machine.near(u, family)  # type: ignore[attr-defined]
    return tuned


def first_of_tuned(machine: TunedMachine, start: StartLike | None, family: int) -> tuple[TunedMachine, Orbit]:
    """A machine with tuned values and the orbit to which a family, or a start, leads."""
    _, solved = first_tuned(machine.machine, start, family, machine.tuned, machine.at)
    return machine.near(solved.us[0], None)


def continued_from(
    machine: TunedMachine, orbit: Orbit, other: TunedMachine, family: int | None
) -> tuple[TunedMachine, Orbit]:
    """Another machine and its orbit, continued from a machine's own; raises `NoOrbit` where it is not reached."""
    u, equations = unknowns_of(machine, orbit), machine.equations
    p, there = vector(machine.values), vector(other.values)
    evaluation = equations.evaluate_all(u[None], p[None])
    known = Solved(machine.model, METHOD, equations, u[None], p[None], evaluation)
    varied = [name for name, a, b in zip(equations.parameters, p, there, strict=True) if a != b]
    found = continued_tuned(known, there[None], varied)
    if 0 in found.stopped:
        raise NoOrbit(found.stopped[0][1])
    return other.near(found.unknowns[0], family)


def tuned_machine_of(machine: Machine, tuned: Sequence[str], at: Mapping[str, float], orbit: Orbit) -> TunedMachine:
    """A machine with the tuned values that it has, which is that of an orbit."""
    if machine.model.runs:
        machine = machine.with_values(**{STEP_LENGTH: stated_unknowns(machine.model, orbit)[STEP_LENGTH]})
    return TunedMachine(machine, tuple(tuned), dict(at))
