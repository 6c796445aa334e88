"""Motions as piecewise Taylor polynomials: `Trajectory` of one motion, `Trajectories` of several."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict, overload

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..io import Document, conform, one_line
from ..model import Affine, StateFormula
from ..numerics import Array, evaluate, powers, shifted
from ..symbolic import ElementwiseFunction, cached, repeated


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion as Taylor polynomials, one for each step.

    On times[i] <= t <= times[i + 1] the rows are the sums over k of coefficients[i, :, k] (t - times[i])**k.
    """

    times: np.ndarray  # (N + 1,)
    coefficients: np.ndarray  # (N, n + m, K + 1), of the n states, then of the m watched quantities
    names: tuple[str, ...]  # of the rows
    # (N, n, columns), derivatives of the states at the beginnings of the steps by whatever was varied.
    variations: np.ndarray | None = None

    def __post_init__(self):
        self.times.setflags(write=False)
        self.coefficients.setflags(write=False)

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self.__post_init__()  # arrays come out of a pickle writeable

    def __repr__(self) -> str:
        return one_line(self, {"names": self.names, "steps": len(self.times) - 1, "end": self.times[-1]})

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

    def saved(self) -> Document:
        """The motion for a file; one without rows has no coefficients."""
        rows = self.coefficients if self.names else None
        return {"names": self.names, "times": self.times, "coefficients": rows}

    @classmethod
    def of_saved(cls, document: object) -> "Trajectory":
        """The motion of a document that `saved` made, whose arrays fit each other; raises `ValueError`."""
        data = conform(document, _SavedTrajectory)
        times, coefficients, names = data["times"], data["coefficients"], data["names"]
        if coefficients is None:
            coefficients = np.zeros((max(times.size - 1, 0), 0, 1))
        if not all(each.dtype.kind in "fi" and np.isfinite(each).all() for each in (times, coefficients)):
            raise ValueError("its motion is not an array of finite numbers")
        if coefficients.ndim != 3 or times.shape != (len(coefficients) + 1,) or coefficients.shape[1] != len(names):
            raise ValueError("its motion is damaged")
        if len(times) < 2 or times[0] != 0 or not (np.diff(times) > 0).all():
            raise ValueError("its motion is damaged: the times do not ascend from 0")
        return cls(times, coefficients, names)


class _SavedTrajectory(TypedDict):
    """A `Trajectory` in a file; one without rows has no coefficients."""

    names: tuple[str, ...]
    times: np.ndarray
    coefficients: np.ndarray | None


def begins_of_steps(steps: Array, counts: Array) -> Array:
    """The times (N,) at which steps (N,) begin, of motions with these numbers of steps (m,), one after the other."""
    if len(counts) == 1:
        begins = np.zeros(len(steps))
        steps[:-1].cumsum(out=begins[1:])
        return begins
    lengths = np.zeros((len(counts), int(counts.max(initial=0)) + 1))
    inside = np.arange(1, lengths.shape[1]) <= counts[:, None]
    lengths[:, 1:][inside] = steps
    return lengths.cumsum(1)[:, :-1][inside]


@dataclass(eq=False)
class Trajectories:
    """Several motions of one phase, the N steps of all in one array, so that they are evaluated together."""

    starts: Array  # (N,), times at which the steps begin
    ends: Array  # (m,), times at which the motions end
    coefficients: Array  # (N, rows, K + 1), as in `Trajectory`
    counts: Array  # (m,), number of steps of each motion
    names: tuple[str, ...]
    variations: Array | None = None  # (N, n, columns), as in `Trajectory`

    @cached_property
    def last(self) -> Array:
        """The last steps (m,) of each motion."""
        return self.counts.cumsum() - 1

    @cached_property
    def first(self) -> Array:
        """The first steps (m,) of each motion."""
        return self.last - self.counts + 1

    @cached_property
    def steps(self) -> Array:
        """The lengths (N,) of the steps."""
        steps = np.empty_like(self.starts)
        steps[:-1] = self.starts[1:]
        steps[self.last] = self.ends
        steps -= self.starts
        return steps

    @cached_property
    def owner(self) -> Array:
        """The motions (N,) that the steps belong to."""
        return np.arange(len(self.counts)).repeat(self.counts)

    @classmethod
    def of(cls, paths: Sequence[Trajectory]) -> "Trajectories":
        """Several motions of one phase, either all with variations or none."""
        moving = [path.variations for path in paths if path.variations is not None]
        parts = [(path.times[:-1], path.times[-1:], path.coefficients, [len(path.times) - 1]) for path in paths]
        starts, ends, coefficients, counts = map(np.concatenate, zip(*parts, strict=True))
        return cls(starts, ends, coefficients, counts, paths[0].names, np.concatenate(moving) if moving else None)

    def __len__(self) -> int:
        return len(self.counts)

    @classmethod
    def joined(cls, parts: Sequence["Trajectories"]) -> "Trajectories":
        """The motions of all parts, either all with variations or none."""
        names = "starts", "ends", "coefficients", "counts"
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        moving = [part.variations for part in parts if part.variations is not None]
        if len(moving) not in (0, len(parts)):
            raise ValueError("some motions have variations and others do not")
        return cls(**arrays, names=parts[0].names, variations=np.concatenate(moving) if moving else None)

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, i: int | np.integer) -> Trajectory: ...

    @overload
    def __getitem__(self, i: np.ndarray) -> "Trajectories": ...

    def __getitem__(self, i):
        """One motion, or those of the indices (k,) in their order."""
        if many := isinstance(i, np.ndarray):
            steps = np.concatenate([np.arange(a, b + 1) for a, b in zip(self.first[i], self.last[i], strict=True)])
        else:
            steps = slice(self.first[i], self.last[i] + 1)
        starts, coefficients, ends = self.starts[steps], self.coefficients[steps], self.ends[i]
        moving = None if self.variations is None else self.variations[steps]
        if many:
            return Trajectories(starts, ends, coefficients, self.counts[i], self.names, moving)
        return Trajectory(np.concatenate([starts, [ends]]), coefficients, self.names, moving)

    def parted(self, count: int) -> list["Trajectories"]:
        """The motions in `count` parts of as many each, in order."""
        if count == 1:
            return [self]
        m, moving, parts = len(self) // count, self.variations, []
        firsts, lasts = self.first[::m].tolist(), self.last[m - 1 :: m].tolist()
        for i, first, last in zip(range(0, len(self), m), firsts, lasts, strict=True):
            own, steps = slice(i, i + m), slice(first, last + 1)
            variations = None if moving is None else moving[steps]
            arrays = self.starts[steps], self.ends[own], self.coefficients[steps], self.counts[own]
            parts.append(Trajectories(*arrays, self.names, variations))
        return parts

    def with_rows(self, coefficients: Array, names: tuple[str, ...]) -> "Trajectories":
        """Motions in the same steps with other rows, of these names, without variations."""
        return Trajectories(self.starts, self.ends, coefficients, self.counts, names)

    def only(self, names: tuple[str, ...]) -> "Trajectories":
        """The motions of the first rows alone, of these names, without variations."""
        return self.with_rows(self.coefficients[:, : len(names)], names)

    def series(
        self, quantity: Affine | StateFormula, embed: np.ndarray | None = None, steps: np.ndarray | slice = slice(None),
        orders: slice = slice(None),
    ) -> np.ndarray:  # fmt: skip
        """Coefficients (N, K + 1) of a function of the first rows, or of `embed` (n, rows) times these; of some `steps`
        alone, and of some `orders`.

        Weights, offset and values of the function are numbers, or (m,) where they differ between motions.
        """
        if isinstance(quantity, StateFormula):
            c = self.coefficients[steps, :, : orders.stop]
            c = c if embed is None else embed @ c[:, : embed.shape[1]]
            return quantity.of(self.owner[steps]).series(c)[:, orders]
        weights, offset = (each[steps] if len(each) > 1 else each for each in self.of_steps(quantity, embed))
        first, *others = np.nonzero(weights.any(0))[0].tolist() or [0]
        values = weights[:, first, None] * self.coefficients[steps, first, orders]
        for i in others:  # many times faster than products of small matrices
            values += weights[:, i, None] * self.coefficients[steps, i, orders]
        if not orders.start:
            values[:, 0] += offset
        return values

    def of_steps(self, quantity: Affine, embed: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The weights (N, rows) and the offset (N,) of a function, or those of one step where all have the same;
        arguments as of `series`."""
        offset, varying = np.atleast_1d(quantity.offset), np.ndarray in map(type, quantity.weights)
        weights = np.array(np.broadcast_arrays(*quantity.weights) if varying else quantity.weights)
        if weights.ndim > 1 and (weights == weights[:, :1]).all():  # products with one number are several times faster
            weights = weights[:, 0]
        weights = weights.T[self.owner] if weights.ndim > 1 else weights[None]
        offset = offset[self.owner] if len(offset) > 1 else offset
        return weights if embed is None else weights @ embed, offset

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest absolute value (m,) of any of `values` (N, ...) on each motion."""
        return np.maximum.reduceat(np.abs(values).ravel(), self.first * (values.size // len(values)))

    @cached_property
    def sizes(self) -> np.ndarray:
        """The largest term (m, rows) of each row in any step of each motion. Places and rates have different
        dimensions, and each is measured in its own size; that of a row is 0 only where it is 0 throughout."""
        c = self.coefficients
        (terms,) = _largest_terms(*c.shape[1:])(c.reshape(len(c), -1), self.steps[:, None])
        return np.maximum.reduceat(terms[:, 1:], self.first)

    @cached_property
    def of_lasts(self) -> np.ndarray:
        """Powers (m, K + 1) of the lengths of the last steps."""
        return powers(self.steps[self.last], self.coefficients.shape[2])

    @cached_property
    def finals(self) -> np.ndarray:
        """The rows (m, rows) at the end of each motion."""
        return np.einsum("mrk,mk->mr", self.coefficients[self.last], self.of_lasts)

    @cached_property
    def step_ends(self) -> np.ndarray:
        """The rows (N, rows) at the end of every step."""
        return self.until_next(self.coefficients[:, :, 0], self.finals)

    def until_next(self, values: np.ndarray, finals: np.ndarray) -> np.ndarray:
        """The values (N, ...) at the ends of the steps, from the `values` (N, ...) at their starts and the `finals`
        (m, ...) at the ends of the motions."""
        ends = np.empty_like(values)
        ends[:-1], ends[self.last] = values[1:], finals
        return ends


@cached
def _largest_terms(rows: int, orders: int) -> ElementwiseFunction:
    """A power beyond the last one, and the largest terms (rows,) of polynomials in a step, (coefficients, one row after
    the other; length)."""
    before, c, h = (ca.SX.sym(name, count) for name, count in (("before", 1 + rows), ("c", rows), ("h", 1)))
    after = ca.vertcat(before[0] * h, ca.fmax(before[1:], ca.fabs(c * before[0])))
    step = ca.Function("largest", [before, ca.SX(0, 1), c, h], [after])
    return repeated(step, [1.0] + [0.0] * rows, np.empty((orders, 0)), columns=rows)
