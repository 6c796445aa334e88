"""The orbits of many machines that differ in numbers alone, each continued from one orbit, all of them together.

The parameters of every machine are reached along a straight way from those of the first one, or else by one parameter
after the other. So no result depends on the other machines. In each round every machine takes a step of its own length
along its way: a predictor from the tangents, and Newton's method back to the orbits. A step is accepted where the
predictor was good and the orientation of the equations stays, so that no orbit beyond a fold is mistaken for this one.
"""

import time
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..model.machine import Machine
from ..model.model import Model
from ..numerics.polynomial_roots import TINY
from ..numerics.roots import Array, solve
from ..running import interrupts
from ..shooting.error_bound import error_bounds
from ..shooting.formulations import equations_of, iterative, method_of, vector
from ..shooting.newton_kernel import MOST_NEWTON_STEPS
from ..shooting.single_shooting import SMALLEST_UNIT, Evaluation, Shooting, settles
from .certified import Certified, Solved, certified, certified_orbit, solve_from
from .find import stated_unknowns
from .orbit import Orbit

# The statuses of a machine whose orbit is not reached: the orbits end at a fold on the way, or the way was too hard.
AT_FOLD, NOT_REACHED = "ends", "not reached"
# A step is accepted where Newton's method moves the prediction by no more than the first share of the unknowns' sizes;
# the next step is such that it moves by the second.
WORST_PREDICTION, AIMED_PREDICTION = 0.1, 0.03
# Where the orientation of the equations changes, a step over a branch point is accepted if the correction is no larger
# than this share of the step; beyond a fold it would be as large as the step.
ACROSS_BRANCH = 0.02
# On the way a point is known well enough for the next step where a Newton step is below the first share; a step that
# shrinks by no more than the second is not in the basin of the orbit.
ON_THE_WAY, CONTRACTION = 1e-2, 0.3
# Of the step after an accepted one to the one before, at least and at most; and after a refused one.
LEAST_GROWTH, LARGEST_GROWTH, AFTER_REFUSAL = 0.3, 4.0, 0.25
# Where the shortest step, as a share of the way, is refused, or after the most rounds, the way is given up.
SHORTEST_ON_WAY, MOST_STEPS_ON_WAY = 1e-9, 200
# A step goes over no more than the first share of the distance to a fold. The fold is certain where two successive
# estimates of its place differ by less than the second share of what lies beyond it, and is nearer than the third.
TOWARDS_FOLD, SAME_FOLD, NEAR_FOLD = 0.6, 0.02, 1e-3


class Continued(NamedTuple):
    """The orbits of machines (m,) continued from one.

    parts : the certified orbits; their `which` are indices of machines
    unknowns : (m, n), NaN where an orbit is not reached
    stopped : by index of the other machines, the status and the reason
    """

    parts: list[Certified]
    unknowns: Array
    stopped: dict[int, tuple[str, str]]


class _Way(NamedTuple):
    """The result of following ways: the unknowns (m, n) at their ends, NaN for those that were given up; their shares
    (m,) of the way that are done, and the shares (m,) at which there is a fold, infinite without any."""

    us: Array
    shares: Array
    folds: Array


def continued(
    machine: Machine, orbit: Orbit, ps: Array, varied: Sequence[str], report: Callable[[int], None] = lambda ended: None
) -> Continued:
    """The orbits of machines with parameters (m, np) of the machine's model, continued from the machine's own orbit.

    varied : names of the parameters in which the machines differ from the first one
    report : called with the number of machines whose way has ended
    """
    model, names = machine.model, tuple(machine.values)
    method = iterative(method_of(model))
    equations = equations_of(model, method, names)
    known = stated_unknowns(model, orbit)
    u = np.array([known[name] for name in equations.statement.unknowns])
    return _continued_from(model, method, equations, u, vector(machine.values), ps, varied, report)


def continued_tuned(
    known: Solved, ps: Array, varied: Sequence[str], report: Callable[[int], None] = lambda ended: None
) -> tuple[Continued, dict[str, Array]]:
    """The orbits with tuned parameters of machines whose other parameters, of the names of the equations, are those in
    ps (m, np), continued from a known solution; and bounds (m,) on the errors of the tuned ones by name, NaN for those
    that are not reached. Arguments as in `continued`."""
    equations, tuned = known.equations, known.equations.statement.tuned
    found = _continued_from(
        known.model, known.method, equations, known.us[0], known.ps[0], ps, {*varied} - {*tuned}, report
    )
    errors = {name: np.full(len(ps), np.nan) for name in tuned}
    which = np.flatnonzero(np.isfinite(found.unknowns[:, 0]))
    if len(which):
        us, own = found.unknowns[which], equations.with_tuned(found.unknowns[which], ps[which])
        evaluation = equations.evaluate_all(us, own)
        for name in tuned:
            errors[name][which] = error_bounds(equations, us, own, evaluation, quickly=True, unknown=name)[0]
    return found, errors


def _continued_from(
    model: Model, method: str, equations: Shooting, u: Array, p: Array, ps: Array, varied: Collection[str],
    report: Callable[[int], None],
) -> Continued:  # fmt: skip
    """`continued` from unknowns (n,) at parameters (np,), those of the equations."""
    names = equations.parameters
    vary = tuple(name for name in names if name in varied)
    reached = _along_ways(equations, np.tile(u, (len(ps), 1)), np.tile(p, (len(ps), 1)), ps, vary, report)
    us, places = reached.us, [names.index(name) for name in vary]
    for order in (places, places[::-1]) if len(places) > 1 else ():
        left = np.flatnonzero(np.isnan(us[:, 0]))
        us[left] = _by_corners(equations, u, p, ps[left], vary, order) if len(left) else us[left]
    which, solutions, evaluation = _at_ends(equations, us, ps)
    us = np.full(us.shape, np.nan)
    us[which] = solutions
    stopped = {
        i: _why_stopped(names, p, ps[i], vary, reached.shares[i], reached.folds[i])
        for i in np.flatnonzero(np.isnan(us[:, 0])).tolist()
    }
    if evaluation is None:
        return Continued([], us, stopped)
    solved = Solved(model, method, equations, us[which], equations.with_tuned(us[which], ps[which]), evaluation)
    parts = list[Certified]()
    found, refused = certified(solved, quickly=True)
    parts += [found._replace(which=which[found.which])] if found else []
    again = np.array(sorted(refused), int)
    if len(again):
        found, refused = certified(solved.only(again))
        parts += [found._replace(which=which[again[found.which]])] if found else []
        stopped |= {int(which[again[i]]): ("no orbit", str(error)) for i, error in refused.items()}
    return Continued(parts, us, stopped)


def continued_orbits(machine: Machine, orbit: Orbit, machines: Sequence[Machine]) -> list[Orbit | NoOrbit]:
    """The orbits, without dimensions, of machines with the model of a machine, continued from the machine's own orbit;
    in place of one the reason why there is none."""
    ps = np.array([vector(each.values) for each in machines])
    varied = [name for name, value in machine.values.items() if any(each.values[name] != value for each in machines)]
    found, orbits = continued(machine, orbit, ps, varied), list[Orbit | NoOrbit]()
    for i, (each, u) in enumerate(zip(machines, found.unknowns, strict=True)):
        try:
            if i in found.stopped:
                raise NoOrbit(found.stopped[i][1])
            orbits.append(orbit_from_unknowns(each, u))
        except NoOrbit as error:
            orbits.append(error)
    return orbits


def orbit_from_unknowns(machine: Machine, u: Array) -> Orbit:
    """The certified orbit, without dimensions, of a machine whose unknowns (n,) by the simplest method are known."""
    began, method = time.perf_counter(), iterative(method_of(machine.model))
    return certified_orbit(machine, solve_from(machine, method, u), began=began)


def _along_ways(
    equations: Shooting, us: Array, starts: Array, ends: Array, vary: tuple[str, ...],
    report: Callable[[int], None] = lambda ended: None,
) -> _Way:  # fmt: skip
    """The orbits at the ends of straight ways of the parameters (m, np), from orbits with unknowns (m, n) at their
    starts; the parameters `vary` change along the ways."""
    places, count = [equations.parameters.index(name) for name in vary], len(us)
    ways, lanes = (ends - starts)[:, places, None], _Lanes(us, equations.own)
    which, evaluation = equations.evaluate_lanes(us, starts, vary)
    if evaluation is not None:
        lanes.begin(which, evaluation.jacobian, ways[which])
    for _ in range(MOST_STEPS_ON_WAY):
        if not len(going := np.flatnonzero(lanes.going)):
            break
        interrupts.heed()
        new, guesses = lanes.predicted(going)
        ps = starts[going] + new[:, None] * (ends - starts)[going]
        ps[new == 1.0] = ends[going[new == 1.0]]
        solved, found, jacobians = _near_guesses(equations, guesses, ps, vary, lanes.least[going])
        lanes.accept(going, new, guesses, solved, found, jacobians, ways)
        report(int(np.count_nonzero(~lanes.going)))
    done = lanes.shares == 1.0
    # Just behind a fold the last point is near the orbits before it, and Newton's method does not converge from there.
    beside = done & (lanes.folds < 1 + NEAR_FOLD)
    folds = np.where(lanes.at_fold | beside, lanes.folds, np.inf)
    return _Way(np.where(done[:, None], lanes.us, np.nan), lanes.shares, folds.reshape(count))


class _Lanes:
    """The machines (m,) on their ways: whether each is `going`, the share of its way that is done, its unknowns there
    and their derivatives by the share, the same one step before, the length of the next step, the orientation of the
    equations, and the share at which a fold is expected, infinite where none is; and the least sizes of those
    unknowns, after the first `own` ones, that are tuned parameters."""

    def __init__(self, us: Array, own: int):
        count = len(us)
        self.least = 0.1 * np.abs(us[:, own:])
        self.us, self.tangents, self.before, self.tangents_before = us.copy(), *np.full((3, *us.shape), np.nan)
        self.shares, self.steps, self.orientations = np.zeros(count), np.ones(count), np.zeros(count)
        self.shares_before, self.folds = np.full(count, np.nan), np.full(count, np.inf)
        self.going, self.at_fold = np.zeros(count, bool), np.zeros(count, bool)

    def begin(self, which: Array, jacobians: Array, ways: Array) -> None:
        """Begin those lanes (k,) at whose starts the equations have these Jacobians."""
        self.tangents[which], self.orientations[which] = _tangents(jacobians, ways)
        self.going[which] = np.isfinite(self.tangents[which]).all(1)
        tuned = self.least.shape[1]
        changes = np.nan_to_num(np.abs(self.tangents[:, self.tangents.shape[1] - tuned :]))
        self.least = np.maximum(np.maximum(self.least, 0.1 * changes), TINY)

    def predicted(self, lanes: Array) -> tuple[Array, Array]:
        """The shares (k,) to which some lanes step, and the unknowns (k, n) predicted there: on the cubic through the
        last two points with their tangents, or on the tangent."""
        done, left = self.shares[lanes], 1 - self.shares[lanes]
        steps = np.minimum(self.steps[lanes], left)
        new = np.where(steps < left, done + steps, 1.0)
        u, by_share = self.us[lanes], self.tangents[lanes]
        guesses = u + (new - done)[:, None] * by_share
        gaps = (done - self.shares_before[lanes])[:, None]
        ahead = (new - done)[:, None] / gaps
        first = self.before[lanes] - u + gaps * by_share
        second = gaps * (self.tangents_before[lanes] - by_share)
        cubic = guesses + (second + 3 * first) * ahead**2 + (second + 2 * first) * ahead**3
        return new, np.where(np.isfinite(cubic), cubic, guesses)

    def accept(
        self, lanes: Array, new: Array, guesses: Array, solved: Array, found: Array, jacobians: Array, ways: Array
    ) -> None:
        """Take the steps of lanes (k,) to shares (k,) that are good, and shorten the others: those that are `solved`,
        by their indices, with the unknowns found and the Jacobians there."""
        refused, lanes_found, old = np.ones(len(lanes), bool), lanes[solved], self.us[lanes[solved]]
        if len(solved):
            tangents, orientations = _tangents(jacobians, ways[lanes_found])
            sizes = _sizes_of_unknowns(found, self.least[lanes_found])
            corrections = (np.abs(found - guesses[solved]) / sizes).max(1)
            changes = (np.abs(found - old) / sizes).max(1)
            turned = orientations != self.orientations[lanes_found]
            good = (corrections <= WORST_PREDICTION) & np.isfinite(tangents).all(1)
            good &= ~turned | (corrections <= ACROSS_BRANCH * changes)
            refused[solved[good]] = False
            growth = (AIMED_PREDICTION / np.maximum(corrections, 1e-12)) ** (1 / 3)
            self._take(
                lanes_found[good], new[solved][good], found[good], tangents[good], orientations[good],
                np.clip(growth[good], LEAST_GROWTH, LARGEST_GROWTH),
            )  # fmt: skip
        short = lanes[refused]
        self.steps[short] = AFTER_REFUSAL * np.minimum(self.steps[short], 1 - self.shares[short])
        lost = short[self.steps[short] < SHORTEST_ON_WAY]
        self.going[lost] = False
        self.at_fold[lost] = self.folds[lost] - self.shares[lost] < NEAR_FOLD * self.folds[lost]

    def _take(self, lanes: Array, new: Array, us: Array, tangents: Array, orientations: Array, growth: Array) -> None:
        """Step lanes (k,) to shares (k,)."""
        done, old = self.shares[lanes], self.tangents[lanes]
        # Near a fold the inverse square of the tangent's length falls to zero like a straight line.
        rates = [
            1 / np.maximum(((t / _sizes_of_unknowns(u, self.least[lanes])) ** 2).sum(1), TINY)
            for t, u in ((old, self.us[lanes]), (tangents, us))
        ]
        with np.errstate(all="ignore"):
            folds = new + rates[1] * (new - done) / (rates[0] - rates[1])
        folds = np.where(rates[0] > rates[1], folds, np.inf)
        with np.errstate(invalid="ignore"):
            certain = (np.abs(folds - self.folds[lanes]) < SAME_FOLD * np.minimum(folds, 1 - folds)) & (
                folds - new < NEAR_FOLD * folds
            )
        self.before[lanes], self.tangents_before[lanes], self.shares_before[lanes] = self.us[lanes], old, done
        self.us[lanes], self.tangents[lanes], self.shares[lanes], self.orientations[lanes] = (
            us,
            tangents,
            new,
            orientations,
        )
        self.folds[lanes] = folds
        self.steps[lanes] = np.minimum(growth * (new - done), TOWARDS_FOLD * (folds - new))
        self.at_fold[lanes] = certain
        self.going[lanes] = (new < 1.0) & ~certain


def _sizes_of_unknowns(us: Array, least: Array) -> Array:
    """The unit of each of the unknowns (m, n), as of a curve's points; the last ones, tuned parameters, have their own
    least sizes (m, t)."""
    sizes, own = np.abs(us), us.shape[1] - least.shape[1]
    sizes[:, :own] = np.maximum(sizes[:, :own], 0.1 * sizes[:, :own].max(1, keepdims=True))
    sizes[:, own:] = np.maximum(sizes[:, own:], least)
    return sizes


def _tangents(jacobians: Array, ways: Array) -> tuple[Array, Array]:
    """The derivatives (m, n) of the unknowns by the share of the way, and the orientations (m,) of the equations."""
    n = jacobians.shape[1]
    tangents = -solve(jacobians[:, :, :n], jacobians[:, :, n:] @ ways)[:, :, 0]
    return tangents, np.linalg.slogdet(jacobians[:, :, :n])[0]


def _near_guesses(
    equations: Shooting, guesses: Array, ps: Array, vary: tuple[str, ...], least: Array
) -> tuple[Array, Array, Array]:
    """The indices (k,) of guesses (m, n) from which Newton's method converges, the unknowns (k, n) nearly there, and
    the Jacobians (k, n, n + k) at the last points before."""
    us, left, last = guesses.copy(), np.arange(len(guesses)), np.full(len(guesses), np.inf)
    done, jacobians = np.zeros(len(us), bool), np.zeros((len(us), us.shape[1], us.shape[1] + len(vary)))
    for _ in range(MOST_NEWTON_STEPS):
        which, evaluation = equations.evaluate_lanes(us[left], ps[left], vary)
        if evaluation is None:
            break
        left, n = left[which], us.shape[1]
        steps = -solve(evaluation.jacobian[:, :, :n], evaluation.residual[:, :, None])[:, :, 0]
        with np.errstate(invalid="ignore"):
            sizes = (np.abs(steps) / _sizes_of_unknowns(us[left], least[left])).max(1)
            enough, goes = sizes < ON_THE_WAY, (sizes < WORST_PREDICTION) & (sizes < CONTRACTION * last[left])
        ended = left[enough]
        us[ended] += steps[enough]
        done[ended], jacobians[ended] = True, evaluation.jacobian[enough]
        goes &= ~enough
        us[left[goes]] += steps[goes]
        last[left] = sizes
        left = left[goes]
        if not len(left):
            break
    which = np.flatnonzero(done)
    return which, us[which], jacobians[which]


def _by_corners(
    equations: Shooting, u: Array, p: Array, ps: Array, vary: tuple[str, ...], order: Sequence[int]
) -> Array:
    """The unknowns (m, n) at parameters (m, np), reached by one parameter after the other from an orbit with unknowns
    (n,) at parameters (np,); NaN where they are not reached."""
    us, at = np.tile(u, (len(ps), 1)), np.tile(p, (len(ps), 1))
    for place in order:
        ends, able = at.copy(), np.flatnonzero(np.isfinite(us[:, 0]))
        ends[:, place] = ps[:, place]
        if len(able):
            us[able] = _along_ways(equations, us[able], at[able], ends[able], vary).us
        at = ends
    return us


def _at_ends(equations: Shooting, guesses: Array, ps: Array) -> tuple[Array, Array, Evaluation | None]:
    """The indices (k,) of unknowns (m, n), NaN for none, from which Newton's method converges to rounding and nearby,
    the solutions (k, n), and the equations there."""
    us, left, last = guesses.copy(), np.flatnonzero(np.isfinite(guesses[:, 0])), np.full(len(guesses), np.inf)
    done = np.zeros(len(us), bool)
    for _ in range(MOST_NEWTON_STEPS):
        which, evaluation = equations.evaluate_lanes(us[left], ps[left]) if len(left) else (left, None)
        if evaluation is None:
            break
        left = left[which]
        steps = solve(evaluation.jacobian, -evaluation.residual[:, :, None])[:, :, 0]
        sizes = (np.abs(steps) / np.maximum(np.abs(us[left]), SMALLEST_UNIT)).max(1)
        ended = settles(sizes, last[left], evaluation.amplification) > 0
        us[left] += steps
        done[left[ended]], last[left] = True, sizes
        left = left[~ended & np.isfinite(sizes)]
    sizes = _sizes_of_unknowns(us, 0.1 * np.abs(guesses[:, equations.own : us.shape[1]]) + TINY)
    which = np.flatnonzero(done & ((np.abs(us - guesses) / sizes).max(1) < WORST_PREDICTION))
    able, evaluation = equations.evaluate_lanes(us[which], ps[which])
    return which[able], us[which[able]], evaluation


def _why_stopped(
    names: Sequence[str], p: Array, end: Array, vary: Sequence[str], share: float, fold: float
) -> tuple[str, str]:
    """The status of a machine whose orbit is not reached, and the reason in words."""
    at = p + min(share if fold == np.inf else fold, 1.0) * (end - p)
    where = ", ".join(f"{name} = {at[names.index(name)]:.6g}" for name in vary)
    if fold < np.inf:
        return AT_FOLD, f"on the way from the start the orbits end at a fold, at {where}"
    return NOT_REACHED, f"the way from the start is lost at {where}: give a start that is nearer"
