"""Guesses of motions, and the unknowns of the nonlinear program that they mean."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, finite_number
from .motion import Control, ControlledLeg
from .stage import Stage
from .transcription import StageUnknowns, Transcription

# Inputs are sampled this share of an interval away from its ends, since a guess may jump there.
INSET = 1e-9


@dataclass(frozen=True)
class Guess:
    """A start for a stage: its duration, its states as a function of the time in it, and its inputs by name, each a
    number or a function of that time."""

    duration: float
    states: Callable[[float], ArrayLike]
    inputs: Mapping[str, float | Callable[[float], float]] = field(default_factory=dict)


def unknowns_of_guess(problem: Transcription, guess, free: Mapping, bounds) -> np.ndarray:
    """The unknowns (n,) of a problem that a guess means, a `Guess` for each stage or a `Control`; `free` names the free
    parameters, and `bounds` are those of all unknowns."""
    given = guess.legs if isinstance(guess, Control) else guess
    if not isinstance(given, tuple | list) or not all(isinstance(one, Guess | ControlledLeg) for one in given):
        raise InputError(f"guess = {guess!r}; it is a Guess for each stage, or a Control")
    if len(given) != len(problem.stages):
        raise InputError(f"the guess has {len(given)} stages where there are {len(problem.stages)}")
    parts = [_sampled(stage, one) for stage, one in zip(problem.stages, given, strict=True)]
    low, high = (bound[len(bound) - len(free) :] for bound in bounds)
    middle = np.where(np.isfinite(low + high), 0.5 * (low + high), np.where(np.isfinite(low), low, high))
    middle = np.where(np.isfinite(middle), middle, 0.0)
    parameters = guess.parameters if isinstance(guess, Control) else {}
    x = problem.pack(parts, [parameters.get(name, value) for name, value in zip(free, middle, strict=True)])
    if not np.isfinite(x).all():
        raise InputError("the guess is not finite everywhere")
    return x


def _sampled(stage: Stage, guess: Guess | ControlledLeg) -> StageUnknowns:
    """The unknowns of a stage that a guess of it means."""
    where = f"the guess of the {stage.phase.name}"
    if isinstance(guess, ControlledLeg):
        guess = _guess_of_leg(guess, len(stage.phase.states))
    else:
        finite_number(f"{where}: duration", guess.duration)
        if strange := guess.inputs.keys() - stage.inputs.keys():
            raise InputError(f"{where} is of an input '{min(strange)}': it has none such")
    size, n, duration = len(stage.phase.states), stage.intervals, guess.duration
    nodes = np.array([np.asarray(guess.states(t), dtype=float) for t in np.linspace(0, duration, n + 1)])
    if nodes.shape != (n + 1, size):
        raise InputError(f"{where} is not {size} numbers, {', '.join(stage.phase.states)}")
    rows = []
    for name, given in stage.inputs.items():
        value = guess.inputs.get(name, 0.0)
        for share in np.linspace(INSET, 1 - INSET, given.degree + 1) if given.degree else (0.5,):
            times = (np.arange(n) + share) * duration / n
            rows.append([float(value(t)) if callable(value) else float(value) for t in times])
    return StageUnknowns(duration, nodes.T, np.array(rows).reshape(-1, n))


def _guess_of_leg(leg: ControlledLeg, size: int) -> Guess:
    """A guess with the `size` states and the inputs of a leg."""

    def input_of(i: int) -> Callable[[float], float]:
        return lambda t: leg.inputs(t)[i]

    inputs = {name: input_of(i) for i, name in enumerate(leg.inputs.names)}
    return Guess(leg.duration, lambda t: leg.path(t)[:size], inputs)
