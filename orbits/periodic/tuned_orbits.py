"""Orbits with tuned parameters: numbers of a machine that become unknowns, one for each condition in excess.

Half an orbit of a model may have more equations than unknowns, and each quantity of the orbit whose value is prescribed
is one equation more. Then as many parameters of the machine are unknowns too, the tuned ones.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number, list_of_names
from ..model import STEP_LENGTH, Machine, Model, Statement, check_parameters
from ..numerics import solve
from ..running import TimeOver
from ..shooting import (
    NodedSolution,
    Shooting,
    boundary_functions,
    error_bounds,
    half_contact,
    half_orbit,
    shooting_equations,
    solved_with_nodes,
)
from ..units import DIMENSIONS, LENGTH, RISE, SPEED, Dimension
from .certification import Solved
from .quantities import OF_RUNS, names_of_many, quantity_names, speed_in_flight, step_of, unknown_quantity

# The method whose equations are tuned.
METHOD = "half orbit"


class TunedOptions(NamedTuple):
    """When tuned numbers cannot be followed to the prescribed values, and when an orbit does not determine them."""

    most: int = 10000  # attempts that may fail on the way
    shortest_way: float = 1e-4  # share of the way: with a shorter step the orbit cannot be followed there
    # A corrector that changes an unknown by a larger share of its size may have jumped to another orbit.
    corrected: float = 0.03
    worst: float = 0.01  # share of its value by which a tuned number that is determined may be off
    rank: float = 1e-9  # of the largest singular value: equations with a smaller share have lost their rank
    # A Jacobian that a Newton step takes below this share of itself in some direction may have no full rank.
    rank_in_step: float = 0.5
    smallest: float = 1e-3  # smaller values are compared with this one


TUNED = TunedOptions()
# What to do where an orbit does not determine a tuned number, by whether the machine sticks.
OTHER = "tune another number"
AT_A_SPEED = "prescribe a speed farther from 0, or start at a run that has one"
REMEDIES = OTHER, f"{OTHER}; or {AT_A_SPEED}: the vertical hop has speed 0 for every inertia"


class Prescribed(NamedTuple):
    """A quantity of half an orbit that may be prescribed.

    of : (model, u, p) -> its value as an expression, without dimensions
    dimension : of it
    with_contact : whether it depends on the time of the contact
    positive : whether it lies above 0 in every orbit
    """

    of: Callable
    dimension: Dimension | str
    with_contact: bool = False
    positive: bool = False


def _period(model: Model, u: Mapping, p: Mapping) -> Any:
    return 2 * (u["duration"] + u["contact_duration"])


def _landed_place(name: str, model: Model, u: Mapping, p: Mapping) -> Any:
    """The place at landing of what sticks."""
    return model.reversal.image(model.launch(u, p), p)[model.flight.states.index(name)]


PRESCRIBED: dict[str, Prescribed] = {
    "alpha": Prescribed(lambda model, u, p: u["alpha"], DIMENSIONS["alpha"]),
    "liftoff_extension": Prescribed(lambda model, u, p: model.liftoff_extension(u, p), DIMENSIONS["liftoff_extension"]),
    "flight_time": Prescribed(lambda model, u, p: 2 * u["duration"], DIMENSIONS["flight_time"], positive=True),
    "contact_time": Prescribed(lambda model, u, p: 2 * u["contact_duration"], DIMENSIONS["contact_time"], True, True),
    "period": Prescribed(_period, DIMENSIONS["period"], True, True),
    "frequency": Prescribed(lambda model, u, p: 1 / _period(model, u, p), DIMENSIONS["frequency"], True, True),
}
# Those of machines that go forward. Where a foot sticks the step is a parameter, which is tuned unless it is
# prescribed; elsewhere it follows from the machine's geometry.
OF_STEPS: dict[str, Prescribed] = {
    "speed": Prescribed(lambda model, u, p: speed_in_flight(model, u, p, 2 * u["duration"]), SPEED),
    "mean_speed": Prescribed(lambda model, u, p: step_of(model, u, p) / _period(model, u, p), SPEED, True),
    STEP_LENGTH: Prescribed(step_of, LENGTH),
}
# Quantities of the whole motion that are ranges, or maxima of what is 0 at lift-off.
NEVER_NEGATIVE = ("stroke", "largest_contact_force", "peak_force_in_weights", "duty_factor", "friction_needed")


def prescribable(model: Model) -> dict[str, Prescribed]:
    """The quantities of half an orbit of a model that may be prescribed, by name."""
    each = OF_STEPS if model.sticks else OF_STEPS.keys() - {STEP_LENGTH} if model.moves_on else ()
    stuck = {
        name: Prescribed(partial(_landed_place, name), name) for name in model.sticks if name in model.launch_unknowns
    }
    return PRESCRIBED | {name: OF_STEPS[name] for name in OF_STEPS if name in each} | stuck


@dataclass(frozen=True)
class Tuning:
    """Which parameters are tuned, and to what.

    names : of the tuned parameters
    values : prescribed values of quantities that are equations of half an orbit, by name, in the machine's units; None
        for that of the orbit where the search begins
    extremes : those of other quantities, by name
    """

    names: tuple[str, ...]
    values: Mapping[str, float | None]
    extremes: Mapping[str, float]

    @property
    def at(self) -> dict[str, float]:
        """All prescribed values by name, as `find` takes them."""
        return {name: x for name, x in {**self.values, **self.extremes}.items() if x is not None}


def tuning_of(machine: Machine, tune: str | Iterable[str] | None, at: Mapping[str, float] | None) -> Tuning:
    """The tuned parameters of a machine and the prescribed quantities; raises `InputError` where the names are unknown,
    or where their numbers do not make the equations square."""
    names = tuned_names(machine, tune)
    at = {} if at is None else at
    if not isinstance(at, Mapping):
        raise InputError(f"at = {at!r}; it must be a mapping of quantities to values, as at={{'period': 9.0}}")
    others, known = quantities_of_motion(machine), prescribable(machine.model)
    values = {name: finite_number(f"at '{name}'", value) for name, value in at.items()}
    for name in values:
        if name in machine.values and name not in known:
            raise InputError(f"at '{name}': it is a parameter of the machine; set it there, or tune it")
        if name == "step" and name not in known and machine.model.moves_on and not machine.model.sticks:
            raise InputError("at 'step': it follows from the geometry of this machine; set that instead")
        if name not in (*known, *others):
            if name in quantity_names(machine.model, machine.values):
                designed = f"optimize(machine, ..., subject_to=['{name} == {values[name]:g}'])"
                raise InputError(f"at '{name}': it can be prescribed only in designs, by {designed}")
            why = unknown_quantity(machine.model, machine.values, name, [*known, *others])
            raise InputError(f"at '{name}': {why}")
        _check_value(machine, name, values[name])
    check_count(machine, names, values)
    smooth = {name: value for name, value in values.items() if name in known}
    return Tuning(names, smooth, {name: value for name, value in values.items() if name not in smooth})


def _check_value(machine: Machine, name: str, value: float) -> None:
    """Raise `InputError` where no orbit has this value of a quantity, so that no search begins."""
    model, known = machine.model, PRESCRIBED.get(name)
    positive = bool(known and known.positive) or (name == "alpha" and model.relative is not None)
    if name in model.sticks and value == 0:
        raise InputError(f"at '{name}' = 0: there the {model.name} rests; prescribe a value that is not 0")
    never_negative = positive or name in NEVER_NEGATIVE or name.endswith(RISE)
    if (value < 0 and never_negative) or (value == 0 and positive):
        bound = "above 0" if positive else "at least 0"
        raise InputError(f"at '{name}' = {value:g}: prescribe a value {bound}, as every orbit has")


def tuned_names(machine: Machine, tune: str | Iterable[str] | None) -> tuple[str, ...]:
    """The names of the tuned parameters; raises `InputError` for one that is unknown, fixed, or stated twice."""
    if isinstance(tune, Mapping) or not (tune is None or isinstance(tune, Iterable)):
        raise InputError(f"tune = {tune!r}; it must list names; the search begins at their values in the machine")
    names = tuple(list_of_names("tune", () if tune is None else tune))
    check_parameters(machine, *names)
    if len({*names}) < len(names):
        raise InputError(f"tune = {names!r}: name each parameter once")
    if machine.model.reversor is None:
        raise InputError(f"a {machine.model.name} has no reversor, but tuning solves for half an orbit and needs one")
    machine.with_values(**{name: machine.values[name] for name in names})  # refuses one that follows from others
    return names


def is_quantity(machine: Machine, name: object) -> bool:
    """Whether a name is that of a quantity that may be prescribed, and not of a parameter of the machine itself."""
    model = machine.model
    return isinstance(name, str) and name in prescribable(model) and (name not in machine.values or name in model.fixed)


def quantities_of_motion(machine: Machine) -> list[str]:
    """The quantities of a machine's orbits that are found from its whole motion, as extremes are."""
    model, p = machine.model, machine.values
    computed = {*names_of_many(model), *model.of_heights(p)} - prescribable(model).keys() - OF_RUNS.keys()
    return [name for name in quantity_names(model, p) if name in computed]


def check_count(machine: Machine, tuned: Sequence[str], prescribed: Iterable[str]) -> None:
    """Raise `InputError` where the numbers of a machine's equations and unknowns differ."""
    prescribed, model = [*prescribed], machine.model
    unknowns, equations = counts(model, tuple(machine.values))
    if (needed := equations - unknowns + len(prescribed)) == len(tuned):
        return
    stated = f"tune = {[*tuned]} names {len(tuned)} of the parameters of the {model.name}"
    reason = f"one for each quantity of at = {prescribed}"
    if equations > unknowns:
        more = ", and one more" + reason.removeprefix("one") if prescribed else ""
        reason = f"half an orbit has {equations} equations for {unknowns} unknowns{more}"
    free = [name for name in machine.values if name not in (*tuned, *model.fixed, model.homotopy)]
    remedy = f"choose among {', '.join(free)}"
    if needed < len(tuned):
        remedy = f"leave {len(tuned) - needed} out, or prescribe {len(tuned) - needed} more"
    raise InputError(f"{stated}, and {needed} {'is' if needed == 1 else 'are'} needed: {reason}; {remedy}")


@lru_cache(maxsize=64)
def counts(model: Model, parameters: tuple[str, ...]) -> tuple[int, int]:
    """The number of unknowns and the number of equations of half an orbit, before parameters of a machine are tuned."""
    statement = half_orbit(model)
    arrivals = [arrival for _, arrival in boundary_functions(statement, parameters)]
    return len(statement.unknowns) + model.runs, sum(arrival.numel_out(0) for arrival in arrivals)


@lru_cache(maxsize=64)
def tuned_statement(model: Model, tuned: tuple[str, ...], prescribed: tuple[str, ...]) -> Statement:
    """Half an orbit whose last unknowns are parameters, with one equation more for each prescribed quantity; its value,
    in the machine's units, is the parameter of its name."""
    base, known = half_orbit(model), prescribable(model)
    arcs, unknowns, durations = base.arcs, base.unknowns, base.durations
    each = [(name, known[name]) for name in prescribed if not (name == STEP_LENGTH and model.runs)]
    if len(arcs) == 1 and any(quantity.with_contact for _, quantity in each):
        unknowns, durations = (*unknowns, "contact_duration"), (*durations, "contact_duration")
        middle = lambda u, x, p: [model.mid_contact(p).at(x)]  # noqa: E731
        arcs = (*arcs, replace(half_contact(model), conditions=middle))

    def conditions(u: Mapping, x: Sequence, p: Mapping) -> list:
        units = model.units(p) if model.units else None
        more = [one.of(model, u, p) - p[name] / (units.of(one.dimension) if units else 1.0) for name, one in each]
        return [*arcs[-1].conditions(u, x, p), *more]

    arcs_with = (*arcs[:-1], replace(arcs[-1], conditions=conditions))
    names = (*((STEP_LENGTH,) if model.runs and STEP_LENGTH not in prescribed else ()), *tuned)
    return Statement("tuned half orbit", (*unknowns, *names), arcs_with, durations, names)


def tuned_equations(machine: Machine, tuned: tuple[str, ...], prescribed: tuple[str, ...]) -> Shooting:
    """The equations of half an orbit with tuned parameters; the prescribed quantities are further parameters, the
    last ones, unless they are parameters already."""
    statement = tuned_statement(machine.model, tuned, prescribed)
    return shooting_equations(statement, tuple(dict.fromkeys((*machine.values, *prescribed))))


def prescribed_value(machine: Machine, name: str, u: Mapping[str, float]) -> float:
    """The value of a quantity that may be prescribed at unknowns of half an orbit, in the machine's units."""
    quantity, units = prescribable(machine.model)[name], machine.units
    return float(quantity.of(machine.model, u, {**machine.values, **u})) * (
        units.of(quantity.dimension) if units else 1.0
    )


def solve_tuned(machine: Machine, tuning: Tuning, u: Mapping[str, float], most: int = TUNED.most) -> Solved:
    """The solution of the equations with tuned parameters to which the way leads from an orbit of the machine, the
    unknowns of its half by name, in which at most `most` attempts fail; raises `NoOrbit` where it
    does not lead to the prescribed values."""
    names = tuple(tuning.values)
    equations = tuned_equations(machine, tuning.names, names)
    if "contact_duration" in equations.statement.unknowns and "contact_duration" not in u:
        raise NoOrbit(f"the contact of the first orbit does not end: it has no {' and no '.join(names)}")
    start = {**{name: machine.values[name] for name in equations.statement.tuned}, **u}
    here = np.array([prescribed_value(machine, name, start) for name in names])
    targets = np.array(
        [own if value is None else value for own, value in zip(here, tuning.values.values(), strict=True)]
    )
    x = np.array([start[name] for name in equations.statement.unknowns])
    return Solved.of(machine.model, METHOD, _along_way(machine, equations, x, names, here, targets, most))


def _along_way(
    machine: Machine,
    equations: Shooting,
    x: np.ndarray,
    prescribed: Sequence[str],
    here: np.ndarray,
    there: np.ndarray,
    most: int,
) -> NodedSolution:
    """The solution as prescribed quantities go from their values `here` (k,) to those `there`."""
    names, own, places = [*prescribed], machine.values, list(map(equations.parameters.index, prescribed))

    def p_at(share: float) -> np.ndarray:
        p = np.array([own.get(name, 0.0) for name in equations.parameters])
        p[places] = there if share == 1 else here + share * (there - here)
        return p

    def text(share: float) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, p_at(share)[places], strict=True))

    reached, step = 0.0 if names else 1.0, 1.0
    try:
        found = solved_with_nodes(equations, x, p_at(0.0))
    except NoOrbit as error:
        raise _no_beginning(equations, x, p_at(0.0), names, error) from None
    while reached < 1:
        x, jacobian = found.x, found.equations.evaluate(found.x, p_at(reached), tuple(names)).jacobian
        tangent = -solve(jacobian[:, : len(x)], jacobian[:, len(x) :] @ (there - here))
        while True:
            share = 1.0 if step >= 1 - reached else reached + step
            try:
                found = solved_near(machine, found, x + (share - reached) * tangent, p_at(share))
                break
            except TimeOver as over:
                tuned = ", ".join(f"{name} = {value:.6g}" for name, value in tuned_values(equations, found.u).items())
                raise over.reached(f"on the way to {text(1.0)} it reached {text(reached)}, with {tuned}") from None
            except (NoOrbit, FlowError, InputError) as error:
                step, most = min(step, 1 - reached) / 2, most - 1
                if step < TUNED.shortest_way or not most:
                    at, wanted = (dict(zip(names, p[places].tolist(), strict=True)) for p in (p_at(reached), p_at(1.0)))
                    raise _no_way(equations, found.u, at, wanted, tangent[len(x) - len(found.u) :], error) from None
        reached, step = share, 2 * step
    return replace(found, p=equations.with_tuned(found.u[None], p_at(1.0)[None])[0])


def _no_beginning(equations: Shooting, x: np.ndarray, p: np.ndarray, names: Sequence[str], error: NoOrbit) -> NoOrbit:
    """The error of a search that does not converge where it begins, at unknowns (n,) with parameters (np,): whether the
    prescribed quantities depend on the tuned parameters at all says the rank of the equations."""
    all_of, tuned = ", ".join(names) or "the orbit", ", ".join(_without_step(equations.statement.tuned))
    if unused := ", ".join(_unused(equations, x, p)):
        reason = f"no equation of half an orbit contains {unused}"
        return NoOrbit(f"{all_of} does not depend on {unused}: tune another number ({reason})")
    try:
        jacobian = equations.evaluate(x, p).jacobian * np.maximum(np.abs(x), TUNED.smallest)
        sizes = np.linalg.svd(jacobian / np.abs(jacobian).max(1, keepdims=True))[1]
        if sizes[-1] <= TUNED.rank * sizes[0]:
            return NoOrbit(f"{all_of} does not depend on {tuned}: tune another number")
    except (FlowError, np.linalg.LinAlgError):
        pass
    runs = STEP_LENGTH in equations.parameters
    remedy = "begin near a design found by find_branch_points, where runs begin" if runs else "give a start"
    return NoOrbit(f"the search for {all_of} by tuning {tuned} does not converge where it begins: {remedy} ({error})")


def _unused(equations: Shooting, x: np.ndarray, p: np.ndarray) -> list[str]:
    """The names of tuned parameters that no equation has, by the derivatives near unknowns (n,), parameters (np,)."""
    beside = x * (1 + 1e-3 * np.arange(1, len(x) + 1) / len(x))  # not in a place of symmetry
    try:
        columns = equations.evaluate(beside, p).jacobian[:, equations.own : len(x)]
    except (NoOrbit, FlowError):
        return []
    return [name for name, column in zip(equations.statement.tuned, columns.T, strict=True) if not column.any()]


def solved_near(machine: Machine, known: NodedSolution, guess: np.ndarray, p: np.ndarray) -> NodedSolution:
    """The solution near one that is predicted from a known one, with its nodes; raises `NoOrbit` where it is far from
    that, and `InputError` where the machine cannot have the tuned values."""
    equations = known.equations
    own = equations.own
    if not (np.isfinite(guess).all() and (guess[equations.durations] > 0).all()):
        raise NoOrbit("the step leads to a negative time or speed")
    machine.with_values(**tuned_values(equations, guess))
    found, evaluation = equations.newton(guess, p)
    sizes = np.maximum(np.abs(found[:own]), 0.1 * np.abs(found[:own]).max())
    if np.max(np.abs(found - guess)[:own] / sizes) > TUNED.corrected:
        raise NoOrbit("the corrector ends far from the predicted orbit")
    machine.with_values(**tuned_values(equations, found))
    return replace(known, x=found, p=p, evaluation=evaluation).divided()


def tuned_values(equations: Shooting, x: np.ndarray) -> dict[str, float]:
    """The values of the tuned parameters at unknowns (n,), by name."""
    return dict(zip(equations.statement.tuned, x[equations.own :].tolist(), strict=True))


def _without_step(names: Iterable[str]) -> list[str]:
    """The names of tuned parameters except the step, which users do not name."""
    return [name for name in names if name != STEP_LENGTH]


def _no_way(
    equations: Shooting, x: np.ndarray, at: Mapping[str, float], wanted: Mapping[str, float], tangent: np.ndarray,
    error: Exception,
) -> NoOrbit:  # fmt: skip
    """The error of a way that ends before the prescribed values."""
    values = tuned_values(equations, x)
    names = ", ".join(_without_step(values))
    rates = dict(zip(values, tangent[equations.own :].tolist(), strict=True))
    tuned = ", ".join(
        f"{name} = {x:.6g} and {'rising' if rates[name] > 0 else 'falling'}" for name, x in values.items()
    )
    there, reached = (", ".join(f"{name} = {x:.6g}" for name, x in each.items()) for each in (wanted, at))
    return NoOrbit(f"no orbit with {there} is reached by tuning {names}: at {reached}, with {tuned}, {error}")


def check_determined(solved: Solved, closing: np.ndarray | None = None) -> None:
    """Raise `NoOrbit` where one solution of a machine that sticks does not determine its tuned parameters at all, as
    the vertical hop; `closing` as in `errors_of_tuned`."""
    if solved.model.sticks and _may_be_singular(solved, closing):
        tuned = tuned_values(solved.equations, solved.us[0])
        values = ", ".join(f"{name} = {tuned[name]:.6g}" for name in _without_step(tuned) or tuned)
        raise NoOrbit(f"the orbit does not determine {values}: {REMEDIES[True]}")


def errors_of_tuned(solved: Solved, closing: np.ndarray | None = None) -> dict[str, float]:
    """Bounds on the errors of the tuned parameters of one solution, by name, in the machine's units, with rows (1, n)
    that close the equations as in `error_bounds`; raises `NoOrbit` where the orbit does not determine one of them, as a
    run without speed, which is the hop of any inertia."""
    nodes, solved = solved.by_nodes is not None, solved.by_nodes or solved
    equations, found = solved.equations, dict[str, float]()
    check_determined(solved, closing)
    for name, value in tuned_values(equations, solved.us[0]).items():
        bounds, _ = error_bounds(equations, solved.us, solved.ps, solved.evaluation, closing, False, name, nodes)
        found[name] = float(bounds[0])
        if not found[name] <= TUNED.worst * max(abs(value), TUNED.smallest):
            off = f"which may be off by {found[name]:.1e}"
            raise NoOrbit(
                f"the orbit does not determine {name} = {value:.6g}, {off}: {REMEDIES[bool(solved.model.sticks)]}"
            )
    return found


def _may_be_singular(solved: Solved, closing: np.ndarray | None) -> bool:
    """Whether the Jacobian of one solution loses its rank within a step of Newton's method from there; `closing` as in
    `errors_of_tuned`.

    Beside a vertical hop the derivatives by tuned parameters are proportional to the lateral motion. In a run without
    speed that is rounding: it is not 0, so that the Jacobian seems to have full rank, but the step takes it there.
    """
    (jacobian,), n = solved.evaluation.jacobian, solved.equations.size
    rows = np.zeros((0, n)) if closing is None else closing
    square = np.vstack([jacobian, rows])
    x = solved.us[0] - solve(square, np.append(solved.evaluation.residual[0], np.zeros(len(rows))))[:n]
    try:
        there = np.hstack([solved.equations.evaluate(x, solved.ps[0]).jacobian, jacobian[:, n:]])
    except FlowError:
        return True
    # Whatever the units of unknowns and equations are, these are all 1 where the Jacobian does not change.
    change = solve(square, np.vstack([there, rows]))
    return not (np.isfinite(change).all() and np.abs(np.linalg.eigvals(change)).min() > TUNED.rank_in_step)
