"""The curve of a machine's orbits along a parameter: its points, solved, interpolated and certified.

Pseudo-arclength continuation of F(u, value) = 0, the equations that `find` solves, with their exact derivatives. A
point is X = (u, value), in units of its own size; it is the solution of F(X) = 0, row . X = level for a row that says
how the length along the curve is measured. Several points are solved and certified together, since most of the time
would else go into asking for one after the other.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from ..errors import NoOrbit, OrbitsError
from ..periodic.certificate import certify
from ..periodic.error_bound import error_bounds
from ..periodic.evaluation import Evaluation, joined
from ..periodic.formulations import equations_of
from ..periodic.interpretation import certified_orbit, interpret, with_contacts
from ..periodic.newton import STALLED_RATIO, settles
from ..periodic.orbit import Orbit
from ..periodic.solution import or_none
from ..symbolic.calls import room_for
from .family import Point
from .newton_batch import NewtonBatch, newton_batch
from .predictor import around

# A tangent with a smaller share along the parameter is that of a fold: errors are measured across the curve there.
AT_A_FOLD = 1e-3
# Motions of more steps are not evaluated together: building that would take longer than it saves.
MOST_STEPS = 512
# Neighbours may take this many steps more; where that is not enough, this many times as many are tried before motions
# are followed alone.
SPARE_STEPS, MORE = 1, 1.5
# Points of the curve that the prediction of a step rests on.
MEMORY = 4


@dataclass(eq=False)
class CurvePoint:
    """A solved point of the curve.

    x : (n + 1,), the unknowns and the parameter's value
    tangent : (n + 1,), of length 1 in units of the curve's size
    branch_test : determinant of the equations' derivatives and the tangent, which changes sign at a branch point
    here, place : the equations there, to first order from the corrector's last guess, and its place among several
    counts : of steps that are enough there for each arc, as in `NewtonBatch`, None where motions are not followed so
    length : along the curve from the point before
    parts : of the step that ends here, each a point
    point : the certified orbit without its motion, None until it has been checked
    signs : on which side of every event it is, once it has been asked
    """

    x: np.ndarray
    tangent: np.ndarray
    branch_test: float
    here: Evaluation
    place: int
    counts: tuple[int, ...] | None = None
    length: float = 0.0
    parts: int = 1
    point: Point | None = None
    signs: tuple | None = None

    value = property(lambda self: float(self.x[-1]))
    amplification = property(lambda self: float(self.here.amplification[self.place]))


class Curve:
    """The curve F(u, value) = 0 of a machine's orbits along one of its parameters."""

    def __init__(self, machine, along: str, method: str, span: float):
        self.machine, self.along, self.method = machine, along, method
        self.names = tuple(machine.values)
        self.equations = self.orbits = equations_of(machine.model, method, self.names)
        self.place = self.names.index(along)
        self.parameters = np.array(list(machine.values.values()))
        self.span = span
        self.counts = None  # of steps, to try next

    def size(self, x) -> np.ndarray:
        """What counts as one unit of each component round points (..., n + 1)."""
        size = np.abs(x)
        size[..., :-1] = np.maximum(size[..., :-1], 0.1 * size[..., :-1].max(-1, keepdims=True))
        size[..., -1] = self.span
        return size

    def p(self, xs) -> np.ndarray:
        """The parameters (m, np) at points (m, n + 1)."""
        values = np.tile(self.parameters, (len(xs), 1))
        values[:, self.place] = xs[:, -1]
        return values

    @cached_property
    def batch(self) -> NewtonBatch | None:
        """The equations at many points together, None where motions can only be followed one by one."""
        return newton_batch(self.equations, self.along) if self.equations.smooth else None

    def evaluate(self, xs) -> Evaluation:
        """The equations at points (m, n + 1), stacked, each motion with steps of its own."""
        return self.equations.evaluate_all(xs[:, :-1], self.p(xs), (self.along,))

    def newton_steps(self, xs, rows, targets) -> tuple[np.ndarray, np.ndarray, Evaluation]:
        """As `Shooting.newton_steps`, of all together by as many steps as are to be tried, or else by some more, and of
        what is left one by one."""
        ps, left, found, again = self.p(xs), np.arange(len(xs)), None, True
        while len(left):
            places = xs[left], ps[left], rows[left], targets[left]
            if self.counts:
                *some, enough, _ = self.batch.newton_steps(self.counts, *places)
                if not enough.all():
                    self.counts, again = self._room([MORE * count for count in self.counts]) if again else None, False
            else:
                here, enough = self.evaluate(xs[left]), np.ones(len(left), bool)
                some = self.equations.newton_steps(self.along, here, *places)
                self.counts = self._room([motions.counts.max() + SPARE_STEPS for motions in here.trajectories])
            if found and len(left) < len(xs):
                steps, directions, here = found
                steps[left], directions[left] = some[:2]
                found = steps, directions, here.replaced(left, some[2])
            else:
                found = tuple(some)
            left = left[~enough]
        return found

    def _room(self, counts) -> tuple[int, ...] | None:
        """About so many steps for each arc, of few numbers, since for each something is built; None where none are
        taken together."""
        counts = tuple(room_for(int(count)) for count in counts)
        return counts if self.batch and max(counts) <= MOST_STEPS else None

    def correct(self, guess, row, level: float, before) -> CurvePoint:
        """The point of the curve where row . X = level, by Newton's method from `guess`; its tangent goes on from
        `before`. Raises `NoOrbit` where that does not converge at once."""
        return self.correct_all(guess[None], row[None], np.array([level]), before[None])[0]

    def correct_all(self, guesses, rows, levels, before) -> list[CurvePoint]:
        """`correct` of several guesses (m, n + 1), at levels (m,) of rows (m, n + 1), tangents `before` (m, n + 1)."""
        xs, sizes, every = guesses.copy(), self.size(guesses), None
        left, last, tangents = np.arange(len(xs)), np.full(len(xs), np.inf), np.empty_like(xs)
        for _ in range(8):
            steps, tangents[left], here = self.newton_steps(xs[left], rows[left], levels[left])
            every = every.replaced(left, here) if every else here
            xs[left] += steps
            lengths = np.max(np.abs(steps) / sizes[left], axis=1)
            open_ = ~settles(lengths, last[left], here.amplification)
            if not open_.any():
                break
            if not (lengths < STALLED_RATIO * last[left])[open_].all():
                raise NoOrbit("the corrector does not converge")
            last[left] = lengths
            left = left[open_]
        else:
            raise NoOrbit("the corrector converges too slowly")
        return self._ats(xs, tangents, every, before)

    def _ats(self, xs, tangents, here: Evaluation, before) -> list[CurvePoint]:
        """Solved points (m, n + 1) with the directions of the curve (m, n + 1), which go on from those `before`."""
        sizes = self.size(xs)
        scaled = tangents / sizes
        sides = np.sign(np.einsum("mi,mi->m", scaled / sizes, before))
        tangents = tangents / (sides * np.linalg.norm(scaled, axis=1))[:, None]
        if not np.isfinite(tangents).all():
            raise NoOrbit("the curve has no direction here")
        square = np.concatenate([here.jacobian * sizes[:, None], (tangents / sizes)[:, None]], axis=1)
        turns = np.linalg.det(square).tolist()
        each = enumerate(zip(xs, tangents, turns, strict=True))
        return [CurvePoint(x, tangent, turn, here, place, self.counts) for place, (x, tangent, turn) in each]

    def step(
        self, knots: Sequence[CurvePoint], length: float, value: float | None = None
    ) -> tuple[CurvePoint, np.ndarray, int]:
        """The end of a step of given length from the last of some points, or of about that where the parameter has a
        value; where these said that it would be, (n + 1,); and how many of them that rests on. Raises `NoOrbit` as
        `correct`."""
        last, missing = knots[-1], MEMORY - len(knots)
        size = self.size(last.x)
        row = last.tangent / size**2
        level = np.array([row @ last.x + length])
        closing, target = (row, level[0]) if value is None else (np.eye(len(row))[-1], value)
        padded = [*[knots[0]] * missing, *knots]
        xs, tangents = (np.array(part) for part in ([at.x for at in padded], [at.tangent for at in padded]))
        if counts := last.counts and self._room([count + SPARE_STEPS for count in last.counts]):
            points = xs, tangents, np.arange(MEMORY) >= missing, row, level
            if found := self.batch.step(counts, *points, closing, target, size, self.p(xs[-1:])):
                guess, x, tangent, here, used, (rests, before, moved) = found
                self.counts = self._room([count[0] for count in used])
                if not settles(moved, before, float(here.amplification[0])):
                    return self.correct(x, closing, target, last.tangent), guess, rests
                (end,) = self._ats(x[None], tangent[None], here, last.tangent[None])
                return end, guess, rests
            self.counts = self._room([MORE * count for count in counts])
        places = np.array([MEMORY - missing]), MEMORY, 0, row[None], level
        (guess,), (rests,) = around(xs[missing:], tangents[missing:], *places)
        guess += last.tangent * (target - closing @ guess) / (closing @ last.tangent)
        return self.correct(guess, closing, target, last.tangent), guess, rests

    def check(self, at: CurvePoint) -> CurvePoint:
        """A point, certified; raises the error when it cannot be."""
        _, error = self.checked([at])
        if error:
            raise error
        return at

    def checked(self, ats: Sequence[CurvePoint]) -> tuple[Sequence[CurvePoint], OrbitsError | None]:
        """The points, certified, up to the first that cannot be, and its error."""
        groups = {id(at.here): i for i, at in reversed(list(enumerate(ats)))}  # those solved together are so checked
        order = np.array(sorted(range(len(ats)), key=lambda i: (groups[id(ats[i].here)], ats[i].place)), int)
        if not len(order):
            return ats, None
        us, ps, here, closing = self.solved([ats[i] for i in order])
        errors, refused = error_bounds(self.orbits, us, ps, here, closing, quickly=True)
        refused = {int(order[i]): error for i, error in (refused | self._refused(ps)).items()}
        end = min(refused, default=len(ats))
        if end == 0:
            return ats[:0], refused[0]
        if refused:
            kept = np.flatnonzero(order < end)
            us, ps, here, errors, order = us[kept], ps[kept], here[kept], errors[kept], order[kept]
        try:
            self._certify([ats[i] for i in order], us, ps, here, errors)
        except NoOrbit as error:
            if error.index is None:
                raise
            first, error.index = order[error.index], None
            good, earlier = self.checked(ats[:first])
            return good, earlier or error
        return ats[:end], refused.get(end)

    def solved(self, ats: Sequence[CurvePoint]) -> tuple[np.ndarray, np.ndarray, Evaluation, np.ndarray]:
        """The unknowns (m, n) and parameters (m, np) of the machine's own equations, `orbits`; the equations there; and
        the rows (m, n + 1) that close them for their errors: where it is a fold, the tangent, across which errors are
        measured there."""
        xs = np.array([at.x for at in ats])
        across, ps = np.array([at.tangent for at in ats]) / self.size(xs) ** 2, self.p(xs)
        folds = np.abs(across[:, -1]) * self.span < AT_A_FOLD
        heres = []
        for _, some in groupby(ats, key=lambda at: id(at.here)):
            some = list(some)
            places, here = np.array([at.place for at in some]), some[0].here
            heres.append(here if np.array_equal(places, np.arange(len(here.jacobian))) else here[places])
        return xs[:, :-1], ps, joined(heres), np.where(folds[:, None], across, np.eye(xs.shape[1])[-1])

    def _certify(self, ats: Sequence[CurvePoint], us, ps, here: Evaluation, errors):
        """Give points their certificates, as they have been `solved`; raises `NoOrbit` about the first that can have
        none."""
        model = self.machine.model
        cases = with_contacts(model, interpret(model, self.method, self.orbits, us, ps, here, errors))
        certificates = certify(model, cases)
        also = {name: cases.p[name].tolist() for name in self.values(self.parameters) if name != self.along}
        others = [dict(zip(also, row, strict=True)) for row in zip(*also.values(), strict=True)] or [{}] * len(ats)
        figures = cases.u["alpha"].tolist(), cases.u["liftoff"].tolist(), cases.flight_times.tolist()
        for at, *row in zip(ats, *figures, or_none(cases.contact_times), certificates, others, strict=True):
            *u, value = at.x.tolist()
            at.point = Point(value, tuple(u), tuple(at.tangent.tolist()), *row)

    def values(self, p) -> dict[str, float]:
        """What a point's parameters are by name, as far as the machine does not state them."""
        return {self.along: float(p[self.place])}

    def _refused(self, ps) -> dict[int, OrbitsError]:
        """By index why the machine cannot have some of parameters (m, np); those between two good ones are good."""
        if len(ps) > 2 and not (self._refused(ps.min(0)[None]) or self._refused(ps.max(0)[None])):
            return {}
        found = {}
        for i, p in enumerate(ps):
            try:
                self.machine.with_values(**self.values(p))
            except OrbitsError as error:
                found[i] = error
        return found

    def orbit(self, at: CurvePoint) -> Orbit:
        """The whole orbit at a certified point."""
        began, (us, ps, here, _) = time.perf_counter(), self.solved([at])
        machine = self.machine.with_values(**self.values(ps[0]))
        return certified_orbit(machine, self.method, us[0], here, at.point.error, began=began)

    def onto(self, at: CurvePoint, value: float) -> CurvePoint:
        """A point where the parameter is `value` but for rounding, with just that; certified."""
        return self.check(placed(at, value))


def placed(at: CurvePoint, value: float) -> CurvePoint:
    """A point where the parameter is `value` but for rounding, with just that; not certified."""
    return replace(at, x=np.append(at.x[:-1], value), point=None)


def interpolated(ats: Sequence[CurvePoint], row, levels) -> np.ndarray:
    """Points (m, n + 1) at levels (m,) of the polynomial through points of a curve with their tangents."""
    xs, tangents = (np.array(part) for part in ([at.x for at in ats], [at.tangent for at in ats]))
    count = np.full(len(levels), len(ats))
    return around(xs, tangents, count, len(ats), 0, np.tile(row, (len(levels), 1)), levels)[0]
