"""The launch speeds of a family's lossless orbits: a search by one scalar equation.

In a flight of an orbit of family n the extension turns for the n-th time after its first turn where the flight is half
over. The delay of that turn, the lateness, follows from the launch speed alone: under constant gravity it is a time,
since half the flight takes a known time; else it is minus the speed that both masses then share, since in mid-flight it
vanishes. Where the reversor turns all places over, mid-flight of family n is half way between the n-th turn and the
next one, which are images of each other, and the lateness how far the mean of their places is beyond the centres. The
cells between sampled launch speeds are halved until, according to its second differences, the lateness cannot vanish in
any of them, or changes its sign once.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..flow import Watch, first_events, flow_of
from ..model import Affine, Model, Search, linear_guess
from ..numerics import enclosed_sign_changes
from ..shooting import columns, equations_of, reduction_of
from .guess import GUESS, times_of_turns


class SearchOptions(NamedTuple):
    """Where a search samples launch speeds, which cells it halves, and when it ends."""

    uniform_to: float = 2.5  # the grid is uniform up to this multiple of the launch speed of a linear spring
    uniform: int = 2000  # launches of that grid at most
    speed_ratio: float = 1.05  # of neighbours beyond, since the lateness then scales with the speed
    slow_launches: int = 20  # below the first of that grid
    # A cell that is narrower than this share of its speed is not halved: there the lateness jumps, or it touches zero,
    # and then it is below `touching_zero` of scale and speed.
    narrowest: float = 1e-6
    touching_zero: float = 1e-9
    # Where falls begin or end the lateness grows without bounds, as a logarithm: a cell there is halved to this share.
    narrowest_at_falls: float = 1e-13
    narrow_escape: float = 1e-3  # share of the speed: wider cells in which escapes begin are halved first
    # Towards launches without a turn the lateness may grow without bounds: as a logarithm by at most 50 times its
    # change in the previous cell, down to neighbouring numbers, and as a fourth root by at most this many times it.
    steepest_end: float = 1e4
    launches: int = 20_000  # then cells are not halved any more
    launches_of_steps: int = 1_000  # of machines that step, which fall over in many ways, each with a bound of its own
    resolving_share: float = 0.25  # of the launches, at most, resolves the turning points on each side
    # Where orbits are sought below a launch speed, cells up to this multiple of it show how the lateness bends.
    beyond_sought: float = 1.2
    latest_turn: float = 10.0  # in multiples of the sum of scale and launch speed: a later turn does not occur
    # Nothing throws up a machine that steps, so that the time from one turn to the next does not grow with the speed.
    # One that takes longer than this, in radians of the spring at rest, does not occur: the machine falls over.
    longest_swing: float = 40.0
    # Orbits of a light one with a heavy inner body lie between falls, in narrow ranges of launch speeds near its guess:
    # launches within this factor of that, and their number.
    near_guess: float = 5.0
    near_launches: int = 120


SEARCH = SearchOptions()


class Cells(NamedTuple):
    """The locations of one machine's orbits: cells (k, 2) of launch speeds that contain one or may touch one, and its
    approximate speed (k,) in each; the range of speeds that was searched, the number of launches, and whether the
    search was stopped with cells that may contain a further orbit."""

    cells: np.ndarray
    abouts: np.ndarray
    searched: tuple[float, float]
    launches: int
    stopped: bool


class _Launches(NamedTuple):
    """Launches of machines, one machine after the other and ascending: the machine (N,), speed, lateness and number of
    turns of each."""

    owners: np.ndarray
    speeds: np.ndarray
    late: np.ndarray
    turns: np.ndarray


class Lateness:
    """The lateness of one family of machines (m,) of one model as a function of the launch speed.

    ps : parameters (m, np), which `names` names; a piecewise field, and one in closed form, take a single machine
    paces : the scale of times (m,) over that of launch speeds, the unit of the lateness of times
    searches : the settings of each machine's search
    liftoffs : the extensions (m,) at lift-off, where they are known; without damping they do not depend on the speed
    """

    most, steps = SEARCH.launches, False

    def __init__(
        self, model: Model, method: str, names: tuple[str, ...], ps: np.ndarray, family: int,
        searches: Sequence[Search], liftoffs: np.ndarray | None = None,
    ):  # fmt: skip
        self.model, self.method, self.family, self.searches = model, method, family, searches
        self.names, self.ps = names, ps
        self.scales, self.paces = np.array([[search.scale, search.pace] for search in searches]).T
        self.by_speed = any(search.by_speed for search in searches)
        self.reduction = reduction_of(model, method)
        self.statement = equations_of(model, method, names).statement
        self.arc = self.statement.arcs[0]
        self.flow = flow_of(self.arc.phase, names)
        self.steps = not model.plain
        self.most = SEARCH.launches_of_steps if self.steps else SEARCH.launches
        self.turns_midway = self.reduction is not None or model.turns_midway
        self.liftoffs = self._liftoffs() if liftoffs is None else liftoffs

    def __call__(self, alphas: np.ndarray, which: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The lateness (k,) at launch speeds (k,) of the machines `which` (k,), the first one for None, and the times
        (k,) of the family's turn, NaN where there is none."""
        late, times, *_ = self._followed(alphas, np.zeros(len(alphas), int) if which is None else which)
        return late, times

    def _followed(self, alphas: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, ...]:
        """Lateness and times (k,), whether each motion (k,) breaks off, as it runs away or reaches a singularity, and
        the numbers of turns (k,) that were found, of the needed turns."""
        u, p = self._unknowns(alphas, which), self._parameters(which)
        limit = SEARCH.latest_turn * self.paces[which] * (self.scales[which] + alphas)
        states = columns(self.arc.start(u, np.zeros(0), p))
        ps, count = self.ps[which] if len(self.ps) > 1 else self.ps, 2 if self.reduction else self.family + 1
        count = count if self.turns_midway else self.family
        unit = self.paces[which] * self.scales[which]
        longest = limit if self.model.plain else np.minimum(limit, SEARCH.longest_swing * unit)
        spans, states, broken = times_of_turns(self.flow, ps, states, self._rate, longest, count)
        # In reduced coordinates the extension oscillates: all half periods after the first turn are equal.
        times = spans[0] + self.family * spans[1] if self.reduction else spans.sum(axis=0)
        if not self.turns_midway and np.isfinite(times).any():
            before, going = states, np.flatnonzero(np.isfinite(times))
            some = ps[going] if len(ps) > 1 else ps[0]
            watch = Watch(self.flow, [self._rate])
            found = first_events(self.flow, states[going], some, watch, longest[going], 1, reasons=False)
            more, after = found.times, found.rows
            times[going] += 0.5 * more
            states = np.array(before)
            states[going] += 0.5 * (after[:, : states.shape[1]] - before[going])
        if self.reduction:
            late = (times - self.arc.duration(u, p)) / self.paces[which]
        else:
            late = np.sum(self.arc.conditions(u, list(states.T), p), axis=0)
            late = -late if self.turns_midway else late / self.paces[which]
        turns = np.isfinite(spans).sum(axis=0) + np.isfinite(times)
        return np.where(np.isfinite(times), late, limit / self.paces[which]), times, broken, turns

    def start(self, alphas: np.ndarray, which: np.ndarray | None = None) -> np.ndarray:
        """The unknowns (k, n) of the statement near orbits with launch speeds (k,) of the machines `which` (k,)."""
        which = np.zeros(len(alphas), int) if which is None else which
        u = {**self._unknowns(alphas, which), "duration": self(alphas, which)[1]}
        return np.column_stack([u[name] for name in self.statement.unknowns])

    def last_speed(self, search: Search, fastest: float | None = None) -> float:
        """The fastest launch of a search; `fastest` replaces its default."""
        return fastest or search.scale * self.family * search.fastest

    def speeds(self, search: Search, fastest: float | None = None, below: float = np.inf) -> np.ndarray:
        """The launch speeds at which a search begins, up to the last one, or as far as they resolve the turning points
        of the extension; those are resolved as far as orbits are sought, `below` a speed."""
        scale, family = search.scale, self.family
        top = SEARCH.uniform_to * (family + 0.5) * np.pi * scale
        step = max(search.spacing * scale, top / SEARCH.uniform)
        last, turning = self.last_speed(search, fastest), np.zeros(0)
        if search.turning and not self.steps:
            needed = min(last, SEARCH.beyond_sought * below)
            turning, resolved = search.turning(needed, int(SEARCH.resolving_share * self.most))
            last = last if resolved >= needed else resolved
        count = 2 + int(np.log(max(last / top, 1.0)) / np.log(SEARCH.speed_ratio))
        far = np.geomspace(top, last, count) if last > top else np.zeros(0)
        slow = np.geomspace(GUESS.slowest * scale, step, SEARCH.slow_launches)
        speeds = np.concatenate([slow[:-1], np.arange(step, min(top, last), step), far, [last]])
        # Between two of these, those are added that are closer to each other.
        apart = np.gradient(turning) if len(turning) > 1 else np.zeros(len(turning))
        place = np.searchsorted(speeds, turning)
        inside = (place > 0) & (place < len(speeds))
        wide = np.diff(speeds)[np.clip(place - 1, 0, len(speeds) - 2)] > apart
        return _well_apart(np.sort(np.concatenate([speeds, turning[inside & wide]])))

    def _with_speeds_near_guess(self, speeds: np.ndarray, p: Sequence[float]) -> np.ndarray:
        """The launch speeds at which the search of a machine that steps begins, with parameters (np,)."""
        try:
            alpha = linear_guess(self.model, self.family, dict(zip(self.names, p, strict=True)))["alpha"]
        except NoOrbit:
            return speeds
        near = alpha * np.geomspace(1 / SEARCH.near_guess, SEARCH.near_guess, SEARCH.near_launches)
        return _well_apart(np.sort(np.concatenate([speeds, near[near < speeds[-1]]])))

    def enclosed(self, cell: np.ndarray) -> float:
        """The launch speed in a cell (2,) of the first machine at which the lateness changes its sign."""
        late = self(cell)[0]
        return float(enclosed_sign_changes(lambda alphas, _: self(alphas)[0], *cell[:, None], *late[:, None])[0][0])

    def cells(self, fastest: float | None = None, below: np.ndarray | None = None) -> list[Cells]:
        """The cells of each machine's orbits; only `below` launch speeds (m,) where these are stated, since faster
        orbits are then not requested."""
        count = len(self.searches)
        bounds = [np.inf] * count if below is None else below.tolist()
        every = [self.speeds(search, fastest, end) for search, end in zip(self.searches, bounds, strict=True)]
        first = list(map(self._with_speeds_near_guess, every, self.ps.tolist())) if self.steps else every
        if below is not None:  # the classification of a cell needs its neighbours too
            first = [speeds[: np.searchsorted(speeds, end) + 2] for speeds, end in zip(first, below, strict=True)]
        sampled = self._first_values(first)
        launches = np.bincount(sampled.owners, minlength=count)
        ends = [(end[-1], self.last_speed(search, fastest)) for end, search in zip(every, self.searches, strict=True)]
        stopped = np.array([end < last for end, last in ends])
        while len(cells := _open_cells(sampled)):
            full = launches[sampled.owners[cells]] > self.most
            stopped[sampled.owners[cells[full]]] = True
            cells = cells[~stopped[sampled.owners[cells]]]
            if not len(cells):
                break
            which, middles = sampled.owners[cells], 0.5 * (sampled.speeds[cells] + sampled.speeds[cells + 1])
            new = which, middles, *self._values(middles, which)
            sampled = _Launches(*map(np.insert, sampled, [cells + 1] * len(new), new))
            launches += np.bincount(which, minlength=count)
        return _cells_of(sampled, self.scales, launches, stopped)

    def _first_values(self, each: Sequence[np.ndarray]) -> "_Launches":
        """The first launches, whose speeds are those of `each` machine one after the other.

        In reduced coordinates the energy grows with the speed, so that an extension which escapes at one speed does so
        at every faster one: where that begins is found by halving.
        """
        counts, speeds = np.array(list(map(len, each))), np.concatenate(each)
        owners, first = np.repeat(np.arange(len(each)), counts), np.cumsum(counts) - counts
        late, returns = np.full(len(speeds), np.inf), np.ones(len(speeds), bool)
        if self.reduction and len(each) > 1:
            low, high = first - 1, first + counts  # the extension does not escape at `low`, and escapes at `high`
            while len(i := np.flatnonzero(high - low > 1)):
                middle = (low[i] + high[i]) // 2
                escapes = self._followed(speeds[middle], i)[2]
                low[i[~escapes]], high[i[escapes]] = middle[~escapes], middle[escapes]
            returns = np.arange(len(speeds)) < high[owners]
        turns = np.zeros(len(speeds), int)
        late[returns], turns[returns] = self._values(speeds[returns], owners[returns])
        return _Launches(owners, speeds, late, turns)

    def _values(self, alphas: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The lateness (k,) at launch speeds (k,) of the machines `which` (k,), infinite where the extension escapes in
        reduced coordinates, and NaN where a machine that steps falls over without the family's turn; and the numbers of
        turns (k,)."""
        late, times, escapes, turns = self._followed(alphas, which)
        if self.steps:
            return np.where(np.isfinite(times), late, np.nan), turns
        return (np.where(escapes, np.inf, late) if self.reduction else late), turns

    def _parameters(self, which: np.ndarray) -> dict[str, object]:
        """The parameters (k,) of some machines by name; numbers where there is but one machine."""
        if len(self.ps) == 1:
            return dict(zip(self.names, self.ps[0].tolist(), strict=True))
        return dict(zip(self.names, self.ps[which].T, strict=True))

    def _unknowns(self, alphas: np.ndarray, which: np.ndarray) -> dict[str, np.ndarray]:
        return {"alpha": alphas, "liftoff": self._released(alphas, which) if self.by_speed else self.liftoffs[which]}

    def _released(self, alphas: np.ndarray, which: np.ndarray) -> np.ndarray:
        """The extensions (k,) at lift-off of launches whose speed they depend on."""
        found = np.empty(len(alphas))
        for machine in np.unique(which).tolist():
            mine, p = which == machine, dict(zip(self.names, self.ps[machine].tolist(), strict=True))
            found[mine] = self.model.release(alphas[mine], p)
        return found

    def _liftoffs(self) -> np.ndarray:
        """The extensions (m,) at lift-off."""
        each = zip(self.scales, self.ps.tolist(), strict=True)
        release = self.model.release
        return np.array([float(release(np.array([s]), dict(zip(self.names, p, strict=True)))[0]) for s, p in each])

    @cached_property
    def _rate(self) -> Affine:
        """The rate of the extension, a sum of speeds, as a function of the state."""
        if self.reduction:
            return Affine(tuple(float(sign < 0) for sign in self.reduction.reversor))
        weights, first = np.array(self.model.extension.weights), np.zeros(1, int)
        rows = np.flatnonzero(weights)
        start = columns(self.arc.start(self._unknowns(self.scales[:1], first), np.zeros(0), self._parameters(first)))
        states = np.vstack([start, start + np.eye(start.shape[1])])
        rates = self.flow.field(states, self.ps[0])[0][:, rows] @ weights[rows]
        return Affine(tuple(rates[1:] - rates[0]))


def _well_apart(speeds: np.ndarray) -> np.ndarray:
    """Increasing launch speeds (k,) without those followed by nearly the same one."""
    return speeds[np.append(np.diff(speeds) > SEARCH.narrowest * speeds[1:], True)]


def _open_cells(sampled: _Launches) -> np.ndarray:
    """The cells between launches (N,) in which the number of zeros of the lateness is not settled."""
    _, settled = _judged(sampled)
    narrowest = np.where(_other_falls(sampled), SEARCH.narrowest_at_falls, SEARCH.narrowest)
    return np.flatnonzero(~settled & (np.diff(sampled.speeds) > narrowest * sampled.speeds[1:]))


def _other_falls(sampled: _Launches) -> np.ndarray:
    """Whether one of two neighbouring launches (N,) falls over and the other one does not, or after other turns."""
    falls = np.isnan(sampled.late)
    return (falls[1:] | falls[:-1]) & (sampled.turns[1:] != sampled.turns[:-1])


def _cells_of(sampled: _Launches, scales: np.ndarray, launches: np.ndarray, stopped: np.ndarray) -> list[Cells]:
    """The cells of machines (m,) whose searches have ended, with launches (N,)."""
    owners, speeds, late, _ = sampled
    changes, _ = _judged(sampled)
    least = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
    touches = (least < SEARCH.touching_zero * (scales[owners[1:]] + speeds[1:])) & (owners[1:] == owners[:-1])
    i = np.flatnonzero((changes & ~_breaks_off(owners, speeds, late, scales)) | touches)
    a, b, fa, fb = speeds[i], speeds[i + 1], late[i], late[i + 1]
    secant = changes[i] & np.isfinite(fa) & np.isfinite(fb)
    about = 0.5 * (a + b)
    about[secant] -= ((0.5 * (fa + fb)) * (b - a))[secant] / (fb - fa)[secant]
    cells, found = np.column_stack([a, b]), []
    for machine, (count, stop) in enumerate(zip(launches.tolist(), stopped.tolist(), strict=True)):
        mine = slice(*np.searchsorted(owners[i], [machine, machine + 1]))
        ends = speeds[np.searchsorted(owners, [machine, machine + 1]) - [0, 1]]
        found.append(Cells(cells[mine], about[mine], (float(ends[0]), float(ends[1])), count, stop))
    return found


def _breaks_off(owners: np.ndarray, speeds: np.ndarray, late: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Whether between neighbouring launches (N,), sampled as closely as possible, a turn that is too early disappears
    without having become late, as where a flight ends at a singularity: there the lateness jumps over zero."""
    never = late > 0.99 * SEARCH.latest_turn * (scales[owners] + speeds)
    near = np.diff(speeds) <= SEARCH.narrowest * speeds[1:]
    within = (owners[1:] == owners[:-1]) & np.isfinite(late[1:]) & np.isfinite(late[:-1])
    change = np.append(np.inf, np.abs(np.subtract(late[1:], late[:-1], out=np.full(len(within), np.inf), where=within)))
    return near & within & ~never[:-1] & never[1:] & (late[:-1] < -SEARCH.steepest_end * change[:-1])


def _judged(sampled: _Launches) -> tuple[np.ndarray, np.ndarray]:
    """Whether the lateness changes its sign in each cell between launches (N,), and whether it is settled to do so
    once, else not at all; between launches of two machines there is no cell, and no change.

    Where the extension escapes, and at all faster launches, the lateness is infinite. Towards these it grows without
    bounds as a logarithm: in a narrow cell where the escape begins, it does not vanish if it rises before, and its
    curvature is too small to bring it to zero. Where a machine that steps falls over, the lateness is NaN. Launches at
    which falls begin or end, or the number of turns before them changes, lead to an unstable equilibrium, after which
    more turns may follow: a cell about one has no change once it is narrow.
    """
    owners, speeds, late, _ = sampled
    same, escapes = owners[1:] == owners[:-1], ~np.isfinite(late)
    inside, widths = same & ~escapes[1:] & ~escapes[:-1], np.where(same, np.diff(speeds), 1.0)
    changes, slopes = same & ((late[1:] >= 0) != (late[:-1] >= 0)), np.diff(np.where(escapes, 0.0, late)) / widths
    bends, middle = np.full(len(speeds), np.inf), np.flatnonzero(inside[1:] & inside[:-1]) + 1
    bends[middle] = np.abs(slopes[middle] - slopes[middle - 1]) / (0.5 * (widths[middle] + widths[middle - 1]))
    # The first and last launch of a machine, and the last before the escape, take the curvature of their neighbours.
    first = np.flatnonzero(inside & ~np.append(False, inside[:-1]))
    last = np.flatnonzero(inside & ~np.append(inside[1:], False)) + 1
    bends[first], bends[last] = bends[first + 1], bends[last - 1]
    bulge = GUESS.bend_safety * np.maximum(bends[1:], bends[:-1]) * widths**2 / 8
    nearest = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
    settled = np.where(changes, np.abs(slopes * widths) > 4 * bulge, nearest > bulge)
    begins = np.flatnonzero(inside[:-1] & escapes[2:]) + 1
    narrow = np.diff(speeds) < SEARCH.narrow_escape * speeds[1:]
    fall = GUESS.bend_safety * bends[begins] * widths[begins] ** 2 / 2
    settled[begins] = (slopes[begins - 1] >= 0) & (late[begins] > fall) & narrow[begins]
    if (falls := np.isnan(late)).any():
        falling = falls[1:] | falls[:-1]
        narrowest = np.diff(speeds) < SEARCH.narrowest_at_falls * speeds[1:]
        changes, settled = changes & ~falling, np.where(falling, narrowest | ~_other_falls(sampled), settled)
    return changes, settled | ~same | (np.isinf(late[1:]) & np.isinf(late[:-1]))
