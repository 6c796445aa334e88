"""The curve of a machine's orbits along a parameter: steps on it, what happens on the way, and how it ends.

Pseudo-arclength continuation of F(u, value) = 0, the equations that `find` solves, with their exact derivatives. With
X = (u, value) in units of its own size, a step of length s along the unit tangent t is the solution of F(X) = 0,
t . (X - X0) = s. Its prediction is the Hermite interpolant, in that same s, of the last points and tangents, so good
that the corrector usually needs one evaluation; a corrector that has to go far may have found another curve, and the
step is refused.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .certify import Case, certify, error_bounds
from .errors import NoOrbit, OrbitsError
from .family import End, Event, Point
from .orbit import Certificate, Orbit
from .roots import bracketed_root
from .shooting import Evaluation, solve
from .statements import as_case, as_orbit, equations_of, interpret

# In shares of the curve's own size: the first step, the shortest, and what a corrector may move of a step's length.
FIRST, SHORTEST, FARTHEST = 1e-3, 1e-5, 1e-2
# What the step control aims at for the corrector: then its first step is its last.
AIM = 1e-5
# The largest angle between two tangents, in radians.
LARGEST_TURN = 0.25
# An orbit this many times faster, longer or smaller than the first is on its way to infinity or to nothing.
FAR = 1e2
# ... if the parameter has no further to go than this share of its way so far; else it only scales the orbit.
NEAR = 0.05
# A motion that makes more of a small change, as it hangs at an unstable equilibrium, is beyond shooting in one piece.
LARGEST_GROWTH = 3e7
# A curve that is lost after the launch speed has grown this much was running off.
RUNNING = 2.0
# A tangent with a smaller share along the parameter is that of a fold: errors are measured across the curve there.
AT_A_FOLD = 1e-3
# Points of the curve that a prediction rests on, and points that are certified together.
MEMORY, TOGETHER = 3, 24


@dataclass(frozen=True, eq=False)
class At:
    """A solved point of the curve.

    x : (n + 1,), the unknowns and the parameter's value
    tangent : (n + 1,), of length 1 in units of the curve's size
    turn : determinant of the equations' derivatives and the tangent, which changes sign at a branch point
    here : the equations there
    length : of the step that led there
    point : the certified orbit without its motion, None until it has been checked
    """

    x: np.ndarray
    tangent: np.ndarray
    turn: float
    here: Evaluation
    length: float = 0.0
    point: Point | None = None

    value = property(lambda self: float(self.x[-1]))


# What an orbit has to spare before something happens; the event is where it changes sign. None: it says nothing.
MARGINS: dict[str, Callable[[Point], float | None]] = {
    "grazing": lambda point: 1.0 if point.clearance is None else point.clearance,
    "masses touch": lambda point: point.smallest_separation,
    "contact pulls": lambda point: 1.0 if point.smallest_contact_force is None else point.smallest_contact_force,
    "landing jerk": lambda point: -point.landing_jerk,
    "collapse": lambda point: -1.0 if point.contact_time is None else 1.0,
}


# What else changes sign where something happens.
SIGNS = ("fold", "branch point", "family")


class Curve:
    """The curve F(u, value) = 0 of a machine's orbits along one of its parameters."""

    def __init__(self, machine, along: str, method: str, span: float):
        self.machine, self.along, self.method = machine, along, method
        self.names = tuple(machine.values)
        self.equations = self.orbits = equations_of(machine.model, method, self.names)
        self.place = self.names.index(along)
        self.parameters = np.array(list(machine.values.values()))
        self.span = span
        self.meshes = None

    def size(self, x) -> np.ndarray:
        """What counts as one unit of each component round `x`."""
        return np.append(np.maximum(np.abs(x[:-1]), 0.1 * np.abs(x[:-1]).max()), self.span)

    def p(self, x) -> np.ndarray:
        values = self.parameters.copy()
        values[self.place] = x[-1]
        return values

    def evaluate(self, x) -> Evaluation:
        here = self.equations.evaluate(x[:-1], self.p(x), (self.along,), self.meshes)
        counts = [len(path.steps) for path in here.trajectories]
        if self.meshes is None or counts != [len(mesh) - 1 for mesh in self.meshes]:
            self.meshes = [_finer(path.times) for path in here.trajectories]
        return here

    def correct(self, x, row, level: float, before) -> At:
        """The point of the curve where row . X = level, by Newton's method from `x`; its tangent goes on from `before`.

        Raises `NoOrbit` where that does not converge at once.
        """
        size, last = self.size(x), np.inf
        for _ in range(8):
            here = self.evaluate(x)
            jacobian = np.vstack([here.jacobian, row])
            step = solve(jacobian, np.append(-here.residual, level - row @ x))
            length = np.max(np.abs(step) / size)
            x = x + step
            if here.settles(length, last):
                break
            if not length < 0.5 * last:
                raise NoOrbit("the corrector does not converge")
            last = length
        else:
            raise NoOrbit("the corrector converges too slowly")
        tangent = solve(jacobian, np.eye(len(x))[-1])
        tangent /= np.linalg.norm(tangent / size) * np.sign(tangent / size @ (before / size))
        if not np.isfinite(tangent).all():
            raise NoOrbit("the curve has no direction here")
        turn = np.linalg.det(np.vstack([here.jacobian * size, tangent / size]))
        here = self.equations.moved(here, x[:-1], self.p(x), step)
        return At(x, tangent, float(turn), here)

    def checked(self, ats: Sequence[At]) -> list[At | OrbitsError]:
        """The points certified, all together; in the place of one that cannot be, the error that says why."""
        points = [self.solved(at) for at in ats]
        errors = error_bounds(self.orbits, points)
        answers: list = [self._case(*known, error) for known, error in zip(points, errors, strict=True)]
        good = [i for i, case in enumerate(answers) if isinstance(case, Case)]
        certificates = certify(self.machine.model, [answers[i] for i in good])
        for i, certificate in zip(good, certificates, strict=True):
            if not isinstance(certificate, NoOrbit):
                certificate = self._point(ats[i], answers[i], certificate)
            answers[i] = certificate
        return answers

    def check(self, at: At) -> At:
        """One point certified; raises the error when it cannot be."""
        (answer,) = self.checked([at])
        if isinstance(answer, OrbitsError):
            raise answer
        return answer

    def solved(self, at: At) -> tuple:
        """Unknowns and parameters of the machine's own equations, `orbits`, at a point; the equations there; and the
        tangent as a row where it is that of a fold, since errors are measured across the curve there."""
        across = at.tangent / self.size(at.x) ** 2
        return at.x[:-1], self.p(at.x), at.here, across if abs(across[-1]) * self.span < AT_A_FOLD else None

    def values(self, p) -> dict[str, float]:
        """What a point's parameters are by name, as far as the machine does not state them."""
        return {self.along: float(p[self.place])}

    def _case(self, u, p, here: Evaluation, across, error: float | OrbitsError) -> Case | OrbitsError:
        """What is to be certified of a point."""
        if isinstance(error, OrbitsError):
            return error
        named = dict(zip(self.names, p.tolist(), strict=True))
        try:
            self.machine.with_values(**self.values(p))  # refuses values that cannot be
            solution = interpret(self.machine.model, self.method, self.orbits, u, here, named, error)
        except OrbitsError as refusal:
            return refusal
        return as_case(self.machine.model, solution, named)

    def _point(self, at: At, case: Case, certificate: Certificate) -> At:
        point = Point(
            value=at.value,
            u=tuple(at.x[:-1].tolist()),
            tangent=tuple(at.tangent.tolist()),
            alpha=case.u["alpha"],
            liftoff_extension=case.u["liftoff"],
            flight_time=case.flight_time,
            contact_time=case.contact_time,
            certificate=certificate,
            also={name: case.p[name] for name in self.values(self.p(at.x)) if name != self.along},
        )
        return replace(at, point=point)

    def orbit(self, at: At) -> Orbit:
        """The whole orbit at a point."""
        began = time.perf_counter()
        u, p, here, _ = self.solved(at)
        machine = self.machine.with_values(**self.values(p))
        known = machine.model, self.method, self.orbits, u, here, machine.values
        return as_orbit(machine, self.method, interpret(*known, error=at.point.error if at.point else None), began)


def _finer(times: np.ndarray) -> np.ndarray:
    """A motion's nodes as shares of its duration, a little closer, so that its neighbours can use them too."""
    count = len(times) - 1
    places = np.linspace(0, count, 2 * int(np.ceil((1.1 * count + 1) / 2)) + 1)
    return np.interp(places, np.arange(count + 1), times) / times[-1]


def _hermite(nodes, values, slopes, s: float) -> np.ndarray:
    """The polynomial through values (m, n) with slopes (m, n) at nodes (m,), at `s`: confluent divided differences."""
    z = np.repeat(nodes, 2)
    table = np.repeat(values, 2, axis=0)
    result, product = table[0].copy(), 1.0
    for k in range(1, len(z)):
        gaps = (z[k:] - z[:-k])[:, None]
        differences = np.diff(table, axis=0) / np.where(gaps == 0, 1.0, gaps)
        table = np.where(gaps == 0, np.repeat(slopes, 2, axis=0)[: len(gaps)], differences)
        product *= s - z[k - 1]
        result += table[0] * product
    return result


@dataclass(frozen=True)
class Options:
    """What a walk is to do, as in `follow`."""

    at: tuple[float, ...] = ()
    watch: Mapping[str, Callable[[Orbit], float]] | None = None
    longest: float = 0.02
    most: int = 10_000
    stop_inadmissible: bool = False


class Walk:
    """Steps along a curve from a point of it, with what happens in each.

    Steps are taken several at a time and then certified together; where one cannot be, or is of another family, they
    are taken again from before it, shorter and one by one.
    """

    def __init__(self, curve: Curve, first: At, start: float, stop: float, options: Options, earlier=()):
        self.curve, self.first, self.options = curve, first, options
        self.start, self.stop, self.bounds = start, stop, (min(start, stop), max(start, stop))
        self.recent = [first]
        every = [*earlier, first.point]
        self.origin = every[0]
        self.seen = [(point.alpha, point.value) for point in every]
        self.length = min(FIRST, options.longest)
        self.count = 1  # steps to take at a time

    def __iter__(self) -> Iterator[At | Event | End]:
        """The points of the curve, first to last, each event before the point that follows it, and the end."""
        yield self.first
        index = 0
        while True:
            last = self.recent[-1]
            ahead, failure = self.steps()
            good, refusal = self.certified(last, ahead)
            for there in good:
                try:
                    there, end = self.ended(last, there)
                    happening = self.between(last, there)
                except OrbitsError as error:
                    yield self.lost(f"what happens next cannot be located ({error})")
                    return
                passed = [at for kind, at in happening if kind == "asked"]
                if index + len(passed) + 1 >= self.options.most:
                    yield End("stopped", f"after {index + 1} points: no more than {self.options.most} were asked for")
                    return
                for kind, at in happening:
                    if kind == "asked":
                        index += 1
                        yield at
                    yield Event(kind, index, at.point)
                index += 1
                yield there
                self.seen.append((there.point.alpha, there.value))
                self.recent, last = [*self.recent, there][-MEMORY:], there
                if end := end or self.far(there):
                    yield end
                    return
            if refusal is None and failure is None:
                self.count = min(2 * self.count, TOGETHER)
                continue
            self.count = 1
            if refusal is not None:
                self.length = 0.5 * ahead[len(good)].length
            if failure is not None or self.length <= SHORTEST:
                yield self.lost(str(refusal or failure))
                return

    def steps(self) -> tuple[list[At], OrbitsError | None]:
        """The next few points, not certified yet, and the error that allows no more."""
        ahead: list[At] = []
        while len(ahead) < self.count:
            try:
                ahead.append(self.step([*self.recent, *ahead][-MEMORY:]))
            except OrbitsError as error:
                return ahead, error
            if not self.bounds[0] < ahead[-1].value < self.bounds[1] or ahead[-1].here.growth > LARGEST_GROWTH:
                break
        return ahead, None

    def certified(self, last: At, ahead: list[At]) -> tuple[list[At], OrbitsError | None]:
        """The points that are certified, up to the first that is not, and its error."""
        good: list[At] = []
        for there in self.curve.checked(ahead) if ahead else []:
            if isinstance(there, OrbitsError):
                return good, there
            family = (good[-1] if good else last).point.family
            if there.point.family != family and there.length > FIRST / 10:
                return good, NoOrbit(f"the orbit changes from family {family} to {there.point.family}")
            good.append(there)
        return good, None

    def within(self, at: At) -> bool:
        """Whether a point lies between the bounds."""
        return self.bounds[0] < at.value < self.bounds[1]

    def ended(self, here: At, there: At) -> tuple[At, End | None]:
        """The next point, or where the curve ends before it."""
        if again := self.closed(here, there):
            return again, End("closed", "the curve comes back to its first orbit")
        if here.tangent[-1] * there.tangent[-1] < 0 and self.within(there):  # a fold between may lie beyond a bound
            inside, ends = self.inside(here, there), (float(here.tangent[-1]), float(there.tangent[-1]))
            fold = inside(bracketed_root(lambda share: float(inside(share).tangent[-1]), 0.0, 1.0, *ends))
            there = there if self.within(fold) else fold
        if not self.within(there):
            bound = self.bounds[0] if there.value <= self.bounds[0] else self.bounds[1]
            back = " again, on another sheet" if bound == self.start else ""
            return self.landed(here, there, bound), End("reached", f"{self.curve.along} = {bound:g}{back}")
        if self.options.stop_inadmissible and not there.point.admissible:
            return there, End("stopped", "no motion from here: " + there.point.violations[0])
        return there, None

    def share(self, value: float) -> float:
        """How much of the parameter's way lies behind a value."""
        return (value - self.start) / (self.stop - self.start)

    def predict(self, recent: list[At], s: float):
        """Where the curve is a length `s` on from the last of some points, and the row that measures it."""
        last = recent[-1]
        size = self.curve.size(last.x)
        row = last.tangent / size**2
        used = [last]
        for at in reversed(recent[:-1]):
            if not row @ at.tangent > 0.3 or row @ (at.x - used[0].x) >= 0:
                break
            used.insert(0, at)
        nodes = np.array([row @ (at.x - last.x) for at in used])
        slopes = np.array([at.tangent / (row @ at.tangent) for at in used])
        return _hermite(nodes, np.array([at.x for at in used]), slopes, s), row, 2 * len(used)

    def step(self, recent: list[At]) -> At:
        """The point after some, with control of the step; raises the reason when no step is short enough."""
        last, failure = recent[-1], NoOrbit("no step is short enough")
        while self.length > SHORTEST:
            guess, row, order = self.predict(recent, self.length)
            try:
                there = self.curve.correct(guess, row, row @ last.x + self.length, last.tangent)
                moved = self.trusted(last, there, guess)
            except OrbitsError as error:
                failure, self.length = error, 0.5 * self.length
                continue
            there = replace(there, length=self.length)
            longer = (AIM / max(moved, 1e-300)) ** (1 / order)
            self.length = min(self.length * min(max(0.9 * longer, 0.3), 2.0), self.options.longest)
            return there
        raise failure

    def trusted(self, last: At, there: At, guess) -> float:
        """How far the corrector went; raises `NoOrbit` when the point may lie on another curve."""
        size = self.curve.size(last.x)
        moved = np.linalg.norm((there.x - guess) / size)
        a, b = last.tangent / size, there.tangent / size
        turned = np.arccos(min(max(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1.0), 1.0))
        if moved > FARTHEST * self.length or turned > LARGEST_TURN:
            raise NoOrbit(
                f"the corrector moves {moved:.1e} in a step of {self.length:.1e}, the tangent turns by {turned:.2g}"
            )
        return float(moved)

    def inside(self, a: At, b: At) -> Callable[[float], At]:
        """The curve between two of its neighbouring points, not certified, as a function of the share of the chord."""
        size = self.curve.size(a.x)
        chord = (b.x - a.x) / size
        row = chord / (chord @ chord) / size
        slopes = np.array([at.tangent / (row @ at.tangent) for at in (a, b)])
        ends = np.array([a.x, b.x])

        def at(share: float) -> At:
            if share in (0.0, 1.0):
                return (a, b)[int(share)]
            guess = _hermite(np.array([0.0, 1.0]), ends, slopes, share)
            return self.curve.correct(guess, row, row @ a.x + share, a.tangent)

        return at

    def landed(self, a: At, b: At, value: float) -> At:
        """The point between two where the parameter has exactly a value."""
        if b.value == value:
            return b
        inside = self.inside(a, b)
        share = (value - a.value) / (b.value - a.value)
        try:
            near = inside(float(np.clip(share, 1e-9, 1 - 1e-9)))
            guess = near.x + near.tangent * (value - near.value) / near.tangent[-1]
            near = self.curve.correct(guess, np.eye(len(a.x))[-1], value, a.tangent)
        except NoOrbit:  # beside a fold the value does not fix the orbit, its place on the curve does
            away = (a.value - value, b.value - value)
            near = inside(bracketed_root(lambda share: inside(share).value - value, 0.0, 1.0, *away))
        return self.curve.check(replace(near, x=np.append(near.x[:-1], value), length=b.length))

    def between(self, a: At, b: At) -> list[tuple[str, At]]:
        """What happens between two points, in order along the curve."""
        found = []
        inside = self.inside(a, b)

        def quantity(name: str, at: At) -> float | None:
            if name == "fold":
                return float(at.tangent[-1])
            if name == "branch point":
                return at.turn
            at = at if at.point else self.curve.check(at)
            if name == "family":
                return 1.0 if at.point.family == a.point.family else -1.0
            if name in MARGINS:
                return MARGINS[name](at.point)
            return self.options.watch[name](self.curve.orbit(at))

        for name in (*SIGNS, *MARGINS, *self.options.watch):
            first, last = quantity(name, a), quantity(name, b)
            if first is not None and last is not None and first * last < 0:
                share = bracketed_root(lambda share, name=name: quantity(name, inside(share)) or 0.0, 0, 1, first, last)
                found.append((name, share, self.curve.check(inside(share))))
        folds = [0.0, *sorted(share for name, share, _ in found if name == "fold"), 1.0]
        for low, high in pairwise(folds):
            ends = inside(low), inside(high)
            for value in self.options.at:
                if min(at.value for at in ends) < value < max(at.value for at in ends):
                    at = self.landed(*ends, value)
                    found.append(
                        ("asked", low + (high - low) * (value - ends[0].value) / (ends[1].value - ends[0].value), at)
                    )
        return [(name, at) for name, _, at in sorted(found, key=lambda entry: entry[1])]

    def closed(self, a: At, b: At) -> At | None:
        """The first point, if the curve passes it again between two."""
        size = self.curve.size(a.x)
        chord = (b.x - a.x) / size
        away = (self.first.x - a.x) / size
        share = away @ chord / (chord @ chord)
        if a is self.first or not 0 < share <= 1 or np.linalg.norm(away) > 2 * np.linalg.norm(chord):
            return None
        at = self.inside(a, b)(share)
        return at if np.max(np.abs(at.x - self.first.x) / size) < 1e-9 and at.tangent @ self.first.tangent > 0 else None

    def far(self, there: At) -> End | None:
        """The end of a curve that goes to infinity or to nothing."""
        orbit, first = there.point, self.origin
        name, value = self.curve.along, there.value
        if there.here.growth > LARGEST_GROWTH:
            return self.lost(f"small changes grow {there.here.growth:.0e}-fold over the flight, and rounding decides")
        if orbit.alpha > FAR * first.alpha or orbit.flight_time > FAR * first.flight_time:
            if (limit := self.limit(-1, (0, 2, 3, 4))) is None:
                return None
            if orbit.flight_time / orbit.alpha > FAR * first.flight_time / first.alpha:
                return End("degenerate", f"gravity no longer returns the machine near {name} = {value:.6g}", limit)
            return End("escaped", "the launch speed grows without bound", limit)
        if orbit.alpha < first.alpha / FAR and (limit := self.limit(1, (0, 1, 2, 3))) is not None:
            return End("degenerate", f"the hop shrinks to nothing near {name} = {value:.6g}", limit)
        if abs(orbit.liftoff_extension) > FAR * (1 + abs(first.liftoff_extension)):
            return End("degenerate", f"the spring no longer lifts the foot near {name} = {value:.6g}")
        return None

    def limit(self, power: int, terms: tuple[int, ...], near: float = NEAR) -> float | None:
        """The value that the parameter tends to as alpha grows (power -1) or vanishes (1), extrapolated from four well
        spaced points by some powers; None where it is farther than the share `near` of the values passed.

        With a throw's height go the square of alpha and higher powers, with a small hop's size alpha itself.
        """
        alpha, value = np.array(self.seen).T
        scale = (alpha / alpha[-1]) ** power
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in (1.0, 1.25, 1.6, 2.0)]
        if len(set(chosen)) < 4:
            return None
        limit = float(np.linalg.solve(scale[chosen][:, None] ** np.array(terms), value[chosen])[0])
        return limit if abs(limit - value[-1]) < near * np.ptp(value) else None

    def lost(self, reason: str) -> End:
        """The end of a curve that cannot be followed further."""
        last = self.recent[-1]
        where = f"at {self.curve.along} = {last.value:.10g}, alpha = {last.point.alpha:.10g}: {reason}"
        if last.point.alpha > RUNNING * self.origin.alpha:
            limit = self.limit(-1, (0, 2, 3, 4), near=1.0)
            return End("escaped", f"the launch speed grows, and the curve is lost {where}", limit)
        return End("stuck", where)
