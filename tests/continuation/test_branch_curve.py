"""Curves of branch points, against the search at a design that they reach."""

import numpy as np
import pytest

from orbits import InputError, find_branch_points, follow_branch_points
from problems import runner

REACHED = 3.852290512097638  # 1 longer than a leg that is pressed to length 0


@pytest.fixture(scope="module")
def point():
    return find_branch_points(runner(), {"inertia": (6.0, 8.0), "hip_stiffness": (5.0, 6.0)}, designs=6)[0]


@pytest.mark.slow
def test_rest_length(point):
    curve = follow_branch_points(point, "rest_length", (3.707978, REACHED))
    values = [[*each.values.values()] for each in curve]
    # The first as in the tests of the search, by DOP853; the second of another program with six digits.
    np.testing.assert_allclose(values[0], (7.0824419372526, 5.5255512874429), rtol=1e-11)
    np.testing.assert_allclose(values[1], (5.83340, 5.70933), atol=6e-6)
    assert [each.machine.values["rest_length"] for each in curve] == [3.707978, REACHED]
    assert all(each.hop.admissible for each in curve)


@pytest.mark.slow
def test_it_ends(point):
    lengths = [3.6, 3.0]
    curve = follow_branch_points(point, "rest_length", lengths)
    assert len(curve) == 1
    assert follow_branch_points(point, "rest_length", [1e308]) == ()


@pytest.mark.slow
def test_names_are_refused(point):
    with pytest.raises(InputError, match="'inertia' is a parameter of the branch point"):
        follow_branch_points(point, "inertia", [7.0])
    with pytest.raises(InputError, match="foot_width"):
        follow_branch_points(point, "foot_width", [7.0])
