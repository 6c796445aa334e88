"""Motions as piecewise Taylor polynomials: `Trajectory` of one motion, `Trajectories` of several."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from ..model.phase import Affine
from ..numerics.bernstein import PiecewisePolynomials, evaluate, powers, shifted


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion as Taylor polynomials, one for each step.

    On times[i] <= t <= times[i + 1] the rows are the sums over k of coefficients[i, :, k] (t - times[i])**k.

    times : (N + 1,)
    coefficients : (N, n + m, K + 1), of the n states, then of the m watched quantities
    names : of the rows
    variations : (N, n, columns, K + 1), derivatives of the states with respect to whatever was varied, None without
    """

    times: np.ndarray
    coefficients: np.ndarray
    names: tuple[str, ...]
    variations: np.ndarray | None = None

    def __post_init__(self):
        self.times.setflags(write=False)
        self.coefficients.setflags(write=False)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Rows (..., n + m) at times `t` (...), which must lie within those of the trajectory."""
        t = np.asarray(t, dtype=float)
        step = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        return evaluate(self.coefficients[step], (t - self.times[step])[..., None])

    @cached_property
    def steps(self) -> np.ndarray:
        """Lengths (N,) of the steps."""
        return self.times[1:] - self.times[:-1]

    @cached_property
    def end(self) -> np.ndarray:
        """Rows (n + m,) at the last time."""
        return evaluate(self.coefficients[-1], self.times[-1] - self.times[-2])

    def split(self, t: float) -> tuple["Trajectory", "Trajectory"]:
        """The motion up to time `t`, and the rest of it in reversed time."""
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
    """Several motions of one phase, the N steps of all in one array, so that they are evaluated together.

    starts, steps : (N,), times at which the steps begin, and their lengths
    ends : (m,), times at which the motions end
    coefficients, variations : (N, ...), as in `Trajectory`
    counts : (m,), number of steps of each motion; `first` and `last` (m,) are its first and last step
    owner : (N,), the motion that a step belongs to
    """

    def __init__(
        self,
        starts: np.ndarray,
        ends: np.ndarray,
        coefficients: np.ndarray,
        counts: np.ndarray,
        names: tuple[str, ...],
        variations: np.ndarray | None = None,
    ):
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
        """Several motions of one phase, either all with variations or none."""
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
        """The motions of all parts, either all with variations or none."""
        varied = parts[0].variations is not None
        names = ("starts", "ends", "coefficients", "counts", *(("variations",) if varied else ()))
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(**arrays, names=parts[0].names)

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, i: int | np.integer) -> Trajectory: ...

    @overload
    def __getitem__(self, i: np.ndarray) -> "Trajectories": ...

    def __getitem__(self, i):
        """One motion, or those of the indices (k,) in their order."""
        variations = self.variations
        if isinstance(i, np.ndarray):
            steps = np.concatenate([np.arange(a, b + 1) for a, b in zip(self.first[i], self.last[i], strict=True)])
            moving = None if variations is None else variations[steps]
            chosen = self.starts[steps], self.ends[i], self.coefficients[steps], self.counts[i]
            return Trajectories(*chosen, self.names, moving)
        steps = slice(self.first[i], self.last[i] + 1)
        moving = None if variations is None else variations[steps]
        return Trajectory(np.append(self.starts[steps], self.ends[i]), self.coefficients[steps], self.names, moving)

    def replaced(self, i: np.ndarray, others: "Trajectories") -> "Trajectories":
        """The motions with those of the indices i (k,), ascending, replaced by others."""
        if not (self.counts[i] == others.counts).all():
            order = np.arange(len(self))
            order[i] = len(self) + np.arange(len(i))
            return Trajectories.joined([self, others])[order]
        steps, arrays = np.isin(self.owner, i), {}
        for name in ("starts", "coefficients", "variations"):
            if (array := getattr(self, name)) is not None:
                arrays[name] = array.copy()
                arrays[name][steps] = getattr(others, name)
        ends = self.ends.copy()
        ends[i] = others.ends
        return Trajectories(**arrays, ends=ends, counts=self.counts, names=self.names)

    def moved(self, changes: np.ndarray, longer: np.ndarray) -> "Trajectories":
        """The states to first order after small `changes` (m, columns) of what was varied.

        The motions last `longer` (m,), and their variations are kept at the starts of the steps alone.
        """
        assert self.variations is not None
        states = self.variations.shape[1]
        change = np.einsum("Nick,Nc->Nik", self.variations, changes[self.owner])
        coefficients, names = self.coefficients[:, :states] + change, self.names[:states]
        return Trajectories(self.starts, self.ends + longer, coefficients, self.counts, names, self.variations[..., :1])

    def only(self, names: tuple[str, ...]) -> "Trajectories":
        """The motions of the first rows alone, given by their names, without variations."""
        return Trajectories(self.starts, self.ends, self.coefficients[:, : len(names)], self.counts, names)

    def series(self, quantity: Affine, embed: np.ndarray | None = None) -> np.ndarray:
        """Coefficients (N, K + 1) of an affine function of the first rows, or of `embed` (n, rows) times these.

        The weights and the offset of the function are numbers, or (m,) where they differ between motions.
        """
        offset: ArrayLike = quantity.offset
        if any(map(np.ndim, quantity.weights)):
            weights = np.array(np.broadcast_arrays(*quantity.weights)).T[self.owner]
        else:
            weights = np.array(quantity.weights)
        if embed is not None:
            weights = weights @ embed
        coefficients = self.coefficients[:, : weights.shape[-1]]
        values = weights @ coefficients if weights.ndim == 1 else np.einsum("Ni,Nik->Nk", weights, coefficients)
        values[:, 0] += np.asarray(offset)[self.owner] if np.ndim(offset) else offset
        return values

    def pile(self, series: np.ndarray) -> PiecewisePolynomials:
        """The piecewise polynomials with the coefficients `series` (N, K + 1), one for each motion."""
        return PiecewisePolynomials(series, self.steps, self.counts, self.of_steps)

    def time(self, owner: np.ndarray, piece: np.ndarray, t: np.ndarray) -> np.ndarray:
        """The times (r,) of places in motions, given as `PiecewisePolynomials` returns them."""
        return self.starts[self.first[owner] + piece] + t

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest absolute value (m,) of any of `values` (N, ...) on each motion."""
        return np.maximum.reduceat(np.abs(values).reshape(len(values), -1).max(1), self.first)

    @cached_property
    def of_steps(self) -> np.ndarray:
        """Powers (N, K + 1) of the step lengths."""
        return powers(self.steps, self.coefficients.shape[2])

    @cached_property
    def finals(self) -> np.ndarray:
        """The rows (m, rows) at the end of each motion."""
        return evaluate(self.coefficients[self.last], self.steps[self.last, None])
