"""The first orbit of a family, led from the scene in which the model guesses it to the scene that is asked for."""

from collections.abc import Callable, Mapping

import numpy as np

from ..errors import NoOrbit
from ..model.model import Model
from ..numerics.roots import solve
from .admissibility import count_families
from .formulations import vector
from .interpretation import halved
from .newton import Evaluation
from .single_shooting import Shooting

# With a step size below this share of the homotopy, the family has folded back or ended.
MIN_STEP = 1e-4
# A corrector that changes the launch speed or the time by a larger share may have jumped to another orbit.
MAX_CORRECTION = 0.1
# The tangent is differenced over this share of the homotopy: a predictor needs no more digits, and a derivative by the
# homotopy parameter would take longer to build.
DIFFERENCE = 1e-6

# (u, parameters) -> the solution near u, and the equations there.
Corrector = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, Evaluation]]


def solve_by_homotopy(
    model: Model,
    equations: Shooting,
    correct: Corrector,
    family: int,
    p: Mapping[str, float],
    progress: Callable[[float], None] | None = None,
) -> tuple[np.ndarray, Evaluation]:
    """Solve a model's equations from its guess, with the homotopy parameter led from 0 to 1 by step-size control.

    progress : called with each value that the homotopy parameter has reached

    Returns the unknowns (n,) and the equations there. Raises `NoOrbit` when the orbit cannot be followed to the end.
    """
    unknowns, homotopy = equations.statement.unknowns, model.homotopy
    start = dict(model.guess(family, {**p, homotopy: 0.0} if homotopy else p))
    flight_time = start["duration"] * (2 if "unfolding" in unknowns else 1)
    start |= {"duration": flight_time, "unfolding": 0.0}
    u = np.array([start[name] for name in unknowns])
    if homotopy is None:
        return correct(u, vector(p))
    reached, step = 0.0, 1.0
    u, evaluation = correct(u, vector({**p, homotopy: 0.0}))
    while reached < 1:
        ahead = equations.evaluate(u, vector({**p, homotopy: reached + DIFFERENCE}))
        tangent = solve(evaluation.jacobian[0], (evaluation.residual[0] - ahead.residual) / DIFFERENCE)
        step = min(step, 1 - reached)
        while True:
            value = 1.0 if step == 1 - reached else reached + step
            predicted, p_ahead = u + step * tangent, {**p, homotopy: value}
            try:
                u, evaluation = _corrected(model, equations, correct, predicted, family, p_ahead)
                break
            except NoOrbit as error:
                step /= 2
                if step < MIN_STEP:
                    raise NoOrbit(
                        f"no lossless orbit of family {family}: with {100 * reached:.3g}% of gravity's variation it is "
                        f"at alpha = {u[unknowns.index('alpha')]:.6g}, and it cannot be followed further ({error})"
                    ) from None
        reached, step = value, 2 * step
        if progress:
            progress(reached)
    return u, evaluation


def _corrected(
    model: Model, equations: Shooting, correct: Corrector, predicted: np.ndarray, family: int, p: Mapping[str, float]
) -> tuple[np.ndarray, Evaluation]:
    """The solution near a predicted point; raises `NoOrbit` where it is far from it or of another family."""
    unknowns = equations.statement.unknowns
    positive = [unknowns.index(name) for name in ("alpha", "duration")]
    if not (predicted[positive] > 0).all():  # this refuses NaN too
        raise NoOrbit("the step leads to a negative time or speed")
    new, evaluation = correct(predicted, vector(p))
    if np.max(np.abs(new - predicted)[positive] / np.abs(new[positive])) > MAX_CORRECTION:
        raise NoOrbit("the corrector ends far from the predicted orbit")
    flight = evaluation.trajectories[0].only(model.flight.states)
    halves = halved(flight) if "unfolding" in unknowns else flight
    if count_families(model, halves, len(halves)) != [family]:
        raise NoOrbit("the family changes")
    return new, evaluation
