"""Swings of a machine from hold to hold, and their families along a parameter, as results."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..curves import End, Event
from ..errors import InputError
from ..flow import Trajectory
from ..io import Document
from ..mechanics import HALF_SWING
from ..model import title_of_machine
from ..result import TABLE_ROWS, Axes, Progress, Result, Row, shown, stored
from ..symbolic import suggest
from .cycle_shape import mirrored

GRAZES = "the free grip passes what it takes hold of within the swing"


@dataclass(frozen=True, eq=False, repr=False)
class Swing(Result, what="swing", in_line=("half_swing", "mean_speed", "admissible")):
    """A lossless swing from hold to hold, as `find` returns it for a machine with a `Grip`.

    It leads from a release to its mirror image, where the other grip closes without an impact. There the machine may
    let go at once; it may also wait where nothing moves while both grips hold.

    machine : in words and numbers
    start : the unknowns by name, the numbers of the release and "half_swing", half the time of a swing, which begin a
        search near it
    errors : bounds on their errors
    rates : of the coordinates (n,) in the middle of the swing
    numbers : by name the "step", the distance of two holds; the "mean_speed", this over the time of a swing without a
        wait; the "smallest_grip_force" and the "largest_grip_force", by which the grip that holds carries the machine
        upwards, as a hook does if it is not below 0; the "clearance", the least distance of the free grip from what it
        takes hold of at a minimum within the swing; the "smallest_separation"; the "energy_drift" along the motion, and
        the largest "residual" of the equations. None for one that there is not
    violations : the violated conditions of a motion, in words; empty for an admissible swing
    motion : of the states over half a swing
    reversor : the sign and the shift of each state under the reversor (2, 2n), which leads to the second half
    units : of the quantities by name; empty for a dimensionless machine
    source : the machine itself, or None

    The unknowns and the numbers are attributes too.

    >>> from orbits import find
    >>> from problems import brachiator
    >>> swing = find(brachiator(arm_mass=0.25))
    >>> round(swing.angle, 9), round(swing.half_swing, 9)
    (1.207243446, 1.918479383)
    """

    machine: Mapping[str, Any]
    start: Mapping[str, float]
    errors: Mapping[str, float]
    rates: np.ndarray
    numbers: Mapping[str, float | None]
    violations: tuple[str, ...]
    motion: Trajectory
    reversor: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict)
    source: Any = None

    def __getattr__(self, name: str) -> Any:
        own = vars(self).get("start", {}) | vars(self).get("numbers", {})
        return own[name] if name in own else super().__getattr__(name)  # type: ignore[misc]

    @property
    def period(self) -> float:
        """The time from a release to the next one, without a wait."""
        return 2 * self.start[HALF_SWING]

    @property
    def admissible(self) -> bool:
        """Whether it is a motion, not merely a root of the equations."""
        return not self.violations

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """States (..., 2n) at times `t` (...), in the names of the present swing: they repeat after each swing."""
        signs, shift = self.reversor
        times = np.mod(np.asarray(t, dtype=float), self.period)
        return mirrored(self.motion, times, self.period, tuple(signs), tuple(shift))

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """The columns "time" and the states at times (k,), by default at 201 times of a swing."""
        times = np.linspace(0.0, self.period, TABLE_ROWS) if t is None else np.ravel(np.asarray(t, dtype=float))
        return {"time": times, **dict(zip(self.motion.names, self(times).T, strict=True))}

    def document(self) -> Document:
        """The result as JSON-ready data, with the unknowns and the numbers among the others."""
        own = {"errors": self.errors, "admissible": self.admissible, "violations": list(self.violations)}
        return stored({**self.machine, **self.start, "rates": self.rates.tolist(), **self.numbers, **own})

    def title(self) -> str:
        kind = "" if self.admissible else " (inadmissible)"
        return f"swing of {title_of_machine(self.machine)}{kind}"

    def heads(self) -> list[str]:
        return []

    def _notes(self) -> list[str]:
        return [f"not a motion: {why}" for why in self.violations]

    def _rows(self) -> Iterator[Row]:
        for name, value in self.start.items():
            cell = (f"{{}} {self.unit_of(name)}".rstrip(),)
            yield Row(name.replace("_", " "), {name: value}, cell, {name: self.errors[name]})
        for name, value in zip(self.motion.names[1::2], self.rates.tolist(), strict=True):
            yield Row.of(f"{name} in mid-swing", value, self.unit_of(name))
        rough = {"energy_drift", "residual", "error bound"}
        for name, number in {**self.numbers, "error bound": self.errors[HALF_SWING]}.items():
            if number is not None:
                yield Row.of(name, number, self.unit_of(name), pattern="{:.1e}" if name in rough else "{}")

    @property
    def drawn(self) -> SimpleNamespace:
        """What a drawing needs of the machine, with the numbers of the release among its parameters."""
        if (drawing := getattr(self.source, "drawing", None)) is None:
            raise InputError("the swing is drawn by its machine, which must state a drawing: load(path, machine)")
        values = {**self.source.values, **self.start}
        return SimpleNamespace(drawing=drawing, coordinates=self.source.coordinates, values=values)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the machine at instants of a swing; returns the axes."""
        return shown("plane").plot_swing(self, axes)

    def animate(self, path: str | Path, frames: int = 120, *, progress: Progress = None) -> Path:
        """Write an animation of some swings (.gif or .mp4); returns its path."""
        return shown("animation").animate_swing(self, path, frames, progress)


@dataclass(frozen=True, eq=False, repr=False)
class SwingFamily(Result, what="family of swings", dimension="point", document_is_whole=True):
    """A family of swings along a parameter, as `follow` returns it for a machine with a `Grip`.

    machine : in words and numbers
    name : of the parameter
    columns : by name the parameter, the unknowns, the numbers of a `Swing` and the "error" of half its time (m,); NaN
        for one that there is not
    unknowns : the names of the unknowns among them
    events : between the points, in order, each with these numbers as its `point`: "fold" (the parameter turns round),
        "branch point" (another family crosses), "grazing" (beyond it the free grip passes what it takes hold of),
        "parts touch" (beyond it the separation is below 0), or "value" (a requested value)
    end : how it ends
    units : of the columns by name; empty for a dimensionless machine

    >>> from orbits import follow
    >>> from problems import brachiator
    >>> family = follow(brachiator(arm_mass=0.25), "arm_mass", 0.3)
    >>> family.column("mean_speed")[[0, -1]].round(6).tolist()
    [0.487177, 0.494549]
    """

    machine: Mapping[str, Any]
    name: str
    columns: Mapping[str, np.ndarray]
    unknowns: tuple[str, ...]
    events: tuple[Event, ...]
    end: End
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns[self.name])

    @property
    def admissible(self) -> np.ndarray:
        """Whether the swings (m,) are motions."""
        return ~((self.columns["clearance"] < 0) | (self.columns["smallest_separation"] < 0))

    def table(self) -> dict[str, np.ndarray]:
        """The points as columns."""
        return dict(self.columns)

    def column(self, name: str) -> np.ndarray:
        """A column (m,) of the `table`; raises `InputError` for a name without one."""
        if name not in self.columns:
            raise InputError(f"the family has no '{name}'{suggest(name, self.columns)}")
        return self.columns[name]

    def at_event(self, event: Event) -> Mapping[str, float | None]:
        """The numbers at an event, by name."""
        return event.point

    def start(self, point: int) -> dict[str, float]:
        """The unknowns at a point by its index, as `find` takes them with the parameter's value there."""
        return {name: float(self.columns[name][point]) for name in self.unknowns}

    def _line(self) -> dict[str, object]:
        return {"along": self.name, "swings": len(self), "end": self.end.kind}

    def title(self) -> str:
        return f"swings of {title_of_machine(self.machine)}, along {self.name}: {len(self)}"

    @property
    def _main(self) -> tuple[str, ...]:
        return self.name, *self.unknowns, "mean_speed"

    def heads(self) -> list[str]:
        return ["", *map(self.heading, self._main)]

    def _rows(self) -> Iterator[Row]:
        """The ends of the family and the events between them."""
        first, last = ({name: each[i] for name, each in self.columns.items()} for i in (0, -1))
        for kind, numbers in [("first", first), *((e.kind, e.point) for e in self.events), ("last", last)]:
            yield Row(
                kind, {f"{name} at {kind}": float(numbers[name]) for name in self._main}, ("{}",) * len(self._main)
            )

    def _notes(self) -> list[str]:
        return [f"largest error of half a swing {self.columns['error'].max():.1e} {self.unit_of(HALF_SWING)}".rstrip(),
                f"end: {self.end.kind}, {self.end.reason}"]  # fmt: skip

    def plot(self, quantity: str = "mean_speed", axes: Axes | None = None, along: str | None = None) -> Axes:
        """Plot a column against another one, the parameter by default, with the events; returns the axes."""
        return shown("oscillation_figures").plot_oscillations(self, quantity, axes, along or self.name)
