"""Families of oscillations along their energy, and single oscillations, as results."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..curves import End
from ..errors import InputError
from ..flow import Trajectory
from ..model import title_of_machine
from ..result import TABLE_ROWS, Axes, Result, Row, shown
from ..symbolic import suggest
from .oscillator import DURATION, OSCILLATOR

# What may not become negative, and what is wrong where it is.
MARGINS = {
    "smallest_contact_force": "the ground would have to pull",
    "clearance": "the gap closes within the bounce",
    "smallest_separation": "masses touch",
}


@dataclass(frozen=True, eq=False, repr=False)
class Oscillation(Result, what="oscillation", in_line=("energy", "period", "stable"), document_is_whole=True):
    """A periodic motion of a conservative machine, of one arc, as `find` returns it for an energy.

    It is a motion with a closed gap, the motion of a machine without a gap, or where the restitution is 1, the flight
    from one elastic impact to the next. The defects of the integration steps certify the period, and the work along the
    motion certifies the energy.

    machine : in words and numbers
    energy : above the energy at the equilibrium
    period, error : the period, and a bound on its error
    energy_drift : largest change of the energy along the motion, as a share of it
    residual : the largest residual of the equations
    unfolding : multiple of the energy's gradient added to the equations of motion, which vanishes up to rounding
    multipliers : (2n - 2, 2), the real and the imaginary parts of the multipliers without the two of the time and of
        the energy, which are 1; empty for one coordinate
    smallest_contact_force : over the motion; None where no gap is closed
    clearance : the least height of the gap within a bounce that dips; None for others
    smallest_separation : least distance within the machine; None where no length is stated
    bounces : whether it is a flight from one elastic impact to the next
    motion : of the states over a period, in the machine's units
    units : of the quantities by name; empty for a dimensionless machine

    >>> from orbits import Mechanism, find
    >>> from orbits.mechanics import Spring
    >>> duffing = Mechanism(("u",), [Spring("u", "r + r**3")], gap=None, inertia={"u": 1.0})
    >>> round(find(duffing, at={"energy": 1.0}).period, 9)
    4.548330398
    """

    machine: Mapping[str, Any]
    energy: float
    period: float
    error: float
    energy_drift: float
    residual: float
    unfolding: float
    motion: Trajectory
    multipliers: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    smallest_contact_force: float | None = None
    clearance: float | None = None
    smallest_separation: float | None = None
    bounces: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def frequency(self) -> float:
        """One over the period."""
        return 1 / self.period

    @property
    def stable(self) -> bool:
        """Whether no multiplier lies outside the unit circle, so that small changes of the motion grow at most in
        proportion to the time."""
        return bool(np.hypot(*self.multipliers.T).max(initial=1.0) <= 1 + OSCILLATOR.on_circle)

    @property
    def admissible(self) -> bool:
        """Whether the oscillation is a motion: the ground never pulls, the gap never closes within a bounce, and no
        masses touch."""
        return not self._notes()

    @property
    def start(self) -> dict[str, float]:
        """The states at the beginning and the "duration", by name, which begin a search near it."""
        states = self.motion(0.0).tolist()
        return {**dict(zip(self.motion.names, states, strict=True)), DURATION: self.period}

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """States (..., 2n) at times `t` (...), which repeat after a period."""
        return self.motion(np.mod(np.asarray(t, dtype=float), self.period))

    def title(self) -> str:
        what = "bounce" if self.bounces else "oscillation"
        energy = f"energy {self.energy:.6g} {self.unit_of('energy')}".rstrip()
        return f"{what} of {title_of_machine(self.machine)}, {energy}"

    def table(self, times: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """The columns "time" and the states, at times (k,), or at 201 times over a period."""
        t = np.linspace(0, self.period, TABLE_ROWS) if times is None else np.ravel(np.asarray(times, dtype=float))
        return {"time": t, **dict(zip(self.motion.names, self(t).T, strict=True))}

    def heads(self) -> list[str]:
        return []

    def _notes(self) -> list[str]:
        """Why it is not a motion."""
        return [f"not a motion: {why}" for name, why in MARGINS.items() if (getattr(self, name) or 0.0) < 0]

    def _rows(self) -> Iterator[Row]:
        yield Row.of("energy", self.energy, self.unit_of("energy"))
        unit = f" {self.unit_of('period')}".rstrip()
        yield Row("period", {"period": self.period}, (f"{{}}{unit}",), {"period": self.error})
        yield Row.of("frequency", self.frequency, self.unit_of("frequency"))
        for name, value in list(self.start.items())[:-1]:
            yield Row(f"{name} at first", {f"{name} at first": value}, (f"{{}} {self.unit_of(name)}".rstrip(),))
        if len(self.multipliers):
            values = sorted((complex(*each) for each in self.multipliers.tolist()), key=lambda z: (-abs(z), z.imag))
            texts = (
                f"{z.real:.6g}" + (f"{z.imag:+.6g}i" if abs(z.imag) > OSCILLATOR.on_circle else "") for z in values
            )
            yield Row.of("multipliers", ", ".join(texts), after=", stable" if self.stable else ", unstable")
        for name in MARGINS:
            if (value := getattr(self, name)) is not None:
                yield Row.of(name, value, self.unit_of(name))
        yield Row.of("error bound", self.error, self.unit_of("period"), pattern="{:.1e}")
        yield Row.of("energy_drift", self.energy_drift, pattern="{:.1e}")
        yield Row.of("residual", self.residual, pattern="{:.1e}")

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the coordinates against time over a period; returns the axes."""
        return shown("oscillation_figures").plot_oscillation(self, axes)


@dataclass(frozen=True)
class OscillationEvent:
    """A located event on a family of oscillations.

    kind : "fold" (the energy turns round), "branch point" (another family crosses), "turn of the period" (it is longest
        or shortest there), "flip" (two multipliers pass -1: a family of twice the period begins), "Krein collision"
        (two pairs of multipliers meet, and leave the unit circle or come to it), "contact pulls" (beyond it the ground
        would have to pull), "grazing" (beyond it the gap closes within a bounce), "masses touch", or "value" (a
        requested energy)
    after : index of the point before it
    energy, period : there
    states : (2n,) at the beginning of the cycle
    """

    kind: str
    after: int
    energy: float
    period: float
    states: tuple[float, ...]

    @classmethod
    def of(cls, kind: str, after: int, x: np.ndarray) -> "OscillationEvent":
        """An event at a point X of the curve."""
        return cls(kind, after, float(x[-1]), float(x[-3]), tuple(x[:-3].tolist()))


@dataclass(frozen=True, eq=False, repr=False)
class OscillationFamily(Result, what="family of oscillations", dimension="point", document_is_whole=True):
    """A family of oscillations along their energy, as `follow` returns it.

    machine : in words and numbers
    number : of the normal mode from which it leads, by rising frequency; None for one that begins at a motion
    names : of the states (2n,)
    states : (m, 2n), at the beginning of each cycle
    energies, periods, errors : (m,), with bounds on the errors of the periods
    energy_drifts : (m,), largest changes of the energies along the motions, as shares of them
    multipliers : (m, 2n - 2, 2), as those of an `Oscillation`
    bounces : whether the motions are flights from one elastic impact to the next
    margins : what may not become negative (m,), by name: those of an `Oscillation`; NaN for the clearance of
        bounces that do not dip
    events : between the points, in order
    end : how it ends
    units : of the columns by name; empty for a dimensionless machine

    >>> from orbits import Mechanism, follow
    >>> from orbits.mechanics import Spring
    >>> duffing = Mechanism(("u",), [Spring("u", "r + r**3")], gap=None, inertia={"u": 1.0})
    >>> backbone = follow(duffing, "energy", (0.01, 100.0))
    >>> backbone.column("frequency")[[0, -1]].round(6).tolist()
    [0.160332, 0.610169]
    """

    machine: Mapping[str, Any]
    number: int | None
    names: tuple[str, ...]
    states: np.ndarray
    energies: np.ndarray
    periods: np.ndarray
    errors: np.ndarray
    energy_drifts: np.ndarray
    events: tuple[OscillationEvent, ...]
    end: End
    multipliers: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 2)))  # of one coordinate
    margins: Mapping[str, np.ndarray] = field(default_factory=dict)
    bounces: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.energies)

    @property
    def largest_multipliers(self) -> np.ndarray:
        """The largest moduli (m,) of the multipliers, 1 where there are only those of the time and of the energy."""
        if not self.multipliers.size:
            return np.ones(len(self))
        return np.hypot(*np.moveaxis(self.multipliers, 2, 0)).max(1)

    @property
    def admissible(self) -> np.ndarray:
        """Whether the oscillations (m,) are motions, as of an `Oscillation`."""
        return np.all([np.ones(len(self), bool), *(~(each < 0) for each in self.margins.values())], axis=0)

    @property
    def unstable(self) -> np.ndarray:
        """Whether small changes of the oscillations (m,) grow exponentially."""
        return self.largest_multipliers > 1 + OSCILLATOR.on_circle

    def table(self) -> dict[str, np.ndarray]:
        """The points as columns."""
        found = {"energy": self.energies, "period": self.periods, "frequency": 1 / self.periods}
        found |= dict(zip(self.names, self.states.T, strict=True))
        if self.multipliers.size:
            found["largest_multiplier"] = self.largest_multipliers
        return found | dict(self.margins) | {"error": self.errors, "energy_drift": self.energy_drifts}

    def column(self, name: str) -> np.ndarray:
        """A column (m,) of the `table`; raises `InputError` for a name without one."""
        if name not in (table := self.table()):
            raise InputError(f"the family has no '{name}'{suggest(name, table)}")
        return table[name]

    def at_event(self, event: OscillationEvent) -> dict[str, float]:
        """The energy, the period, the frequency and the states at an event, by name."""
        numbers = {"energy": event.energy, "period": event.period, "frequency": 1 / event.period}
        return numbers | dict(zip(self.names, event.states, strict=True))

    def start(self, point: int) -> dict[str, float]:
        """The states and the duration at a point by its index, as `find` takes them for its whole motion."""
        return {**dict(zip(self.names, self.states[point].tolist(), strict=True)), DURATION: float(self.periods[point])}

    def _line(self) -> dict[str, object]:
        return {"number": self.number, "oscillations": len(self), "end": self.end.kind}

    def title(self) -> str:
        mode = "" if self.number is None or self.bounces else f" of normal mode {self.number}"
        what = f"{'bounces' if self.bounces else 'oscillations'}{mode}"
        return f"{what} of {title_of_machine(self.machine)}, along energy: {len(self)}"

    def heads(self) -> list[str]:
        return ["", self.heading("energy"), self.heading("period")]

    def _rows(self) -> Iterator[Row]:
        """The ends of the family and the events between them."""
        ends = (self.energies[i].item() for i in (0, -1)), (self.periods[i].item() for i in (0, -1))
        (first, last), (begins, stops) = ends
        own = [("first", first, begins), *((e.kind, e.energy, e.period) for e in self.events), ("last", last, stops)]
        for kind, energy, period in own:
            yield Row(kind, {f"energy at {kind}": energy, f"period at {kind}": period}, ("{}", "{}"))

    def _notes(self) -> list[str]:
        error = f"largest error of a period {self.errors.max():.1e} {self.unit_of('period')}".rstrip()
        return [f"{error}, largest share of energy that drifts {self.energy_drifts.max():.1e}",
                f"end: {self.end.kind}, {self.end.reason}"]  # fmt: skip

    def plot(self, quantity: str = "frequency", axes: Axes | None = None, along: str = "energy") -> Axes:
        """Plot a column against another one, with the events: the backbone curve by default; returns the axes."""
        return shown("oscillation_figures").plot_oscillations(self, quantity, axes, along)
