"""The orbits of many machines that differ only in numbers, all continued together from one orbit.

The parameters of each machine are reached along a straight line from those of the first one, or else one parameter
after the other. So no result depends on the other machines.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, NoOrbit
from ..flow import FLOW_CONTROL
from ..model import Machine, Model
from ..numerics import TINY, Array, solve
from ..running import interrupts
from ..shooting import (
    NEWTON,
    Evaluation,
    NodedSolution,
    Shooting,
    equations_of,
    error_bounds,
    iterative,
    method_of,
    settles,
    vector,
)
from .certification import Certified, Solved, certified, certified_orbit, solve_from
from .orbit import Orbit
from .parameter_paths import STRAIGHT_WAYS, WayOptions, along_ways, sizes_of_unknowns
from .start import stated_unknowns

# The statuses of a machine whose orbit is not reached: the orbits end at a fold on the way, or the way was too hard.
AT_FOLD, NOT_REACHED = "ends", "not reached"
# The most integration steps of a motion that is followed together with others.
STEPS_TOGETHER = FLOW_CONTROL.together
# What helps where no other reason is known.
NEARER = "give a start closer to it"


class Continued(NamedTuple):
    """The orbits of machines (m,) continued from one.

    unknowns : (m, n), NaN where an orbit is not reached
    stopped : by index of the machines whose orbit is not reached, the status and the reason
    solutions : of the equations, certified or not, each with the indices of its machines
    """

    unknowns: Array
    stopped: dict[int, tuple[str, str]]
    solutions: list[tuple[Array, Solved]]

    def certified(self) -> tuple[list[Certified], dict[int, tuple[str, str]]]:
        """The certified orbits, whose `which` are indices of machines; and by index of the other machines the status
        and the reason."""
        parts, stopped = list[Certified](), dict(self.stopped)
        for which, solved in self.solutions:
            found, refused = certified(solved, quickly=True)
            parts += [found._replace(which=which[found.which])] if found else []
            again = np.array(sorted(refused), int)
            if len(again):
                found, refused = certified(solved.only(again))
                parts += [found._replace(which=which[again[found.which]])] if found else []
                stopped |= {int(which[again[i]]): ("no orbit", str(error)) for i, error in refused.items()}
        return parts, stopped

    def errors(self, name: str) -> Array:
        """Bounds (m,) on the errors of a tuned parameter, NaN where an orbit is not reached."""
        errors = np.full(len(self.unknowns), np.nan)
        for which, solved in self.solutions:
            by, nodes = solved.by_nodes or solved, solved.by_nodes is not None
            own = by.equations, by.us, by.ps, by.evaluation
            errors[which] = error_bounds(*own, quickly=True, unknown=name, by_nodes=nodes)[0]
        return errors


def continued(
    machine: Machine, orbit: Orbit, ps: Array, varied: Sequence[str],
    report: Callable[[int], None] = lambda ended: None, options: WayOptions = STRAIGHT_WAYS,
) -> Continued:  # fmt: skip
    """The orbits of machines with parameters (m, np) of the machine's model, continued from the machine's own orbit.

    varied : names of the parameters in which the machines differ from the first one
    report : called with the number of machines whose way has ended
    options : of the steps along the ways
    """
    model, names = machine.model, tuple(machine.values)
    method = iterative(method_of(model))
    equations = equations_of(model, method, names)
    known = stated_unknowns(model, orbit)
    u = np.array([known[name] for name in equations.statement.unknowns])
    return _continued_from(model, method, equations, u, vector(machine.values), ps, varied, report, options)


def continued_tuned(
    known: Solved, ps: Array, varied: Sequence[str], report: Callable[[int], None] = lambda ended: None
) -> Continued:
    """The orbits with tuned parameters of machines whose other parameters, of the names of the equations, are those in
    ps (m, np), continued from a known solution. Arguments as in `continued`."""
    equations = known.equations
    start = known.model, known.method, equations, known.us[0], known.ps[0]
    return _continued_from(*start, ps, {*varied} - {*equations.statement.tuned}, report, STRAIGHT_WAYS)


def _continued_from(
    model: Model, method: str, equations: Shooting, u: Array, p: Array, ps: Array, varied: Collection[str],
    report: Callable[[int], None], options: WayOptions,
) -> Continued:  # fmt: skip
    """`continued` from unknowns (n,) at parameters (np,), those of the equations."""
    names = equations.parameters
    vary = tuple(name for name in names if name in varied)
    reached = along_ways(equations, np.tile(u, (len(ps), 1)), np.tile(p, (len(ps), 1)), ps, vary, report, options)
    us, noded, reasons, places = reached.us, reached.noded, reached.reasons, [names.index(name) for name in vary]
    for order in (places, places[::-1]) if len(places) > 1 else ():
        left = np.flatnonzero(np.isnan(us[:, 0]))
        if len(left):
            us[left], others = _by_corners(equations, u, p, ps[left], vary, order, options)
            noded |= {int(left[i]): each for i, each in others.items()}
    solutions = _solutions_at_ends(model, method, equations, us, ps, noded, options)
    us = np.full(us.shape, np.nan)
    for which, solved in solutions:
        us[which] = solved.us
    left = np.flatnonzero(np.isnan(us[:, 0]))
    if (reached.shares[left] == 0).any() and (steps := _steps_of(equations, u, p)) > STEPS_TOGETHER:
        too_long = (
            f"the motion of the start takes {steps} integration steps, but a sweep follows at most {STEPS_TOGETHER}"
        )
        reasons |= dict.fromkeys(left[reached.shares[left] == 0].tolist(), too_long)
    stopped = {
        i: _why_stopped(names, p, ps[i], vary, reached.shares[i], reached.folds[i], reasons.get(i, NEARER))
        for i in left.tolist()
    }
    return Continued(us, stopped, solutions)


def _solutions_at_ends(
    model: Model, method: str, equations: Shooting, us: Array, ps: Array, noded: Mapping[int, NodedSolution],
    options: WayOptions,
) -> list[tuple[Array, Solved]]:  # fmt: skip
    """The solutions at the ends of ways, near unknowns (m, n), NaN for none: all those without nodes together, and
    those with nodes one by one; with the indices of the machines."""
    plain = us.copy()
    plain[[*noded]] = np.nan
    which, found, evaluation = _at_ends(equations, plain, ps, options)
    solutions = list[tuple[Array, Solved]]()
    if evaluation is not None:
        own_ps = equations.with_tuned(found, ps[which])
        solutions.append((which, Solved(model, method, equations, found, own_ps, evaluation)))
    for i, each in sorted(noded.items()):
        own = replace(each, p=equations.with_tuned(each.u[None], each.p[None])[0])
        solutions.append((np.array([i]), Solved.of(model, method, own)))
    return solutions


def continued_orbits(
    machine: Machine, orbit: Orbit, machines: Sequence[Machine], options: WayOptions = STRAIGHT_WAYS
) -> list[Orbit | NoOrbit]:
    """The orbits, without dimensions, of machines with the model of a machine, continued from the machine's own orbit;
    in place of one the reason why there is none."""
    ps = np.array([vector(each.values) for each in machines])
    varied = [name for name, value in machine.values.items() if any(each.values[name] != value for each in machines)]
    found = continued(machine, orbit, ps, varied, options=options)
    orbits: dict[int, Orbit | NoOrbit] = {i: NoOrbit(reason) for i, (_, reason) in found.stopped.items()}
    for which, solved in found.solutions:
        for k, i in enumerate(which.tolist()):
            interrupts.heed()
            began, each = time.perf_counter(), solved.only(np.array([k]))
            try:
                if each.by_nodes is None:
                    known = NodedSolution(each.equations, None, each.us[0], each.ps[0], each.evaluation)
                    each = Solved.of(each.model, each.method, known.divided())
                orbits[i] = certified_orbit(machines[i], each, began=began)
            except NoOrbit as error:
                orbits[i] = error
    return [orbits[i] for i in range(len(machines))]


def orbit_from_unknowns(machine: Machine, u: Array) -> Orbit:
    """The certified orbit, without dimensions, of a machine whose unknowns (n,) by the simplest method are known."""
    began, method = time.perf_counter(), iterative(method_of(machine.model))
    return certified_orbit(machine, solve_from(machine, method, u), began=began)


def _by_corners(
    equations: Shooting,
    u: Array,
    p: Array,
    ps: Array,
    vary: tuple[str, ...],
    order: Sequence[int],
    options: WayOptions,
) -> tuple[Array, dict[int, NodedSolution]]:
    """The unknowns (m, n) at parameters (m, np), reached by one parameter after the other from an orbit with unknowns
    (n,) at parameters (np,), NaN where they are not reached; and the solutions with nodes by index."""
    noded = dict[int, NodedSolution]()
    us, at = np.tile(u, (len(ps), 1)), np.tile(p, (len(ps), 1))
    for place in order:
        ends, able = at.copy(), np.flatnonzero(np.isfinite(us[:, 0]))
        ends[:, place] = ps[:, place]
        if len(able):
            reached = along_ways(equations, us[able], at[able], ends[able], vary, options=options)
            us[able], noded = reached.us, {int(able[i]): each for i, each in reached.noded.items()}
        at = ends
    return us, noded


def _at_ends(
    equations: Shooting, guesses: Array, ps: Array, options: WayOptions
) -> tuple[Array, Array, Evaluation | None]:
    """The indices (k,) of unknowns (m, n), NaN for none, from which Newton's method converges to rounding and nearby,
    the solutions (k, n), and the equations there."""
    us, left, last = guesses.copy(), np.flatnonzero(np.isfinite(guesses[:, 0])), np.full(len(guesses), np.inf)
    done = np.zeros(len(us), bool)
    for _ in range(options.corrections):
        which, evaluation = equations.evaluate_lanes(us[left], ps[left]) if len(left) else (left, None)
        if evaluation is None:
            break
        left = left[which]
        steps = solve(evaluation.jacobian, -evaluation.residual[:, :, None])[:, :, 0]
        sizes = (np.abs(steps) / np.maximum(np.abs(us[left]), NEWTON.smallest_unit)).max(1)
        ended = settles(sizes, last[left], evaluation.amplification) > 0
        us[left] += steps
        done[left[ended]], last[left] = True, sizes
        left = left[~ended & np.isfinite(sizes)]
    sizes = sizes_of_unknowns(us, 0.1 * np.abs(guesses[:, equations.own : us.shape[1]]) + TINY)
    which = np.flatnonzero(done & ((np.abs(us - guesses) / sizes).max(1) < options.moved))
    able, evaluation = equations.evaluate_lanes(us[which], ps[which])
    return which[able], us[which[able]], evaluation


def _steps_of(equations: Shooting, u: Array, p: Array) -> int:
    """The number of integration steps of the longest arc at unknowns (n,), 0 where it cannot be followed."""
    with suppress(FlowError):
        return max(int(each.counts[0]) for each in equations.evaluate_all(u[None], p[None]).trajectories)
    return 0


def _why_stopped(
    names: Sequence[str], p: Array, end: Array, vary: Sequence[str], share: float, fold: float, reason: str
) -> tuple[str, str]:
    """The status of a machine whose orbit is not reached, and the reason in words, which end with one."""
    at = p + min(share if fold == np.inf else fold, 1.0) * (end - p)
    where = ", ".join(f"{name} = {at[names.index(name)]:.6g}" for name in vary)
    if fold < np.inf:
        return AT_FOLD, f"on the way from the start the orbits end in a fold, at {where}"
    return NOT_REACHED, f"the way from the start is lost at {where}: {reason}"
