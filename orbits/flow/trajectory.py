"""Motions as piecewise Taylor polynomials, one by one and many together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model.phase import Affine
from ..numerics.bernstein import PiecewisePolynomials, evaluate, powers, shifted


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion as Taylor polynomials: on times[i] <= t <= times[i + 1] the rows are sums of
    c[i, :, k] (t - times[i])**k.

    times : (N + 1,)
    coefficients : (N, n + m, K + 1), the n states, then the m watched quantities
    names : of the rows
    variations : (N, n, columns, K + 1), the states' derivatives with respect to whatever was varied, None without
    """

    times: np.ndarray
    coefficients: np.ndarray
    names: tuple[str, ...]
    variations: np.ndarray | None = None

    def __post_init__(self):
        self.times.setflags(write=False)
        self.coefficients.setflags(write=False)

    def __call__(self, t):
        """Rows (..., n + m) at times `t` (...), which lie within the trajectory's."""
        t = np.asarray(t, dtype=float)
        piece = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        return evaluate(self.coefficients[piece], (t - self.times[piece])[..., None])

    @cached_property
    def steps(self) -> np.ndarray:
        """Lengths (N,) of the polynomials' intervals."""
        return self.times[1:] - self.times[:-1]

    @cached_property
    def end(self) -> np.ndarray:
        """Rows (n + m,) at the last time."""
        return evaluate(self.coefficients[-1], self.times[-1] - self.times[-2])

    def split(self, t: float) -> tuple["Trajectory", "Trajectory"]:
        """The motion up to time `t`, and the rest told backwards from its end."""
        i = int(np.clip(np.searchsorted(self.times, t) - 1, 0, len(self.times) - 2))
        h = t - self.times[i]
        first = Trajectory(np.append(self.times[: i + 1], t), self.coefficients[: i + 1], self.names)
        rest = np.concatenate([shifted(self.coefficients[i : i + 1], np.array([h])), self.coefficients[i + 1 :]])
        times = np.append(t, self.times[i + 1 :])
        ends = shifted(rest, np.diff(times)) * (-1.0) ** np.arange(rest.shape[2])
        return first, Trajectory(times[-1] - times[::-1], ends[::-1], self.names)

    def row(self, name: str) -> np.ndarray:
        """Coefficients (N, K + 1) of one row."""
        return self.coefficients[:, self.names.index(name)]


class Trajectories:
    """Motions of one phase, their steps joined, to be asked all together; quantities are per step (N, ...).

    starts : (N,), times at which the steps begin, `steps` their lengths
    ends : (m,), times at which the motions do
    coefficients, variations : (N, ...), as in `Trajectory`
    counts : (m,), steps of each; `first` and `last` (m,) are where they begin and end
    owner : (N,), the motion that a step belongs to
    """

    def __init__(self, starts, ends, coefficients, counts, names: tuple[str, ...], variations=None):
        self.starts, self.ends, self.coefficients, self.variations = starts, ends, coefficients, variations
        self.counts, self.names = counts, names
        self.last = np.cumsum(counts) - 1
        self.first = self.last - counts + 1
        self.owner = np.repeat(np.arange(len(counts)), counts)
        self.steps = np.append(starts[1:], 0.0)
        self.steps[self.last] = ends
        self.steps -= starts

    @classmethod
    def of(cls, paths: Sequence[Trajectory]) -> "Trajectories":
        """Of one phase, all with variations or none."""
        varied = paths[0].variations is not None
        return cls(
            np.concatenate([path.times[:-1] for path in paths]),
            np.array([path.times[-1] for path in paths]),
            np.concatenate([path.coefficients for path in paths]),
            np.array([len(path.times) - 1 for path in paths]),
            paths[0].names,
            np.concatenate([path.variations for path in paths]) if varied else None,
        )

    def __len__(self) -> int:
        return len(self.counts)

    @classmethod
    def joined(cls, parts: Sequence["Trajectories"]) -> "Trajectories":
        """As one, all with variations or none."""
        arrays = "starts", "ends", "coefficients", "counts", "variations"
        if parts[0].variations is None:
            arrays = arrays[:-1]
        found = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
        return cls(**found, names=parts[0].names)

    def __getitem__(self, i: int | np.ndarray) -> "Trajectory | Trajectories":
        """One of them, or some in an order (k,)."""
        if isinstance(i, np.ndarray):
            some = np.concatenate([np.arange(a, b + 1) for a, b in zip(self.first[i], self.last[i], strict=True)])
            moving = None if self.variations is None else self.variations[some]
            known = self.starts[some], self.ends[i], self.coefficients[some], self.counts[i], self.names, moving
            return Trajectories(*known)
        some = slice(self.first[i], self.last[i] + 1)
        moving = None if self.variations is None else self.variations[some]
        return Trajectory(np.append(self.starts[some], self.ends[i]), self.coefficients[some], self.names, moving)

    def replaced(self, i: np.ndarray, others: "Trajectories") -> "Trajectories":
        """With the motions i (k,), ascending, replaced by others."""
        if not (self.counts[i] == others.counts).all():
            order = np.arange(len(self))
            order[i] = len(self) + np.arange(len(i))
            return Trajectories.joined([self, others])[order]
        some, arrays = np.isin(self.owner, i), {}
        for name in ("starts", "coefficients", "variations"):
            if (array := getattr(self, name)) is not None:
                arrays[name] = array.copy()
                arrays[name][some] = getattr(others, name)
        ends = self.ends.copy()
        ends[i] = others.ends
        return Trajectories(**arrays, ends=ends, counts=self.counts, names=self.names)

    def moved(self, changes, longer) -> "Trajectories":
        """The states' motions for small `changes` (m, columns) of what was varied, and so much longer (m,); to first
        order, with their variations at the nodes alone."""
        states = self.variations.shape[1]
        change = np.einsum("Nick,Nc->Nik", self.variations, changes[self.owner])
        coefficients, names = self.coefficients[:, :states] + change, self.names[:states]
        return Trajectories(self.starts, self.ends + longer, coefficients, self.counts, names, self.variations[..., :1])

    def only(self, names: tuple[str, ...]) -> "Trajectories":
        """The first rows alone, by their names, without variations."""
        return Trajectories(self.starts, self.ends, self.coefficients[:, : len(names)], self.counts, names)

    def series(self, quantity: Affine, embed=None) -> np.ndarray:
        """Coefficients (N, K + 1) of an affine function of the first rows, or of `embed` (n, rows) times these; its
        weights and offset are numbers, or (m,) of each motion."""
        weights, offset = quantity.weights, quantity.offset
        if any(map(np.ndim, weights)):
            weights = np.array(np.broadcast_arrays(*weights)).T[self.owner]
        else:
            weights = np.array(weights)
        if embed is not None:
            weights = weights @ embed
        coefficients = self.coefficients[:, : weights.shape[-1]]
        along = weights @ coefficients if weights.ndim == 1 else np.einsum("Ni,Nik->Nk", weights, coefficients)
        along[:, 0] += offset[self.owner] if np.ndim(offset) else offset
        return along

    def pile(self, series) -> PiecewisePolynomials:
        """The piecewise polynomials of `series` (N, K + 1), one for each motion."""
        return PiecewisePolynomials(series, self.steps, self.counts, self.of_steps)

    def time(self, owner, piece, t) -> np.ndarray:
        """The times (r,) of places in motions, as a `PiecewisePolynomials` tells them."""
        return self.starts[self.first[owner] + piece] + t

    def largest(self, values) -> np.ndarray:
        """Of each motion the largest absolute value (m,) of any of `values` (N, ...)."""
        return np.maximum.reduceat(np.abs(values).reshape(len(values), -1).max(1), self.first)

    @cached_property
    def of_steps(self) -> np.ndarray:
        """Powers (N, K + 1) of the steps."""
        return powers(self.steps, self.coefficients.shape[2])

    @cached_property
    def finals(self) -> np.ndarray:
        """The rows (m, rows) at the end of each."""
        return evaluate(self.coefficients[self.last], self.steps[self.last, None])
