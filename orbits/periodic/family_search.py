"""Where the lossless orbits of a family lie: a search over launch speeds, by one scalar equation.

In a flight of an orbit of family n the extension turns for the n-th time after its first turn where the flight is half
over. How late that turn comes, the lateness, follows from the launch speed alone: under constant gravity it is a time,
since half the flight takes a known one; else it is minus the speed that both masses then share, since in mid-flight it
vanishes. The cells between sampled launch speeds are halved until the lateness cannot vanish in any of them, or changes
its sign once, as far as its second differences tell.
"""

from functools import cached_property

import numpy as np

from ..flow.flow import flow_of
from ..flow.zero_crossing import first_zeros
from ..model.machine import Machine
from ..model.model import Search
from ..model.phase import Affine
from ..numerics.roots import enclosed_sign_changes
from .formulations import columns, equations_of, reduction_of, vector

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


class Lateness:
    """The lateness of one family of a machine as a function of the launch speed; `launches` counts its evaluations,
    and `stopped` says whether a search has ended with cells that may hold a further orbit."""

    stopped = False

    def __init__(self, machine: Machine, method: str, family: int, search: Search):
        self.machine, self.method, self.family, self.search, self.launches = machine, method, family, search, 0
        self.p, names = vector(machine.values), tuple(machine.values)
        self.reduction = reduction_of(machine.model, method)
        self.statement = equations_of(machine.model, method, names).statement
        self.arc = self.statement.arcs[0]
        self.flow = flow_of(self.arc.phase, names)

    def __call__(self, alphas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The lateness (m,) at launch speeds (m,), and the times (m,) of the family's turn, NaN where none comes."""
        self.launches += len(alphas)
        u, limit = self._unknowns(alphas), LATEST_TURN * (self.search.scale + alphas)
        states = columns(self.arc.start(u, np.zeros(0), self.machine.values))
        times, going = np.zeros(len(alphas)), np.arange(len(alphas))
        for turn in range(2 if self.reduction else self.family + 1):
            last = np.full(len(alphas), np.nan)
            last[going], rows, _ = first_zeros(
                self.flow, states[going], self.p, self._rate, limit[going], int(turn > 0)
            )
            # In reduced coordinates the extension oscillates: all half periods after the first turn are equal.
            times += last * (self.family if self.reduction and turn else 1)
            states[going] = rows[:, : states.shape[1]]
            going = np.flatnonzero(np.isfinite(times))
        if self.reduction:
            late = times - self.arc.duration(u, self.machine.values)
        else:
            late = -np.sum(self.arc.conditions(u, list(states.T), self.machine.values), axis=0)
        return np.where(np.isfinite(times), late, limit), times

    def start(self, alpha: float) -> np.ndarray:
        """The unknowns (n,) of the statement near an orbit with this launch speed."""
        alphas = np.array([alpha])
        u = {**self._unknowns(alphas), "duration": self(alphas)[1]}
        return np.array([u[name][0] for name in self.statement.unknowns])

    def speeds(self, fastest: float | None = None) -> np.ndarray:
        """The launch speeds at which the search begins; `fastest` is the last where that is not to be the usual one."""
        scale, family = self.search.scale, self.family
        top = UNIFORM_TO * (family + 0.5) * np.pi * scale
        step = max(self.search.spacing * scale, top / MOST_UNIFORM)
        last = fastest or scale * family * self.search.fastest
        far = np.zeros(0) if last <= top else np.geomspace(top, last, 2 + int(np.log(last / top) / np.log(SPEED_RATIO)))
        slow = np.geomspace(SLOWEST_LAUNCH * scale, step, SLOW_LAUNCHES)
        speeds = np.concatenate([slow[:-1], np.arange(step, min(top, last), step), far])
        return np.append(speeds[speeds < last * (1 - NARROWEST_CELL)], last)

    def enclosed(self, cell: np.ndarray) -> float:
        """The launch speed in a cell (2,) at which the lateness changes its sign."""
        late = self(cell)[0]
        return float(enclosed_sign_changes(lambda alphas, _: self(alphas)[0], *cell[:, None], *late[:, None])[0][0])

    def cells(self, fastest: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The cells (k, 2) of launch speeds that hold an orbit or may touch one, and where (k,) in them it is about."""
        speeds = self.speeds(fastest)
        late = self(speeds)[0]
        while True:
            changes, settled = _judged(speeds, late)
            wide = np.diff(speeds) > NARROWEST_CELL * speeds[1:]
            halved = np.flatnonzero(~settled & wide)
            self.stopped = len(halved) > 0 and self.launches > MOST_SEARCHED
            if self.stopped or not len(halved):
                break
            middles = 0.5 * (speeds[halved] + speeds[halved + 1])
            speeds, late = np.insert(speeds, halved + 1, middles), np.insert(late, halved + 1, self(middles)[0])
        self.searched = float(speeds[0]), float(speeds[-1])
        least = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
        i = np.flatnonzero(changes | (least < TOUCHING_ZERO * (self.search.scale + speeds[1:])))
        a, b, fa, fb = speeds[i], speeds[i + 1], late[i], late[i + 1]
        about = np.where(changes[i], a - fa * np.divide(b - a, fb - fa, where=fb != fa, out=0 * fa), 0.5 * (a + b))
        return np.column_stack([a, b]), about

    def _unknowns(self, alphas: np.ndarray) -> dict[str, np.ndarray]:
        return {"alpha": alphas, "liftoff": np.full(len(alphas), self._liftoff)}

    @cached_property
    def _liftoff(self) -> float:
        """The extension at lift-off, which without damping does not depend on the speed."""
        return float(self.machine.model.release(np.array([self.search.scale]), self.machine.values)[0])

    @cached_property
    def _rate(self) -> Affine:
        """The rate of the extension, a sum of speeds, as a function of the state."""
        if self.reduction:
            return Affine(tuple(float(sign < 0) for sign in self.reduction.reversor))
        weights = np.array(self.machine.model.extension.weights)
        rows, scale = np.flatnonzero(weights), np.array([self.search.scale])
        start = columns(self.arc.start(self._unknowns(scale), np.zeros(0), self.machine.values))
        rates = self.flow.field(np.vstack([start, start + np.eye(start.shape[1])]), self.p)[0][:, rows] @ weights[rows]
        return Affine(tuple(rates[1:] - rates[0]))


def _judged(speeds: np.ndarray, late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether the lateness changes its sign in each cell (k,), and whether it then does so once, else not at all."""
    widths, changes = np.diff(speeds), (late[1:] >= 0) != (late[:-1] >= 0)
    bends = np.abs(np.diff(np.diff(late) / widths)) / (0.5 * (widths[1:] + widths[:-1]))
    bends = np.concatenate([bends[:1], bends, bends[-1:]])
    bulge = BEND_SAFETY * np.maximum(bends[1:], bends[:-1]) * widths**2 / 8
    nearest = np.minimum(np.abs(late[1:]), np.abs(late[:-1]))
    return changes, np.where(changes, np.abs(np.diff(late)) > 4 * bulge, nearest > bulge)
