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

from .accuracy import error_bounds
from .calls import room_for
from .certify import certify, known
from .errors import NoOrbit, OrbitsError
from .family import Point
from .hermite import around
from .meshed import Meshed, meshed
from .orbit import Orbit
from .shooting import STALLED, Evaluation, joined, settles
from .statements import as_cases, as_orbit, equations_of, interpret

# A tangent with a smaller share along the parameter is that of a fold: errors are measured across the curve there.
AT_A_FOLD = 1e-3
# Motions of more steps are not evaluated in one call: building that would take longer than it saves.
MOST_STEPS = 300
# Points of the curve that the prediction of a step rests on.
MEMORY = 4
# A mesh has this many times as many steps as the motion that it is made for, and is made anew where one of them is more
# than this share of what it could be.
CLOSER, TIGHT = 1.15, 0.95


@dataclass(eq=False)
class At:
    """A solved point of the curve.

    x : (n + 1,), the unknowns and the parameter's value
    tangent : (n + 1,), of length 1 in units of the curve's size
    turn : determinant of the equations' derivatives and the tangent, which changes sign at a branch point
    here, place : the equations there, to first order from the corrector's last guess, and its place among several
    meshes : nodes that serve the motions there and beside, as in `Meshed`, None where there are none
    length : along the curve from the point before
    parts : of the step that ends here, each a point
    point : the certified orbit without its motion, None until it has been checked
    signs : on which side of every event it is, once it has been asked
    """

    x: np.ndarray
    tangent: np.ndarray
    turn: float
    here: Evaluation
    place: int
    meshes: list | None = None
    length: float = 0.0
    parts: int = 1
    point: Point | None = None
    signs: tuple | None = None

    value = property(lambda self: float(self.x[-1]))
    growth = property(lambda self: float(self.here.growth[self.place]))


class Curve:
    """The curve F(u, value) = 0 of a machine's orbits along one of its parameters."""

    def __init__(self, machine, along: str, method: str, span: float):
        self.machine, self.along, self.method = machine, along, method
        self.names = tuple(machine.values)
        self.equations = self.orbits = equations_of(machine.model, method, self.names)
        self.place = self.names.index(along)
        self.parameters = np.array(list(machine.values.values()))
        self.span = span
        self.meshes = None  # those to try next

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
    def meshed(self) -> Meshed | None:
        """The equations on meshes, None where they have none."""
        return meshed(self.equations, self.along) if self.equations.smooth else None

    def evaluate(self, xs) -> Evaluation:
        """The equations at points (m, n + 1), stacked, each motion with steps of its own."""
        return self.equations.evaluate_all(xs[:, :-1], self.p(xs), (self.along,))

    def newton_steps(self, xs, rows, targets) -> tuple[np.ndarray, np.ndarray, Evaluation]:
        """As `Shooting.newton_steps`, on the meshes to be tried as far as they serve, or new ones."""
        ps, slow = self.p(xs), np.ones(len(xs), bool)
        if self.meshes is not None:
            *found, fine = self.meshed.newton_steps(self.meshes, xs, ps, rows, targets)
            if fine.all():
                return tuple(found)
            slow = ~fine
        here = self.evaluate(xs[slow])
        last = [motions[len(motions) - 1] for motions in here.trajectories]
        few = all(len(path.steps) <= MOST_STEPS for path in last)
        self.meshes = [_mesh(path.times, _loads(path.steps)) for path in last] if self.meshed and few else None
        others = self.equations.newton_steps(self.along, here, xs[slow], ps[slow], rows[slow], targets[slow])
        if slow.all():
            return others
        steps, directions, here = found
        steps[slow], directions[slow] = others[:2]
        return steps, directions, here.replaced(np.flatnonzero(slow), others[2])

    def correct(self, guess, row, level: float, before) -> At:
        """The point of the curve where row . X = level, by Newton's method from `guess`; its tangent goes on from
        `before`. Raises `NoOrbit` where that does not converge at once."""
        return self.correct_all(guess[None], row[None], np.array([level]), before[None])[0]

    def correct_all(self, guesses, rows, levels, before) -> list[At]:
        """`correct` of several guesses (m, n + 1), at levels (m,) of rows (m, n + 1), tangents `before` (m, n + 1)."""
        xs, sizes, every = guesses.copy(), self.size(guesses), None
        left, last, tangents = np.arange(len(xs)), np.full(len(xs), np.inf), np.empty_like(xs)
        for _ in range(8):
            steps, tangents[left], here = self.newton_steps(xs[left], rows[left], levels[left])
            every = every.replaced(left, here) if every else here
            xs[left] += steps
            lengths = np.max(np.abs(steps) / sizes[left], axis=1)
            open_ = ~settles(lengths, last[left], here.growth)
            if not open_.any():
                break
            if not (lengths < STALLED * last[left])[open_].all():
                raise NoOrbit("the corrector does not converge")
            last[left] = lengths
            left = left[open_]
        else:
            raise NoOrbit("the corrector converges too slowly")
        return self._ats(xs, tangents, every, before)

    def _ats(self, xs, tangents, here: Evaluation, before) -> list[At]:
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
        return [At(x, tangent, turn, here, place, self.meshes) for place, (x, tangent, turn) in each]

    def step(self, knots: Sequence[At], length: float, value: float | None = None) -> tuple[At, np.ndarray, int]:
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
        if self.meshes is not None:
            points = xs, tangents, np.arange(MEMORY) >= missing, row, level
            if found := self.meshed.step(self.meshes, *points, closing, target, size, self.p(xs[-1:])):
                guess, x, tangent, here, (rests, before, moved), loads = found
                if not settles(moved, before, float(here.growth[0])):
                    return self.correct(x, closing, target, last.tangent), guess, rests
                (end,) = self._ats(x[None], tangent[None], here, last.tangent[None])
                if max(load.max() for load in loads) > TIGHT:
                    self.meshes = [_mesh(*known) for known in zip(self.meshes, loads, strict=True)]
                return end, guess, rests
            self.meshes = None
        places = np.array([MEMORY - missing]), MEMORY, 0, row[None], level
        (guess,), (rests,) = around(xs[missing:], tangents[missing:], *places)
        guess += last.tangent * (target - closing @ guess) / (closing @ last.tangent)
        return self.correct(guess, closing, target, last.tangent), guess, rests

    def check(self, at: At) -> At:
        """A point, certified; raises the error when it cannot be."""
        _, error = self.checked([at])
        if error:
            raise error
        return at

    def checked(self, ats: Sequence[At]) -> tuple[Sequence[At], OrbitsError | None]:
        """The points, certified, up to the first that cannot be, and its error."""
        together = {id(at.here): i for i, at in reversed(list(enumerate(ats)))}  # those solved together are so checked
        order = np.array(sorted(range(len(ats)), key=lambda i: (together[id(ats[i].here)], ats[i].place)), int)
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

    def solved(self, ats: Sequence[At]) -> tuple[np.ndarray, np.ndarray, Evaluation, np.ndarray]:
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

    def _certify(self, ats: Sequence[At], us, ps, here: Evaluation, errors):
        """Give points their certificates, as they have been `solved`; raises `NoOrbit` about the first that can have
        none."""
        model = self.machine.model
        cases = as_cases(model, interpret(model, self.method, self.orbits, us, ps, here, errors))
        certificates = certify(model, cases)
        also = {name: cases.p[name].tolist() for name in self.values(self.parameters) if name != self.along}
        others = [dict(zip(also, row, strict=True)) for row in zip(*also.values(), strict=True)] or [{}] * len(ats)
        figures = cases.u["alpha"].tolist(), cases.u["liftoff"].tolist(), cases.flight_times.tolist()
        for at, *row in zip(ats, *figures, known(cases.contact_times), certificates, others, strict=True):
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

    def orbit(self, at: At) -> Orbit:
        """The whole orbit at a certified point."""
        began, (us, ps, here, _) = time.perf_counter(), self.solved([at])
        machine = self.machine.with_values(**self.values(ps[0]))
        return as_orbit(machine, self.method, us[0], here, at.point.error, began=began)

    def onto(self, at: At, value: float) -> At:
        """A point where the parameter is `value` but for rounding, with just that; certified."""
        return self.check(placed(at, value))


def placed(at: At, value: float) -> At:
    """A point where the parameter is `value` but for rounding, with just that; not certified."""
    return replace(at, x=np.append(at.x[:-1], value), point=None)


def _loads(steps: np.ndarray) -> np.ndarray:
    """Which shares (N,) steps are of what they could be: all are as long as can be, but the last is cut off."""
    loads = np.ones_like(steps)
    loads[-1] = min(1.0, steps[-1] / steps[-2]) if len(steps) > 1 else 1.0
    return loads


def _mesh(times: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Nodes for the neighbours of a motion, as shares of its duration, a little closer than its own at `times` (N + 1,)
    where the steps are shares `loads` (N,) of what they could be; of few numbers, since for each something is built."""
    places = np.append(0.0, np.cumsum(loads))
    count = room_for(int(np.ceil(CLOSER * places[-1])), digits=4)
    mesh = np.interp(np.linspace(0, places[-1], count + 1), places, times) / times[-1]
    mesh[-1] = 1.0
    return mesh


def interpolated(ats: Sequence[At], row, levels) -> np.ndarray:
    """Points (m, n + 1) at levels (m,) of the polynomial through points of a curve with their tangents."""
    xs, tangents = (np.array(part) for part in ([at.x for at in ats], [at.tangent for at in ats]))
    count = np.full(len(levels), len(ats))
    return around(xs, tangents, count, len(ats), 0, np.tile(row, (len(levels), 1)), levels)[0]
