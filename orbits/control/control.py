"""Motions found by optimal control: evaluated, printed, plotted, tabulated, saved and loaded, and stated in SI."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..flow import Trajectory
from ..hops import Leg, index_of_legs, rows_of_legs, times_within
from ..io import Document, conform
from ..model import Machine
from ..result import TABLE_ROWS, Axes, Result, Row, shown
from ..units import Dimension, Units, dimension_of_state, unit_text
from .stage import RUNNING_COST
from .transcription import Multipliers, Transcription

if TYPE_CHECKING:
    from .optimal_family import OptimalFamily

CONTROL_NUMBERS = ("cost", "violation", "error", "seconds")


@dataclass(frozen=True)
class ControlledLeg(Leg):
    """One stage of a motion, whose rows are the states, the path expressions and the running cost of the stage; with
    its inputs as polynomials of the time since its start, and the names of its states."""

    inputs: Trajectory
    states: tuple[str, ...]

    @classmethod
    def of_saved(cls, document: Mapping[str, object]) -> "ControlledLeg":
        """The stage from its document in a file; raises `ValueError` where its parts contradict each other."""
        kinds = {"phase": str, "start": float, "path": Trajectory, "inputs": Trajectory, "states": tuple[str, ...]}
        leg = cls(**{name: conform(document[name], kind, name) for name, kind in kinds.items()})
        rest = leg.path.names[len(leg.states) :]
        fits = leg.path.names[: len(leg.states)] == leg.states and rest[-1:] == (RUNNING_COST,)
        if not leg.states or not fits or leg.path.times[-1] != leg.inputs.times[-1]:
            raise ValueError(f"its stage '{leg.phase}' is damaged")
        return leg

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
    free: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # bounds of the free parameters
    tolerance: float = 1e-9  # the largest violation and error allowed


@dataclass(frozen=True, repr=False)
class Control(Result, what="control", document_is_whole=True, in_line=("status", "cost", "violation", "error", "end")):
    """A motion of locally least cost. Another guess may lead to one that costs less.

    Called with times (...) it returns states (..., n).

    legs : the motions of the stages, in order
    cost : cost of the accurate motion
    parameters : all parameters by name, the free ones with the values found
    violation : largest amount by which the accurate motion violates a condition, a bound, or the sign of a path
        expression
    error : the largest difference between the accurate motion and the nonlinear program, in the states relative to
        their size, or in the cost
    coarseness : relative change of the cost by the last halving of the intervals, NaN if they were not halved.
        Violation and error belong to this motion and do not show what finer inputs would save
    iterations, rounds : Ipopt's iterations, and the solves in which they were taken
    seconds : time taken in all
    status : always "optimal"; anything else is raised as an error
    units : of the cost, the time, the states and the inputs, by name; empty where the numbers are not in SI. Violation
        and error have none
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
    warm_start: WarmStart | None = field(default=None, repr=False)
    units: Mapping[str, str] = field(default_factory=dict)
    bare: Self | None = field(default=None, repr=False)

    def dimensionless(self) -> Self:
        """The motion in its machine's dimensionless units; the motion itself if it has no other units."""
        return self.bare or self

    def __getstate__(self) -> dict[str, Any]:
        """The pickled state: all but the nonlinear program. As a guess the copy starts a solve from its motion."""
        return {each.name: getattr(self, each.name) for each in fields(self)} | {"warm_start": None}

    machine = property(lambda self: {})  # a motion is of stages

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
        """Names of the states that all stages share, in the order of the first stage; `legs` has all states of each
        leg."""
        return tuple(name for name in self.legs[0].states if all(name in leg.states for leg in self.legs))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that any stage has, in the order in which they appear."""
        return tuple(dict.fromkeys(name for leg in self.legs for name in leg.inputs.names))

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """The `states` (..., n) at times (...), from 0 to `end`; where two stages meet, the states of the later one.

        Raises `InputError` for other times, and for anything but numbers.
        """
        return self._along(t, lambda leg, since: leg.path(since)[..., [leg.states.index(name) for name in self.states]])

    def inputs_at(self, t: ArrayLike) -> np.ndarray:
        """The `inputs` (..., m) at times (...), 0 where a stage does not have them; where they jump, the later values.

        Raises as a call does.
        """

        def rows(leg: ControlledLeg, since: np.ndarray) -> np.ndarray:
            values, names = leg.inputs(since), leg.inputs.names
            columns = [values[..., names.index(name)] if name in names else 0 * since for name in self.inputs]
            return np.stack(columns, axis=-1) if columns else np.zeros((*since.shape, 0))

        return self._along(t, rows)

    def _along(self, t: ArrayLike, rows: Callable[[ControlledLeg, np.ndarray], np.ndarray]) -> np.ndarray:
        return rows_of_legs(self.legs, self.end, t, rows, self._second)

    @property
    def _second(self) -> str:
        """The unit of time after a number."""
        return " s" if self.units else ""

    def follow(self, name: str, to: float, **options: Any) -> "OptimalFamily":
        """Follow the motion in a parameter: an `OptimalFamily` of motions of locally least cost, on the same intervals.

        name : of one of its `parameters` with a value
        to : the last value of the parameter
        options : as in `orbits.control.optimal_family.follow_optimum`, such as `at`, values among those of the family

        >>> from orbits import steer
        >>> from orbits.control import Guess, Input, Stage
        >>> from orbits.model import Phase
        >>> cart = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
        >>> ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - p["d"], x[1]]}
        >>> stage = Stage(cart, 4, (1, 1), {"f": Input(degree=1)}, **ends, running=lambda x, p, q: p["f"] ** 2)
        >>> found = steer([stage], {"d": 1.0}, guess=[Guess(1.0, lambda t: [t, 1.0])])
        >>> round(float(found.follow("d", 2.0).costs[-1]), 9)  # 12 d^2
        48.0
        """
        family: OptimalFamily = import_module(f"{__package__}.optimal_family").follow_optimum(self, name, to, **options)
        return family

    def schedule(self, *names: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The times (k + 1,) at which piecewise constant inputs change, and their values (k,) in between, in the form
        that `simulate` takes; an input that a stage does not have is 0 there.

        Raises `InputError` for a name that is not an input, and for an input that varies within an interval.
        """
        if strange := set(names).difference(*(leg.inputs.names for leg in self.legs)):
            raise InputError(f"there is no input '{min(strange)}'")
        rows = {name: [leg.input_column(name) for leg in self.legs] for name in names}
        if varying := [name for name, columns in rows.items() if any(c[:, 1:].any() for c in columns)]:
            raise InputError(
                f"input '{varying[0]}' varies within an interval, which a schedule cannot do; give it degree 0"
            )
        times = np.concatenate([*(leg.start + leg.inputs.times[:-1] for leg in self.legs), [self.end]])
        return times, {name: np.concatenate([c[:, 0] for c in columns]) for name, columns in rows.items()}

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Columns (k,) by name at times (k,), evenly spaced by default: "time", "stage", the states, the inputs, and
        the "running cost", the cost so far without the costs at the ends of stages."""
        t = times_within(np.linspace(0.0, self.end, TABLE_ROWS) if t is None else t, self.end, self._second).ravel()
        states, inputs = self(t), self.inputs_at(t)
        stages = np.array([leg.phase for leg in self.legs])[index_of_legs(self.legs, t)]
        columns = {"time": t, "stage": stages}
        columns |= dict(zip(self.states, states.T, strict=True)) | dict(zip(self.inputs, inputs.T, strict=True))
        return columns | {RUNNING_COST: self._spent(t)}

    def _spent(self, t: np.ndarray) -> np.ndarray:
        """The running costs (...) of all stages up to times (...)."""
        before = np.cumsum([0.0, *(leg.path.end[-1] for leg in self.legs)])
        within = self._along(t, lambda leg, since: leg.path(since)[..., -1:])[..., 0]
        return within + before[index_of_legs(self.legs, t)]

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot states against time, and inputs below; returns the axes."""
        return shown("control_figures").plot_control(self, axes)

    def document(self) -> Document:
        """The motion as JSON-ready data, with all fields of its file."""
        legs = [{**vars(leg), "path": leg.path.saved(), "inputs": leg.inputs.saved()} for leg in self.legs]
        own = {name: getattr(self, name) for name in ("status", *CONTROL_NUMBERS, "iterations", "rounds", "parameters")}
        coarseness = None if np.isnan(self.coarseness) else self.coarseness
        bare = self.bare and self.bare.document()
        whole = {"format": Control.form(), **own, "coarseness": coarseness, "units": self.units or None}
        return {**whole, "legs": legs, "bare": bare}

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Control":
        data = Control._conform(document, Mapping[str, Any])
        bare, inner = data["bare"], ("bare", "machine", "statement")
        own = Control._fields_in({n: each for n, each in data.items() if each is not None and n not in inner})
        units, legs = own.pop("units", None), own["legs"]
        if (units is None) != (bare is None) or (units is not None and not {"cost", "time"} <= units.keys()):
            raise ValueError("its units do not fit its numbers")
        ends = np.cumsum([0.0, *(leg.duration for leg in legs)])
        if not legs or not np.allclose([leg.start for leg in legs], ends[:-1], rtol=1e-9, atol=1e-9 * ends[-1]):
            raise ValueError("its stages do not follow each other")
        bare = None if bare is None else Control.of_saved({**bare, "units": None, "bare": None})
        if bare is not None and [*map(_names_of, bare.legs)] != [*map(_names_of, legs)]:
            raise ValueError("its motions in SI and without units have other stages")
        return Control(**own, units={**_units_of(legs), **units} if units else {}, bare=bare)

    def title(self) -> str:
        return "motion of locally least cost"

    def _rows(self) -> Iterator[Row]:
        """The stages, the cost and the errors, and the work of the search."""
        unit = f" {self.units['cost']}" if self.units else ""
        for i, leg in enumerate(self.legs):
            times = {f"start of stage {i}": leg.start, f"duration of stage {i}": leg.duration}
            yield Row(leg.phase, times, (f"from {{:<12.8g}}for {{:.10g}}{self._second}",))
        costs = {"cost": self.cost, "violation": self.violation, "error": self.error}
        yield Row("cost", costs, (f"{{}}{unit}, violation {{:.1e}}, error {{:.1e}}",))
        counts = {"iterations": self.iterations, "rounds": self.rounds, "seconds": self.seconds}
        yield Row("found in", counts, ("{} iterations, {} rounds, {:.2f} s",))


def _names_of(leg: ControlledLeg) -> tuple[object, ...]:
    return leg.phase, leg.states, leg.path.names, leg.inputs.names


def _units_of(legs: tuple[ControlledLeg, ...]) -> dict[str, str]:
    """The units of SI of the states by name."""
    return {name: unit_text(dimension_of_state(name)) for leg in legs for name in leg.states}


def control_in_units(
    control: Control, units: Units, cost: Dimension, parameters: Mapping[str, float], own: Mapping[str, Dimension]
) -> Control:
    """A dimensionless motion in these units, with these parameters.

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
    states = {name: units.text(own.get(name) or name) for leg in control.legs for name in leg.states}
    texts = {**states, "cost": unit_text(cost), RUNNING_COST: unit_text(cost), "time": "s", **inputs}
    return replace(
        control, legs=legs, cost=control.cost * units.of(cost), parameters=parameters, units=texts, bare=control
    )
