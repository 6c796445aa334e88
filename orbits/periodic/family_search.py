"""Where the lossless orbits of a family lie: a search over launch speeds, by one scalar equation.

In a flight of an orbit of family n the extension turns for the n-th time after its first turn where the flight is half
over. How late that turn comes, the lateness, follows from the launch speed alone: under constant gravity it is a time,
since half the flight takes a known one; else it is minus the speed that both masses then share, since in mid-flight it
vanishes. The cells between sampled launch speeds are halved until the lateness cannot vanish in any of them, or changes
its sign once, as far as its second differences tell.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..flow.flow import flow_of
from ..flow.zero_crossing import first_zeros
from ..model.model import Model, Search
from ..model.phase import Affine
from ..numerics.roots import enclosed_sign_changes
from .formulations import columns, equations_of, reduction_of

# The slowest launch that is searched, in multiples of the scale of speed.
SLOWEST_LAUNCH = 1e-3
# The grid is uniform up to so many times the launch speed of a linear spring, with at most so many launches; beyond,
# neighbours have this ratio, since the lateness then goes with the speed. So many launches lead up to its first speed.
UNIFORM_TO, MOST_UNIFORM, SPEED_RATIO, SLOW_LAUNCHES = 2.5, 2000, 1.05, 20
# The lateness may bend this many times as much as the second differences beside a cell say.
BEND_SAFETY = 4.0
# A cell that is narrower than this share of its speed is not halved: there the lateness jumps, or it touches zero, and
# then it is below this share of scale and speed.
NARROWEST_CELL, TOUCHING_ZERO = 1e-6, 1e-9
# After so many launches no cell is halved any more.
MOST_SEARCHED = 20_000
# A turn that does not come within this time, in multiples of the scale and the launch speed together, is that late.
LATEST_TURN = 10.0


class Cells(NamedTuple):
    """Where the orbits of one machine lie: cells (k, 2) of launch speeds that hold one or may touch one, and where (k,)
    in them it is about; the speeds that were searched, the number of launches, and whether the search was stopped with
    cells that may hold a further orbit."""

    cells: np.ndarray
    abouts: np.ndarray
    searched: tuple[float, float]
    launches: int
    stopped: bool


class Lateness:
    """The lateness of one family of machines (m,) of one model as a function of the launch speed.

    ps : parameters (m, np), which `names` names; a piecewise field, and one in closed form, take a single machine
    searches : how each of them is searched
    liftoffs : the extensions (m,) at lift-off, where they are known; without damping they do not depend on the speed
    """

    def __init__(
        self, model: Model, method: str, names: tuple[str, ...], ps: np.ndarray, family: int,
        searches: Sequence[Search], liftoffs: np.ndarray | None = None,
    ):  # fmt: skip
        self.model, self.method, self.family, self.searches = model, method, family, searches
        self.names, self.ps, self.scales = names, ps, np.array([search.scale for search in searches])
        self.reduction = reduction_of(model, method)
        self.statement = equations_of(model, method, names).statement
        self.arc = self.statement.arcs[0]
        self.flow = flow_of(self.arc.phase, names)
        self.liftoffs = self._liftoffs() if liftoffs is None else liftoffs

    def __call__(self, alphas: np.ndarray, which: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The lateness (k,) at launch speeds (k,) of the machines `which` (k,), the first one for None, and the times
        (k,) of the family's turn, NaN where none comes."""
        return self._followed(alphas, np.zeros(len(alphas), int) if which is None else which)[:2]

    def _followed(self, alphas: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lateness and times (k,), and which motions (k,) break off, as they run away or come to a singularity."""
        u, p = self._unknowns(alphas, which), self._parameters(which)
        limit = LATEST_TURN * (self.scales[which] + alphas)
        states = columns(self.arc.start(u, np.zeros(0), p))
        times, going, broken = np.zeros(len(alphas)), np.arange(len(alphas)), np.zeros(len(alphas), bool)
        for turn in range(2 if self.reduction else self.family + 1):
            if not len(going):
                break
            last, ps = np.full(len(alphas), np.nan), self.ps[which[going]] if len(self.ps) > 1 else self.ps[0]
            last[going], rows, failed = first_zeros(
                self.flow, states[going], ps, self._rate, limit[going], int(turn > 0), told=False
            )
            broken[going[[*failed]]] = True
            # In reduced coordinates the extension oscillates: all half periods after the first turn are equal.
            times += last * (self.family if self.reduction and turn else 1)
            states[going] = rows[:, : states.shape[1]]
            going = np.flatnonzero(np.isfinite(times))
        if self.reduction:
            late = times - self.arc.duration(u, p)
        else:
            late = -np.sum(self.arc.conditions(u, list(states.T), p), axis=0)
        return np.where(np.isfinite(times), late, limit), times, broken

    def start(self, alphas: np.ndarray, which: np.ndarray | None = None) -> np.ndarray:
        """The unknowns (k, n) of the statement near orbits with launch speeds (k,) of the machines `which` (k,)."""
        which = np.zeros(len(alphas), int) if which is None else which
        u = {**self._unknowns(alphas, which), "duration": self(alphas, which)[1]}
        return np.column_stack([u[name] for name in self.statement.unknowns])

    def speeds(self, search: Search, fastest: float | None = None) -> np.ndarray:
        """The launch speeds at which a search begins; `fastest` is the last where that is not to be the usual one."""
        scale, family = search.scale, self.family
        top = UNIFORM_TO * (family + 0.5) * np.pi * scale
        step = max(search.spacing * scale, top / MOST_UNIFORM)
        last = fastest or scale * family * search.fastest
        far = np.zeros(0) if last <= top else np.geomspace(top, last, 2 + int(np.log(last / top) / np.log(SPEED_RATIO)))
        slow = np.geomspace(SLOWEST_LAUNCH * scale, step, SLOW_LAUNCHES)
        speeds = np.concatenate([slow[:-1], np.arange(step, min(top, last), step), far])
        return np.append(speeds[speeds < last * (1 - NARROWEST_CELL)], last)

    def enclosed(self, cell: np.ndarray) -> float:
        """The launch speed in a cell (2,) of the first machine at which the lateness changes its sign."""
        late = self(cell)[0]
        return float(enclosed_sign_changes(lambda alphas, _: self(alphas)[0], *cell[:, None], *late[:, None])[0][0])

    def cells(self, fastest: float | None = None) -> list[Cells]:
        """Where the orbits of each machine lie."""
        speeds = [self.speeds(search, fastest) for search in self.searches]
        late, launches, stopped = self._first_values(speeds), list(map(len, speeds)), [False] * len(speeds)
        active = list(range(len(speeds)))
        while active:
            halved = {i: each for i in active if len(each := _to_halve(speeds[i], late[i]))}
            for i in halved:
                stopped[i] = launches[i] > MOST_SEARCHED
            active = [i for i in halved if not stopped[i]]
            middles = [0.5 * (speeds[i][halved[i]] + speeds[i][halved[i] + 1]) for i in active]
            for i, middle, value in zip(active, middles, self._each(middles, np.array(active)), strict=True):
                place = halved[i] + 1
                speeds[i], late[i] = np.insert(speeds[i], place, middle), np.insert(late[i], place, value)
                launches[i] += len(middle)
        rows = zip(speeds, late, self.scales.tolist(), launches, stopped, strict=True)
        return [_cells_of(*row) for row in rows]

    def _first_values(self, speeds: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The lateness at the first launch speeds of each machine.

        In reduced coordinates the energy grows with the speed, so that an extension which escapes at one speed does so
        at every faster one: where that begins is found by halving.
        """
        if not self.reduction or len(speeds) == 1:
            return self._each(speeds)
        low, high = np.full(len(speeds), -1), np.array(list(map(len, speeds)))  # it does not escape, and it does
        while len(open_ones := np.flatnonzero(high - low > 1)):
            middle = (low + high) // 2
            alphas = np.array([speeds[i][middle[i]] for i in open_ones.tolist()])
            escapes = self._followed(alphas, open_ones)[2]
            low[open_ones[~escapes]], high[open_ones[escapes]] = middle[open_ones[~escapes]], middle[open_ones[escapes]]
        late = self._each([each[:count] for each, count in zip(speeds, high.tolist(), strict=True)])
        limits = [LATEST_TURN * (scale + each) for scale, each in zip(self.scales.tolist(), speeds, strict=True)]
        return [np.append(known, limit[len(known) :]) for known, limit in zip(late, limits, strict=True)]

    def _each(self, speeds: Sequence[np.ndarray], which: np.ndarray | None = None) -> list[np.ndarray]:
        """The lateness at launch speeds of each machine, or of those `which`."""
        if not len(speeds):
            return []
        which = np.arange(len(speeds)) if which is None else which
        counts = list(map(len, speeds))
        late = self(np.concatenate(speeds), np.repeat(which, counts))[0]
        return np.split(late, np.cumsum(counts)[:-1])

    def _parameters(self, which: np.ndarray) -> dict[str, Any]:
        """The parameters (k,) of some machines by name; numbers where there is but one machine."""
        if len(self.ps) == 1:
            return dict(zip(self.names, self.ps[0].tolist(), strict=True))
        return dict(zip(self.names, self.ps[which].T, strict=True))

    def _unknowns(self, alphas: np.ndarray, which: np.ndarray) -> dict[str, np.ndarray]:
        return {"alpha": alphas, "liftoff": self.liftoffs[which]}

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


def _to_halve(speeds: np.ndarray, late: np.ndarray) -> np.ndarray:
    """The cells between launch speeds (k,) in which the lateness (k,) may still do anything."""
    _, settled = _judged(speeds, late)
    return np.flatnonzero(~settled & (np.diff(speeds) > NARROWEST_CELL * speeds[1:]))


def _cells_of(speeds: np.ndarray, late: np.ndarray, scale: float, launches: int, stopped: bool) -> Cells:
    """The cells of one machine whose search has ended."""
    changes, _ = _judged(speeds, late)
    least = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
    i = np.flatnonzero(changes | (least < TOUCHING_ZERO * (scale + speeds[1:])))
    a, b, fa, fb = speeds[i], speeds[i + 1], late[i], late[i + 1]
    about = np.where(changes[i], a - fa * np.divide(b - a, fb - fa, where=fb != fa, out=0 * fa), 0.5 * (a + b))
    return Cells(np.column_stack([a, b]), about, (float(speeds[0]), float(speeds[-1])), launches, stopped)


def _judged(speeds: np.ndarray, late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether the lateness changes its sign in each cell (k,), and whether it then does so once, else not at all."""
    widths, changes = np.diff(speeds), (late[1:] >= 0) != (late[:-1] >= 0)
    bends = np.abs(np.diff(np.diff(late) / widths)) / (0.5 * (widths[1:] + widths[:-1]))
    bends = np.concatenate([bends[:1], bends, bends[-1:]])
    bulge = BEND_SAFETY * np.maximum(bends[1:], bends[:-1]) * widths**2 / 8
    nearest = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
    return changes, np.where(changes, np.abs(np.diff(late)) > 4 * bulge, nearest > bulge)
