"""Motions found by optimal control: evaluated, printed, plotted, tabled, saved and loaded, and stated in SI."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..flow.trajectory import SavedTrajectory, Trajectory, trajectory_of
from ..io import check_ending, conform, extra_package, fields_in_line, read_file, read_sealed, write_json, write_table
from ..result import Axes, cell, shown
from ..simulation.simulated import Leg, index_of_legs, rows_of_legs, times_within
from ..units import Dimension, Units, dimension_of_state, unit_text
from .stage import RUNNING_COST
from .transcription import Multipliers, Transcription

CONTROL_FORMAT = "persistent-orbits control 1"
TABLE_ROWS = 201  # of a table whose times are not given
CONTROL_NUMBERS = ("cost", "violation", "error", "seconds")


@dataclass(frozen=True)
class ControlledLeg(Leg):
    """One stage of a motion, whose rows are the states, the path expressions and the running cost of the stage; with
    its inputs as polynomials of the time since its start, and the names of its states."""

    inputs: Trajectory
    states: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Duration of the stage."""
        return float(self.path.times[-1])

    def input_of(self, name: str) -> Callable[[float], float]:
        """An input as a function of the time in the stage."""
        row = self.inputs.names.index(name)
        return lambda t: self.inputs(t)[row]

    def input_column(self, name: str) -> np.ndarray:
        """Coefficients (N, K + 1) of an input on each interval, 0 where the stage does not have it."""
        return self.inputs.row(name) if name in self.inputs.names else np.zeros((len(self.inputs.steps), 1))


@dataclass(frozen=True)
class WarmStart:
    """The point from which the next solve starts: a problem with its unknowns and multipliers."""

    problem: Transcription
    x: np.ndarray
    multipliers: Multipliers | None
    shares: np.ndarray  # of its interval at which each exchange point of the problem lies
    unit: float = 1.0  # of the cost, which it brings to order one, since Ipopt's tolerances are absolute


@dataclass(frozen=True)
class Control:
    """A motion of locally least cost. Another guess may lead to a motion that costs less.

    Called with times (...) it returns states (..., n).

    legs : the motions of the stages, in order
    cost : cost of the accurate motion
    parameters : all parameters by name, the free ones with the values found
    violation : largest amount by which the accurate motion violates a condition, a bound, or the sign of a path
        expression
    error : largest difference of the states (relative to their size) or of the cost between the accurate motion and the
        solution of the nonlinear program
    coarseness : relative change of the cost at the last halving of the intervals, NaN if they were not halved.
        Violation and error are those of this motion; they do not show how much finer inputs would save
    iterations, rounds : number of Ipopt's iterations, and of the solves in which they were taken
    seconds : total time
    status : "optimal"; any other outcome is raised as an error
    units : of "cost", "time" and the inputs, by name, where the numbers are in SI; violation and error have none
    bare : the same motion without units, None where there are none
    """

    legs: tuple[ControlledLeg, ...]
    cost: float
    parameters: Mapping[str, float]
    violation: float
    error: float
    iterations: int
    rounds: int
    seconds: float
    status: str = "optimal"
    coarseness: float = np.nan
    answer: WarmStart | None = field(default=None, repr=False)
    units: Mapping[str, str] | None = None
    bare: Self | None = field(default=None, repr=False)

    def dimensionless(self) -> Self:
        """The motion in its machine's dimensionless units; the motion itself if it has no other units."""
        return self.bare or self

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: all but the nonlinear program. As a guess the copy starts a solve from its motion."""
        return {each.name: getattr(self, each.name) for each in fields(self)} | {"answer": None}

    def __repr__(self) -> str:
        return fields_in_line(self, "status", "cost", "violation", "error", "end")

    @property
    def durations(self) -> np.ndarray:
        """Durations of the stages."""
        return np.array([leg.duration for leg in self.legs])

    @property
    def end(self) -> float:
        """The time at which the last stage ends."""
        return self.legs[-1].start + self.legs[-1].duration

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states that all stages have, in the order of the first stage. A leg's own are in `legs`."""
        return tuple(name for name in self.legs[0].states if all(name in leg.states for leg in self.legs))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that any stage has, in the order in which they appear."""
        return tuple(dict.fromkeys(name for leg in self.legs for name in leg.inputs.names))

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """The `states` (..., n) at times (...), from 0 to `end`; where two stages meet, those of the later one.

        Raises `InputError` for other times, and for what is not a number.
        """
        return self._rows(t, lambda leg, since: leg.path(since)[..., [leg.states.index(name) for name in self.states]])

    def inputs_at(self, t: ArrayLike) -> np.ndarray:
        """The `inputs` (..., m) at times (...), 0 where a stage does not have them; where they jump, the later values.

        Raises as a call does.
        """

        def rows(leg: ControlledLeg, since: np.ndarray) -> np.ndarray:
            values, names = leg.inputs(since), leg.inputs.names
            columns = [values[..., names.index(name)] if name in names else 0 * since for name in self.inputs]
            return np.stack(columns, axis=-1) if columns else np.zeros((*since.shape, 0))

        return self._rows(t, rows)

    def _rows(self, t: ArrayLike, rows: Callable[[ControlledLeg, np.ndarray], np.ndarray]) -> np.ndarray:
        return rows_of_legs(self.legs, self.end, t, rows, self._second)

    @property
    def _second(self) -> str:
        """The unit of time after a number."""
        return " s" if self.units else ""

    def schedule(self, *names: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The times (k + 1,) at which piecewise constant inputs change, and their values (k,) in between, 0 where a
        stage does not have them, as `simulate` takes them.

        Raises `InputError` for a name that is no input, and for an input that varies within an interval.
        """
        if strange := set(names).difference(*(leg.inputs.names for leg in self.legs)):
            raise InputError(f"there is no input '{min(strange)}'")
        rows = {name: [leg.input_column(name) for leg in self.legs] for name in names}
        if varying := [name for name, columns in rows.items() if any(c[:, 1:].any() for c in columns)]:
            raise InputError(f"input '{varying[0]}' varies within an interval: it is no schedule; give it degree 0")
        times = np.concatenate([*(leg.start + leg.inputs.times[:-1] for leg in self.legs), [self.end]])
        return times, {name: np.concatenate([c[:, 0] for c in columns]) for name, columns in rows.items()}

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Columns (k,) by name at times (k,), by default evenly spaced: "time", "stage", the states, the inputs, and
        the "running cost", the cost of the stages up to that time without the costs at their ends."""
        asked = np.linspace(0.0, self.end, TABLE_ROWS) if t is None else t
        t = times_within(asked, self.end, self._second).ravel()
        states, inputs = self(t), self.inputs_at(t)
        stages = np.array([leg.phase for leg in self.legs])[index_of_legs(self.legs, t)]
        columns = {"time": t, "stage": stages}
        columns |= dict(zip(self.states, states.T, strict=True)) | dict(zip(self.inputs, inputs.T, strict=True))
        return columns | {RUNNING_COST: self._spent(t)}

    def _spent(self, t: np.ndarray) -> np.ndarray:
        """The running costs (...) of all stages up to times (...)."""
        before = np.cumsum([0.0, *(leg.path.end[-1] for leg in self.legs)])
        within = self._rows(t, lambda leg, since: leg.path(since)[..., -1:])[..., 0]
        return within + before[index_of_legs(self.legs, t)]

    def dataframe(self, t: ArrayLike | None = None) -> Any:
        """The `table` as a `pandas.DataFrame`; raises `InputError` without pandas, which the extra `data` installs."""
        return extra_package("pandas", "for a data frame").DataFrame(self.table(t))

    def heading(self, name: str) -> str:
        """The name of a column with its unit, if it has one: "time (s)"."""
        if self.units is None or name == "stage":
            return name
        own = "cost" if name == RUNNING_COST else name
        return f"{name} ({self.units.get(own) or unit_text(dimension_of_state(name))})"

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot states against time, and inputs below; returns the axes."""
        return shown("control_figures").plot_control(self, axes)

    def document(self) -> dict[str, Any]:
        """The motion as JSON-ready data, with everything that its file has."""
        legs = [
            {"phase": leg.phase, "start": leg.start, "states": leg.states}
            | {"path": leg.path.saved(), "inputs": leg.inputs.saved()}
            for leg in self.legs
        ]
        told = {
            name: getattr(self, name) for name in ("status", *CONTROL_NUMBERS, "iterations", "rounds", "parameters")
        }
        coarseness = None if np.isnan(self.coarseness) else self.coarseness
        bare = self.bare and self.bare.document()
        whole = {"format": CONTROL_FORMAT, **told, "coarseness": coarseness, "units": self.units}
        return {**whole, "legs": legs, "bare": bare}

    def save(self, path: str | Path) -> Path:
        """Write the motion to .json, from which `load` brings it back to the last bit, or its `table` to .csv; returns
        the path. Raises `InputError` when the file cannot be written."""
        if check_ending(path, "control") == ".json":
            return write_json(self.document(), path, "control")
        table = self.table()
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        return write_table([*map(self.heading, table)], rows, path, "control")

    @classmethod
    def load(cls, path: str | Path) -> "Control":
        """Read a motion that `save` wrote, for example as a guess for another solve. Raises `InputError` when the file
        does not have one."""
        return read_file(path, f"{path} is not a saved control", control_in_file)

    def rows(self) -> list[tuple[str, str]]:
        """The motion as rows of a table, (name, text): its stages, its cost and errors, how it was found."""
        unit = f" {self.units['cost']}" if self.units else ""
        rows = [(leg.phase, f"from {leg.start:<12.8g}for {leg.duration:.10g}{self._second}") for leg in self.legs]
        rows.append(("cost", f"{self.cost:.12g}{unit}, violation {self.violation:.1e}, error {self.error:.1e}"))
        return [*rows, ("found in", f"{self.iterations} iterations, {self.rounds} rounds, {self.seconds:.2f} s")]

    def __str__(self) -> str:
        return "\n".join(f"  {name:<12}{text}" for name, text in self.rows())

    def _repr_html_(self) -> str:
        return cell("motion of locally least cost", self.rows(), self.plot)


class _SavedLeg(TypedDict):
    """A `ControlledLeg` in a file."""

    phase: str
    start: float
    states: tuple[str, ...]
    path: SavedTrajectory
    inputs: SavedTrajectory


class SavedControl(TypedDict):
    """A `Control` in a file; `bare` is another one, without units."""

    format: str
    status: str
    cost: float
    violation: float
    error: float
    seconds: float
    iterations: int
    rounds: int
    parameters: Mapping[str, float]
    coarseness: float | None
    units: Mapping[str, str] | None
    legs: tuple[_SavedLeg, ...]
    bare: Mapping[str, Any] | None


def control_in_file(file: BinaryIO) -> Control:
    """The motion in an open file; raises `ValueError` where there is none."""
    return control_of(read_sealed(file))


def control_of(document: Any) -> Control:
    """The motion of what `Control.document` made; raises `ValueError` where parts of it do not fit each other."""
    data = conform(document, SavedControl)
    if data["format"] != CONTROL_FORMAT:
        raise ValueError(f"format {data['format']!r}, expected {CONTROL_FORMAT!r}")
    units, bare = data["units"], data["bare"]
    if (units is None) != (bare is None) or (units is not None and not {"cost", "time"} <= units.keys()):
        raise ValueError("its units do not fit its numbers")
    legs = tuple(map(_leg_of, data["legs"]))
    ends = np.cumsum([0.0, *(leg.duration for leg in legs)])
    if not legs or not np.allclose([leg.start for leg in legs], ends[:-1], rtol=1e-9, atol=1e-9 * ends[-1]):
        raise ValueError("its stages do not follow each other")
    bare = None if bare is None else control_of({**bare, "units": None, "bare": None})
    if bare is not None and [*map(_names_of, bare.legs)] != [*map(_names_of, legs)]:
        raise ValueError("its motions in SI and without units have other stages")
    told = {name: data[name] for name in ("status", *CONTROL_NUMBERS, "iterations", "rounds", "parameters", "units")}
    coarseness = np.nan if data["coarseness"] is None else data["coarseness"]
    return Control(legs, **told, coarseness=coarseness, bare=bare)


def _names_of(leg: ControlledLeg) -> tuple[Any, ...]:
    return leg.phase, leg.states, leg.path.names, leg.inputs.names


def _leg_of(data: _SavedLeg) -> ControlledLeg:
    """A stage whose parts fit each other; raises `ValueError`."""
    path, inputs, states = trajectory_of(data["path"]), trajectory_of(data["inputs"]), data["states"]
    fits = path.names[: len(states)] == states and path.names[len(states) :][-1:] == (RUNNING_COST,)
    if not states or not fits or path.times[-1] != inputs.times[-1]:
        raise ValueError(f"its stage '{data['phase']}' is damaged")
    return ControlledLeg(data["phase"], data["start"], path, inputs, states)


def control_in_units(
    control: Control, units: Units, cost: Dimension, parameters: Mapping[str, float], own: Mapping[str, Dimension]
) -> Control:
    """A dimensionless motion in these units, with the parameters given.

    cost : its dimension; own : those of inputs and path expressions, by name
    """
    rows = {**own, RUNNING_COST: cost}
    legs = tuple(
        replace(
            leg,
            start=leg.start * units.time,
            path=units.convert_motion(leg.path, rows),
            inputs=units.convert_motion(leg.inputs, own),
        )
        for leg in control.legs
    )
    inputs = {name: unit_text(own[name]) for leg in control.legs for name in leg.inputs.names if name in own}
    texts = {"cost": unit_text(cost), "time": "s", **inputs}
    return replace(
        control, legs=legs, cost=control.cost * units.of(cost), parameters=parameters, units=texts, bare=control
    )
