"""Motions found by optimal control: their legs, and what the next solve may start from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from ..flow.trajectory import Trajectory
from ..hybrid.simulation import Leg
from .transcription import Multipliers, Transcription


@dataclass(frozen=True)
class ControlledLeg(Leg):
    """One stage of a motion: its phase's name, its start, its motion from there, and its inputs, which are polynomials
    of the time since the start as well. Rows of the motion are the states, then the path expressions."""

    inputs: Trajectory

    @property
    def duration(self) -> float:
        """Duration of the stage."""
        return float(self.path.times[-1])


@dataclass(frozen=True)
class WarmStart:
    """The point from which the next solve starts: a problem with its unknowns and multipliers.

    shares : the share of its interval at which each exchange point of the problem lies
    unit : unit of the cost, which brings it to order one, since Ipopt's tolerances are absolute
    """

    problem: Transcription
    x: np.ndarray
    multipliers: Multipliers | None
    shares: np.ndarray
    unit: float = 1.0

    def rescaled(self, unit: float) -> "WarmStart":
        """The same with the cost in another unit."""
        if self.multipliers is None:
            return replace(self, unit=unit)
        factor = self.unit / unit
        bound, held = self.multipliers
        return replace(self, unit=unit, multipliers=(factor * bound, factor * held))


@dataclass(frozen=True)
class Control:
    """A motion of locally least cost. Another guess may lead to one that costs less.

    legs : the stages in order
    cost : cost of the accurate motion
    parameters : all parameters by name, those left free with the values found
    violation : the most by which the accurate motion misses a condition, leaves a bound, or falls below zero in a path
        expression
    error : the most by which the states of the accurate motion, relative to their size, or its cost differ from those
        of the nonlinear program
    coarseness : the share of the cost by which the last halving of the intervals changed it, NaN if they were kept.
        Violation and error are those of this motion and do not say what finer inputs would save
    iterations, rounds : Ipopt's iterations, and the solves in which they were taken
    seconds : time taken in all
    status : "optimal"; anything else is raised as an error
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

    @property
    def durations(self) -> np.ndarray:
        """Durations of the stages."""
        return np.array([leg.duration for leg in self.legs])

    def schedule(self, *names: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The times (k + 1,) at which piecewise constant inputs change, and their values (k,) in between, 0 where a
        stage does not have them, as `simulate` takes them.

        Raises `InputError` for a name that is no input, and for an input that varies within an interval.
        """
        if strange := set(names).difference(*(leg.inputs.names for leg in self.legs)):
            raise InputError(f"there is no input '{min(strange)}'")
        rows = {name: [_input_column(leg.inputs, name) for leg in self.legs] for name in names}
        if varying := [name for name, columns in rows.items() if any(c[:, 1:].any() for c in columns)]:
            raise InputError(f"input '{varying[0]}' varies within an interval: it is no schedule; give it degree 0")
        times = np.concatenate([leg.start + leg.inputs.times[:-1] for leg in self.legs] + [[self.end]])
        return times, {name: np.concatenate([c[:, 0] for c in columns]) for name, columns in rows.items()}

    @property
    def end(self) -> float:
        """The time at which the last stage ends."""
        return self.legs[-1].start + self.legs[-1].duration

    def __str__(self) -> str:
        rows = [f"  {leg.phase:<12}from {leg.start:<12.8g}for {leg.duration:.10g}" for leg in self.legs]
        found = f"  cost {self.cost:.12g}, violation {self.violation:.1e}, error {self.error:.1e}"
        return "\n".join([*rows, found, f"  {self.iterations} iterations, {self.rounds} rounds, {self.seconds:.2f} s"])


def _input_column(inputs: Trajectory, name: str) -> np.ndarray:
    """Coefficients (N, K + 1) of an input on each interval, 0 where the stage does not have it."""
    return inputs.row(name) if name in inputs.names else np.zeros((len(inputs.steps), 1))
