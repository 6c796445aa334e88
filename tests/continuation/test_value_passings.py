"""Where a followed curve passes lines, against single orbits there."""

import numpy as np
import pytest

from orbits import find, follow
from orbits.continuation import checked_options, collected, passings, run_along_event
from problems import Hopper


@pytest.mark.slow
def test_the_masses_touch_where_a_curve_passes_lines():
    """On lines of both parameters, to rounding, in order along the curve, and at points of the curve itself."""
    machine = Hopper("r + beta*r**3", rest_length=9.0, parameters={"beta": 0.2})
    family = follow(machine, "beta", -0.006)
    run = run_along_event(family, "masses touch", "rest_length", 8.5, 0, None, False, checked_options(longest=0.1))
    points = collected(run).points
    xs, tangents = np.array([[*p.u, p.value] for p in points]), np.array([p.tangent for p in points])
    first, last = xs[[0, -1], -2]
    for place, values in ((-1, np.array([8.6, 9.0, 8.87])), (-2, np.array([0.3 * first + 0.7 * last]))):
        where, found, directions = passings(run.curve, xs, tangents, place, values)
        assert sorted(found[:, place]) == sorted(values)
        assert (np.diff(where) > 0).all()
        assert (where <= len(xs) - 1).all()
        assert (np.einsum("ij,j->i", directions[:, -2:], xs[-1, -2:] - xs[0, -2:]) > 0).all()
        for beta, rest_length in found[:, -2:].tolist():
            orbit = find(machine.with_values(beta=beta, rest_length=rest_length))
            assert orbit.certificate.smallest_separation == pytest.approx(0.0, abs=1e-11)
