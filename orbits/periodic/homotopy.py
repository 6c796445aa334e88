"""Orbits from guesses: under varying gravity by a homotopy from constant gravity."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..model import Model
from ..numerics import solve
from ..result import Progress
from ..shooting import Evaluation, Shooting, halved, vector
from ..units import LIFTOFF_SPEED, Message, Quantity
from .guess import guess
from .motion_conditions import count_families


class HomotopySteps(NamedTuple):
    """Steps of the homotopy parameter, from 0 to 1."""

    first: float = 1.0
    # Where a step of the shortest length is rejected, the family has folded back or ended.
    shortest: float = 1e-4
    shorter: float = 0.5  # ratio of a step to the rejected one before it
    lengthen: float = 2.0  # ratio of a step to the accepted one before it
    moved: float = 0.1  # a corrector that changes the launch speed or the time by more may have jumped to another orbit
    # Where the corrector knows no derivative by the parameter, the tangent is differenced over this share of it: a
    # predictor needs no more digits.
    difference: float = 1e-5


STEPS_OF_HOMOTOPY = HomotopySteps()


def solve_by_homotopy(
    model: Model, equations: Shooting, correct: Callable, family: int, p: Mapping[str, float],
    progress: Progress, steps: HomotopySteps = STEPS_OF_HOMOTOPY,
) -> tuple[np.ndarray, Evaluation]:  # fmt: skip
    """The solution (n,) of a model's equations from its guess, and the equations there, by a homotopy parameter from 0
    to 1 by step-size control.

    correct : (u, parameters) -> the solution near u and the equations there
    progress : called with the share that is done

    Raises `NoOrbit` where there is none, or where it cannot be followed.
    """
    unknowns, homotopy = equations.statement.unknowns, model.homotopy
    start = {**guess(model, family, {**p, homotopy: 0.0} if homotopy else p), "unfolding": 0.0}
    start["duration"] *= 2 if "unfolding" in unknowns else 1
    u = np.array([start[name] for name in unknowns])
    if homotopy is None:
        u, evaluation = correct(u, vector(p))
        return u, evaluation.of_unknowns(len(u))
    reached, step = 0.0, steps.first
    u, evaluation = correct(u, vector({**p, homotopy: 0.0}))
    while reached < 1:
        if len(unknowns) < evaluation.jacobian.shape[2]:
            slope = evaluation.jacobian[0, :, -1]
        else:
            ahead = equations.evaluate(u, vector({**p, homotopy: reached + steps.difference}))
            slope = (ahead.residual - evaluation.residual[0]) / steps.difference
        tangent = solve(evaluation.jacobian[0, :, : len(unknowns)], -slope)
        step = min(step, 1 - reached)
        while True:
            value = 1.0 if step == 1 - reached else reached + step
            try:
                p_ahead = {**p, homotopy: value}
                u, evaluation = _corrected(model, equations, correct, u + step * tangent, family, p_ahead, steps.moved)
                break
            except NoOrbit as error:
                step *= steps.shorter
                if step < steps.shortest:
                    text = (
                        "no lossless orbit of family {family}: with {percent:.3g}% of gravity's variation it is at "
                        "alpha = {alpha:.6g}, and it cannot be followed further ({error})"
                    )
                    alpha = Quantity(float(u[unknowns.index("alpha")]), LIFTOFF_SPEED)
                    raise NoOrbit(
                        Message(text, family=family, percent=100 * reached, alpha=alpha, error=error)
                    ) from None
        reached, step = value, steps.lengthen * step
        if progress:
            progress(reached)
    return u, evaluation.of_unknowns(len(u))


def _corrected(
    model: Model, equations: Shooting, correct, predicted, family, p, most: float
) -> tuple[np.ndarray, Evaluation]:
    """The solution near a predicted point; raises `NoOrbit` where it is of another family, or where the corrector
    changes the speed or the time by more than the largest share."""
    unknowns = equations.statement.unknowns
    positive = [unknowns.index(name) for name in ("alpha", "duration")]
    if not (predicted[positive] > 0).all():  # this refuses NaN too
        raise NoOrbit("the step leads to a negative time or speed")
    new, evaluation = correct(predicted, vector(p))
    if np.max(np.abs(new - predicted)[positive] / np.abs(new[positive])) > most:
        raise NoOrbit("the corrector ends far from the predicted orbit")
    flights = evaluation.trajectories[0].only(model.flight.states)
    halves = halved(flights) if "unfolding" in unknowns else flights
    if count_families(model, halves, len(halves))[0] != family:
        raise NoOrbit("the family changes")
    return new, evaluation
