"""The claim of a family that its orbits form one continuous curve, as input to its proof."""

from collections.abc import Sequence

import numpy as np

from ..curves import Border, correct
from ..errors import InputError, NoStep
from ..exact import Claim
from ..model import Machine
from ..proof import BranchClaim
from ..records import numbers_or_nan
from .curve import Curve
from .family_problem import FamilyProblem
from .point import Point
from .step_control import Options


def branch_claim(
    machine: Machine, along: str, method: str, names: Sequence[str], points: Sequence[Point], ends: tuple[Claim, Claim]
) -> BranchClaim:
    """The claim of points in order along a curve.

    names : of the unknowns of the points
    ends : the claims of the first and the last point

    Raises `InputError` for fewer than two points, for a machine in SI, and where further parameters vary.
    """
    if machine.units is not None:
        raise InputError(
            "a curve can be proved only for a dimensionless machine: follow and prove machine.dimensionless()"
        )
    rows = [np.append(point.u, point.value) for point in points]
    chosen = [i for i in range(len(rows)) if i == 0 or not np.array_equal(rows[i], rows[i - 1])]
    if len(chosen) < 2:
        raise InputError("a curve needs at least two points; this family has fewer")
    if any(point.also for point in points):
        raise InputError("a curve is proved along one parameter, but others vary along this family")
    xs, tangents = np.array([rows[i] for i in chosen]), np.array([points[i].tangent for i in chosen])
    problem = FamilyProblem(Curve(machine, along, method, float(np.ptp(xs[:, -1])) or 1.0), Options())

    def solve(coordinate: int, values: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        border = Border.of_component(coordinate, values, xs.shape[1])
        which, points = correct(problem, np.zeros(len(values), int), guesses, border, border.rows, problem.steps)
        if len(which) < len(values):
            raise NoStep("the corrector does not converge")
        points, errors = problem.certify(points)
        if errors:
            raise errors[min(errors)]
        return points.xs, numbers_or_nan(points.own.column("contact_time")) / 2

    return BranchClaim(machine, along, *ends, (*names, along), xs, tangents, solve)
