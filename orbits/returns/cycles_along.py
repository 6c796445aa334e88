"""Hops along a parameter of the machine: their launches with exact derivatives by the first launch and the parameter.

All hops from one launch are solved together by Newton's method on the equations of `cycle_statement`, each hop an
equation of its own with a guess of its launch speed, from the nearest hops that were solved before.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from ..errors import OrbitsError
from ..flow.trajectory import Trajectories
from ..hops.impacts import Impacts
from ..model.machine import Machine
from ..numerics.polynomial_roots import evaluate
from ..numerics.roots import solve
from ..shooting.single_shooting import SMALLEST_UNIT, STALLED_RATIO, Evaluation, shooting_equations
from ..units import LIFTOFF_SPEED
from .cycle_statement import INJECT, cycle_statement, force_in_contact, gap_speed, pressing
from .flown_hops import flown_hops

SAMPLES_OF_ARC = np.linspace(0.03, 0.97, 32)  # the shares of the time of an arc at which gap and force are tested


@dataclass(frozen=True, kw_only=True)
class HopSteps:
    """Newton's method for hops along a parameter, from guesses by known hops.

    last : step, relative to the unknowns, that is the last one: it leaves its square of these, but the derivatives are
        those before it
    rounding : a step below this that no longer shrinks is rounding
    most : steps from a guess that is near enough
    rough : step after which another Newton's method goes on
    known : hops whose last step was smaller are known well enough to guess others from them
    same : launches nearer than this share of the speed and of the range have the same impacts, hops whose last launch
        is that near to the first repeat themselves, and the end of a contact that near to a launch is it
    memory : number of the latest hops from which others are guessed
    farthest : second derivatives from two hops serve up to this many times the distance of these
    steepest : a direction whose cosine with the chord between two hops is smaller does not lead from one to the other
    apart : speeds of landings, and forces after them, are not 0 above this share of the launch speed and the weight
    clear : the least gap and force between are above this share of the greatest: so far from touching, samples decide
    difference : of a parameter, relative, for the derivative of the unit of speed
    """

    last: float = 1e-10
    rounding: float = 1e-9
    most: int = 8
    rough: float = 1e-4
    known: float = 1e-6
    same: float = 1e-6
    memory: int = 24
    farthest: float = 4.0
    steepest: float = 0.1
    apart: float = 1e-9
    clear: float = 1e-3
    difference: float = 1e-5


STEPS_OF_HOPS = HopSteps()


class SolvedHops(NamedTuple):
    """Hops from one launch at a value of the parameter: their numbers of impacts, the unknowns of each, and the
    derivatives (n, 2) of these by the first launch and the parameter; where they repeat themselves, the direction (2,)
    in both in which they still do; and whether they are known well and `tested` to be smooth."""

    alpha: float
    value: float
    impacts: tuple[int, ...]
    unknowns: tuple[np.ndarray, ...]
    changes: tuple[np.ndarray, ...]
    direction: np.ndarray | None = None
    tested: bool = True


class StepsOfHops(NamedTuple):
    """One step of Newton's method for k hops: the change of their unknowns (k, n), the derivatives of these by the
    launch speed and the parameter, the next speeds (k,) with their slopes and rates, and the motions."""

    changes: np.ndarray
    by_speed: np.ndarray
    by_value: np.ndarray
    next: np.ndarray
    slopes: np.ndarray
    rates: np.ndarray
    evaluation: Evaluation


class CyclesAlong:
    """The hops of a machine at values of one of its parameters.

    machine : at some value of the parameter
    impacts_at : the impacts of the machine at a value
    """

    def __init__(
        self, machine: Machine, name: str, inject: float, span: float, impacts_at: Callable[[float], Impacts],
        options: HopSteps = STEPS_OF_HOPS,
    ):  # fmt: skip
        self.options = options
        self.machine, self.model, self.name, self.inject, self.span = machine, machine.model, name, inject, span
        self.names, self.impacts_at = (*machine.values, INJECT), impacts_at
        self._solved = dict[int, deque[SolvedHops]]()
        self._rough = dict[int, list[SolvedHops]]()  # the latest ones that are not exact

    def __call__(
        self, alphas: np.ndarray, values: np.ndarray, period: int, exact: bool = True
    ) -> tuple[np.ndarray, ...] | None:
        """The launches (m, period + 1), impacts (m, period), slopes (m, period), changes (m, period + 1, 2) and errors
        (m,) of hops from launch speeds (m,) at values (m,), as of `SmoothCycles`; None where they are near a border of
        the map. Unless they are to be `exact`, few steps of Newton's method are taken, which those of the next call
        near them continue."""
        known = [*self._solved.setdefault(period, deque(maxlen=self.options.memory)), *self._rough.pop(period, ())]
        others = [
            self._guesses(order, alpha, value, period)
            for order, alpha, value in zip(
                self._nearest_first(known, alphas, values), alphas.tolist(), values.tolist(), strict=True
            )
        ]
        guesses = [next(each) for each in others]
        try:
            while None not in guesses:
                found, failed = self._solve(alphas, values, cast(list[SolvedHops], guesses), known, exact)
                if found or not failed.any():
                    return found
                for i in np.flatnonzero(failed):
                    guesses[i] = next(others[i])
        except (OrbitsError, np.linalg.LinAlgError):
            pass
        return None

    def _nearest_first(
        self, known: Sequence[SolvedHops], alphas: np.ndarray, values: np.ndarray
    ) -> list[list[SolvedHops]]:
        """For each of some launches (m,) the known hops, those from the nearest launch first."""
        places = np.array([(k.alpha, k.value) for k in known]).reshape(-1, 2)
        apart = np.abs(places[:, 0] / alphas[:, None] - 1) + np.abs(places[:, 1] - values[:, None]) / self.span
        return [[known[i] for i in row] for row in np.argsort(apart, axis=1, kind="stable").tolist()]

    def _guesses(
        self, known: Sequence[SolvedHops], alpha: float, value: float, period: int
    ) -> Iterator[SolvedHops | None]:
        """Hops near those from a launch: of each sequence of impacts the first known ones, then those of a simulation,
        and None."""
        first = dict[tuple[int, ...], SolvedHops]()
        for each in known:
            first.setdefault(each.impacts, each)
        yield from first.values()
        yield self._flown(alpha, value, period)
        yield None

    def nearest(self, point: Any) -> SolvedHops | None:
        """The solved hops that are nearest to those of a `PeriodicLaunch`, with the same impacts; None without any."""
        same = [k for k in self._solved.get(len(point.impacts), ()) if k.impacts == point.impacts]
        (nearest,) = self._nearest_first(same, np.array([point.alpha]), np.array([point.value]))
        return nearest[0] if nearest else None

    def store(self, solved: SolvedHops) -> None:
        """Store hops, from which others are guessed."""
        self._solved.setdefault(len(solved.impacts), deque(maxlen=self.options.memory)).append(solved)

    def _flown(self, alpha: float, value: float, period: int) -> SolvedHops | None:
        """The hops as a simulation has them, None where one has no next launch."""
        impacts, unknowns, (unit, _) = self.impacts_at(value), list[np.ndarray](), self.units(np.array([value]))
        speed, counts = alpha / float(unit[0]), list[int]()
        for _ in range(period):
            hops = flown_hops(impacts, np.array([speed]))
            if not hops.counts[0]:
                return None
            counts.append(int(hops.counts[0]))
            unknowns.append(hops.unknowns(impacts, np.zeros(1, int))[0])
            landing = impacts.model.landed(hops.landings[0, counts[-1] - 1].tolist(), impacts.values)
            path, _ = impacts.contact.run(impacts.onto_contact @ landing, impacts.p, float(hops.contacts[0]))
            end = path.end[: impacts.contact.size]
            speed = float(impacts.model.contact_speed.at(end.tolist()))
            if not (
                speed > 0
                and np.abs(impacts.launch(np.array([speed]))[0] @ impacts.onto_contact.T - end).max()
                <= self.options.same
            ):
                return None  # the contact ends where no launch begins
            speed += (value if self.name == INJECT else self.inject) / float(unit[0])
        return SolvedHops(
            alpha, value, tuple(counts), tuple(unknowns), tuple(np.zeros((len(u), 2)) for u in unknowns), tested=False
        )

    def units(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The units (m,) of speed at values (m,) of the parameter and their derivatives."""
        if self.model.units is None:
            return np.ones(len(values)), np.zeros(len(values))
        step = self.options.difference * np.maximum(np.abs(values), self.options.difference * self.span)
        units = self.model.units
        low, here, high = (
            np.broadcast_to(units({**self.machine.values, self.name: v}).of(LIFTOFF_SPEED), len(values))
            for v in (values - step, values, values + step)
        )
        return here, (high - low) / (2 * step)

    def parameters_at(self, values: np.ndarray) -> np.ndarray:
        """The parameters (m, np) of the machine without an injection at values (m,)."""
        ps = np.tile([*self.machine.values.values(), 0.0], (len(values), 1))
        if self.name != INJECT:
            ps[:, self.names.index(self.name)] = values
        return ps

    def _solve(
        self, alphas: np.ndarray, values: np.ndarray, begun: Sequence[SolvedHops], known: Sequence[SolvedHops],
        exact: bool,
    ) -> tuple[tuple[np.ndarray, ...] | None, np.ndarray]:  # fmt: skip
        """The hops from guesses (m,), or None, and then those (m,) that are not found from their guess."""
        m, period = len(alphas), len(begun[0].impacts)
        impacts = np.array([each.impacts for each in begun])
        units, growing = self.units(values)
        ps, added = self.parameters_at(values), (values if self.name == INJECT else self.inject) / units
        away = np.column_stack([alphas - [k.alpha for k in begun], values - [k.value for k in begun]])
        groups = self._groups(impacts, begun, away, known, alphas / units)
        last, failed = np.full(m, np.inf), np.zeros(m, bool)
        for _ in range(self.options.most):
            speeds, following, slopes, rates = (np.empty((m, period)) for _ in range(4))
            steps = list[StepsOfHops]()
            for count, which, hops, us in groups:
                done, step = self._step(count, us, ps[which])
                if step is None or len(done) < len(us):
                    failed[np.delete(which, done)] = True
                    return None, failed
                steps.append(step)
                speeds[which, hops], following[which, hops] = us[:, 1], step.next
                slopes[which, hops], rates[which, hops] = step.slopes, step.rates
            launches, moved = np.empty((m, period + 1)), np.zeros((m, period + 1))
            launches[:, 0] = alphas / units
            for hop in range(period):
                launches[:, hop + 1] = following[:, hop] + slopes[:, hop] * moved[:, hop] + added
                if hop + 1 < period:
                    moved[:, hop + 1] = launches[:, hop + 1] - speeds[:, hop + 1]
            size = np.zeros(m)
            for (_, which, hops, us), step in zip(groups, steps, strict=True):
                change = step.changes + step.by_speed * moved[which, hops, None]
                np.maximum.at(size, which, (np.abs(change) / np.maximum(np.abs(us), SMALLEST_UNIT)).max(1))
                us += change
            failed = ~np.isfinite(size) | ((last < size) & (size > self.options.rounding))
            if failed.any():
                return None, failed
            settled = (size <= self.options.last) | ((size <= self.options.rounding) & (size > STALLED_RATIO * last))
            if (settled if exact else size <= self.options.rough).all():
                break
            last = size
        else:
            return None, ~settled
        tested = np.abs(away / np.column_stack([alphas, np.full(m, self.span)])).max(1) > self.options.same
        tested |= [not guess.tested for guess in begun]
        known_well = bool((size <= self.options.known).all())
        between = bool(tested.any()) and known_well
        for (count, which, _, us), step in zip(groups, steps, strict=True):
            failed[which[~self.are_smooth(count, us, ps[which], step.evaluation, between)]] = True
        failed |= ~(launches > 0).all(1)
        if failed.any():
            return None, failed
        changes = np.zeros((m, period + 1, 2))
        changes[:, 0, 0] = 1.0
        rates = units[:, None] * rates + growing[:, None] * (launches[:, 1:] - added[:, None]
                                                             - slopes * launches[:, :-1])  # fmt: skip
        for hop in range(period):
            changes[:, hop + 1] = slopes[:, hop, None] * changes[:, hop]
            changes[:, hop + 1, 1] += rates[:, hop]
        own = self._by_first(m, period, groups, steps, launches, changes, units, growing)
        launches *= units[:, None]
        launches[:, 0] = alphas
        self._store(alphas, values, impacts, own, launches, changes, tested, known_well)
        errors = np.zeros(m) if settled.all() else np.maximum(size, self.options.last)
        return (launches, impacts, slopes, changes, errors), failed

    def _store(
        self, alphas: np.ndarray, values: np.ndarray, impacts: np.ndarray, own: list[list[Any]], launches: np.ndarray,
        changes: np.ndarray, tested: np.ndarray, known_well: bool,
    ) -> None:  # fmt: skip
        """Store hops, from which others are guessed: for long those that repeat themselves, are known well and are
        newly `tested`, and the others for the next call."""
        onward = (changes[:, -1] - changes[:, 0])[:, ::-1] * [-1.0, 1.0]
        repeat, period = np.abs(launches[:, -1] - alphas) <= self.options.same * alphas, impacts.shape[1]
        solved = list[SolvedHops]()
        columns = alphas.tolist(), values.tolist(), impacts.tolist(), own, onward, repeat
        for alpha, value, counts, each, way, again in zip(*columns, strict=True):
            unknowns, slopes = zip(*each, strict=True)
            solved.append(SolvedHops(alpha, value, tuple(counts), unknowns, slopes, way if again else None, known_well))
        if known_well:
            self._solved[period].extend(each for each, new in zip(solved, tested & repeat, strict=True) if new)
        if not (known_well and repeat.all()):
            self._rough[period] = solved

    def _groups(
        self, impacts: np.ndarray, begun: Sequence[SolvedHops], away: np.ndarray, known: Sequence[SolvedHops],
        speeds: np.ndarray,
    ) -> list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:  # fmt: skip
        """For each number among the impacts (m, period) the points and hops with it, and guesses of their unknowns from
        hops this far `away` (m, 2), with first launches (m,) without units."""
        bends = self._bends(known, begun, away)
        groups = []
        for count in np.unique(impacts).tolist():
            which, hops = np.nonzero(impacts == count)
            pairs = zip(which.tolist(), hops.tolist(), strict=True)
            us = np.array([begun[i].unknowns[h] + begun[i].changes[h] @ away[i] + bends[i][h] for i, h in pairs])
            us[hops == 0, 1] = speeds[which[hops == 0]]
            groups.append((count, which, hops, us))
        return groups

    def _bends(self, known: Sequence[SolvedHops], begun: Sequence[SolvedHops], away: np.ndarray) -> list[list[Any]]:
        """What is added to the first-order change in the unknowns of hops this far away (m, 2) from guesses, by cubics
        through these and other known hops along the curve of hops that repeat themselves; of those that are not much
        nearer to the guesses, the ones nearest to the hops."""
        scales = np.array([[guess.alpha, self.span] for guess in begun])
        at = np.array([[guess.alpha, guess.value] for guess in begun])
        apart = (np.array([[k.alpha, k.value] for k in known]).reshape(-1, 2) - at[:, None]) / scales[:, None]
        target, squares = away / scales, (apart**2).sum(2)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = (apart * target[:, None]).sum(2) / squares
        left = ((target[:, None] - apart) ** 2).sum(2)
        left[~(np.abs(shares) <= self.options.farthest)] = np.inf
        bends = list[list[Any]]()
        for i, guess in enumerate(begun):
            able = (k for k in np.argsort(left[i]).tolist() if np.isfinite(left[i, k]))
            same = (k for k in able if known[k].impacts == guess.impacts and known[k].tested)
            others = (k for k in same if known[k].direction is not None)
            if not guess.tested or guess.direction is None or (best := next(others, None)) is None:
                bends.append([0.0] * len(guess.impacts))
                continue
            bends.append(
                _bends_on_way(guess, known[best], float(shares[i, best]), away[i], scales[i], self.options.steepest)
            )
        return bends

    @staticmethod
    def _by_first(
        m: int, period: int, groups: list, steps: list[StepsOfHops], launches: np.ndarray, changes: np.ndarray,
        units: np.ndarray, growing: np.ndarray,
    ) -> list[list[Any]]:  # fmt: skip
        """For each point and each hop the unknowns and their derivatives by the first launch and the parameter."""
        own: list[list[Any]] = [[None] * period for _ in range(m)]
        for (_, which, hops, us), step in zip(groups, steps, strict=True):
            by_both = changes[which, hops] / units[which, None]
            by_both[:, 1] -= launches[which, hops] * (growing / units)[which]
            total = step.by_speed[:, :, None] * by_both[:, None]
            total[:, :, 1] += step.by_value
            for i, h, u, change in zip(which.tolist(), hops.tolist(), us, total, strict=True):
                own[i][h] = u, change
        return own

    def _step(self, count: int, us: np.ndarray, ps: np.ndarray) -> tuple[np.ndarray, StepsOfHops | None]:
        """A step of Newton's method for hops with one number of impacts, and the indices of those that can be followed;
        None where they are not all.

        All but the last equation determine the other unknowns from the launch speed, the second one; the last is that
        of the next speed less this one.
        """
        equations = shooting_equations(cycle_statement(self.model, (count,)), self.names)
        done, evaluation = equations.evaluate_lanes(us, ps, (self.name,), fewest=True)
        if evaluation is None or len(done) < len(us):
            return done, None
        n = us.shape[1]
        others = [0, *range(2, n)]
        rows, last = evaluation.jacobian[:, :-1], evaluation.jacobian[:, -1]
        right = np.concatenate([evaluation.residual[:, :-1, None], rows[:, :, [1, n]]], axis=2)
        found = np.zeros((len(us), n, 3))
        found[:, others] = solve(rows[:, :, others], -right)
        found[:, 1, 1] = 1.0
        ends = np.einsum("ki,kij->kj", last[:, :n], found)
        following = evaluation.residual[:, -1] + us[:, 1] + ends[:, 0]
        slopes = ends[:, 1] + 1.0, ends[:, 2] + last[:, n]
        change, by_speed, by_value = found.transpose(2, 0, 1)
        return done, StepsOfHops(change, by_speed, by_value, following, *slopes, evaluation)

    def are_smooth(
        self, count: int, us: np.ndarray, ps: np.ndarray, evaluation: Evaluation, between: bool
    ) -> np.ndarray:
        """Whether hops (k,) have these impacts and no others, and are not too near to others, by their landings and, if
        `between`, by gap and force between these."""
        model, p, m = self.model, dict(zip(self.names, ps.T, strict=True)), len(us)
        many = {name: np.repeat(values, len(SAMPLES_OF_ARC)) for name, values in p.items()}
        sure: np.ndarray = np.asarray((us[:, 2:] > 0).all(1))
        for impact, motions in enumerate(evaluation.trajectories):
            flies = impact < count
            size = len((model.flight if flies else model.contact).states)
            end = [*motions.finals[:, :size].T]
            if between:
                rows = [*rows_within(motions, SAMPLES_OF_ARC, size).T]
                values = model.gap(many).at(rows) if flies else force_in_contact(model, rows, many)
                sure &= _stay_above(np.broadcast_to(values, rows[0].shape).reshape(m, -1), self.options.clear)
            if flies:
                side = 1.0 if impact + 1 == count else -1.0
                sure &= -gap_speed(model, end, p) > self.options.apart * us[:, 1]
                sure &= side * np.broadcast_to(pressing(model, end, p), m) > self.options.apart
            else:
                sure &= model.contact_speed.at(end) > 0
        return sure


def _bends_on_way(
    here: SolvedHops, there: SolvedHops, share: float, away: np.ndarray, scale: np.ndarray, steepest: float
) -> list[Any]:
    """What is added to the first-order change in the unknowns of each hop at a place this far `away` (2,) from solved
    hops, at a share of the chord to others, by the cubic between them along the curve of hops that repeat themselves.

    Beside lossless hops the unknowns bend much across that curve, and little along it."""
    chord = np.array([there.alpha - here.alpha, there.value - here.value])
    square = float(((chord / scale) ** 2).sum())

    def onward(direction: np.ndarray) -> np.ndarray:
        along = float((direction * chord / scale**2).sum())
        steep = along**2 <= steepest**2 * square * float(((direction / scale) ** 2).sum())
        return chord if steep else direction * (square / along)

    assert here.direction is not None
    assert there.direction is not None
    first, last = onward(here.direction), onward(there.direction)
    beside = away - share * first - _bend(share, chord, first, last)
    bends = list[Any]()
    for u, other, by, later in zip(here.unknowns, there.unknowns, here.changes, there.changes, strict=True):
        bend = _bend(share, other - u, by @ first, later @ last)
        bends.append(bend + share * ((later - by) @ beside) + by @ (share * first + beside - away))
    return bends


def _bend(share: float, change: np.ndarray, before: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """The square and cubic terms at a share of the way between two places, of the cubic with this change between them
    and these derivatives at both."""
    return share**2 * (3 * change - 2 * before - behind + share * (before + behind - 2 * change))


def _stay_above(values: np.ndarray, clear: float) -> np.ndarray:
    """Whether values (k, samples) are above 0, and least ones between samples too, beyond doubt: a parabola through
    three samples is lower than the middle one by an eighth of its rises to the others at most."""
    middle, rises = values[:, 1:-1], np.array([values[:, :-2], values[:, 2:]]) - values[:, 1:-1]
    sure = middle > 0.5 * rises.sum(0) + clear * values.max(1, keepdims=True)
    return np.asarray((values > 0).all(1) & (sure | (rises < 0).any(0)).all(1))


def rows_within(motions: Trajectories, shares: np.ndarray, count: int) -> np.ndarray:
    """The first rows (m k, count) of motions (m,) at k shares of the time of each."""
    places, apart = shares * motions.ends[:, None], 2.0 * float(motions.ends.max())
    each = apart * np.arange(len(motions))
    step = np.searchsorted(motions.starts + apart * motions.owner, places + each[:, None], side="right") - 1
    return evaluate(motions.coefficients[step.ravel(), :count], (places - motions.starts[step]).ravel()[:, None])
