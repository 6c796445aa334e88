"""Solutions that are certified together, against each alone."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from orbits import find
from orbits.continuation import Options
from orbits.continuation.curve import Curve
from orbits.continuation.family_problem import FamilyProblem
from orbits.curves import Border, correct
from problems import Hopper


def test_whole_flights_certified_together():
    """Of models without a reversor, two parts of each flight in turn: against half of each by time reversal."""
    machine = Hopper("cubic", rest_length=4.0, parameters={"beta": 0.3})
    object.__setattr__(machine, "model", replace(machine.model, reversor=None, reduction=None))
    ratios = [0.7, 1.0, 3.0, 8.0]  # of the first the masses meet
    mirrored = [find(Hopper("cubic", mass_ratio=M, rest_length=4.0, parameters={"beta": 0.3}), 2) for M in ratios]
    problem = FamilyProblem(Curve(machine, "mass_ratio", "shooting", 10.0), Options())
    xs = np.array(
        [[o.liftoff_extension, o.alpha, o.flight_time, 0.0, M] for o, M in zip(mirrored, ratios, strict=True)]
    )
    border = Border.of_component(4, xs[:, 4], 5)
    points, errors = problem.certify(correct(problem, np.zeros(4, int), xs, border, border.rows, problem.steps)[1])
    assert not errors
    for point, orbit in zip(points.own, mirrored, strict=True):
        assert point.alpha == pytest.approx(orbit.alpha, rel=1e-12)
        assert point.flight_time == pytest.approx(orbit.flight_time, rel=1e-12)
        assert point.contact_time == pytest.approx(orbit.contact_time, rel=1e-12)
        mine, theirs = asdict(point.certificate), asdict(orbit.certificate)
        for name in ("family", "stable_side", "bounce_side", "violations"):
            assert mine[name] == theirs[name], name
        for name in ("clearance", "smallest_separation", "largest_contact_force", "landing_jerk", "loss_coefficient"):
            assert mine[name] == pytest.approx(theirs[name], rel=1e-7, abs=1e-10), name
