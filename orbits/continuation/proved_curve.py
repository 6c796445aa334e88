"""The claim of a family that its orbits form one continuous curve, as input to its proof."""

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..exact.claim import Claim
from ..model.machine import Machine
from ..proof.branch_claim import BranchClaim
from ..records import numbers_or_nan
from .corrector import correct_all
from .curve import Curve, CurvePoints
from .point import Point


def branch_claim(
    machine: Machine, along: str, method: str, names: Sequence[str], points: Sequence[Point], ends: tuple[Claim, Claim]
) -> BranchClaim:
    """The claim of points in order along a curve.

    names : of the unknowns of the points
    ends : the claims of the first and the last point

    Raises `InputError` for fewer than two points, for a machine in SI, and where further parameters vary.
    """
    if machine.units is not None:
        raise InputError("a curve is proved of a dimensionless machine: follow and prove machine.dimensionless()")
    rows = [np.append(point.u, point.value) for point in points]
    chosen = [i for i in range(len(rows)) if i == 0 or not np.array_equal(rows[i], rows[i - 1])]
    if len(chosen) < 2:
        raise InputError("a curve has two points at least: this family has fewer")
    if any(point.also for point in points):
        raise InputError("a curve is proved along one parameter, and others vary along this family")
    xs, tangents = np.array([rows[i] for i in chosen]), np.array([points[i].tangent for i in chosen])
    curve = Curve(machine, along, method, float(np.ptp(xs[:, -1])) or 1.0)

    def solve(coordinate: int, values: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = np.tile(np.eye(xs.shape[1])[coordinate], (len(values), 1))
        solved = correct_all(curve, guesses, rows, values, rows)
        certified, error = curve.certify_all(solved)
        if error is not None:
            raise error
        return solved.xs, numbers_or_nan(CurvePoints.of(certified).orbits.column("contact_time")) / 2

    return BranchClaim(machine, along, *ends, (*names, along), xs, tangents, solve)
