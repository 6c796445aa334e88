"""The options of runs along curves."""

import numpy as np
import pytest

from orbits.curves import Steps
from orbits.errors import InputError


@pytest.mark.parametrize(("options", "message"), [
    ({"safety": 1.5}, r"steps.safety = 1.5; it must be a number from 0.01 to 1"),
    ({"aim": float("nan")}, r"steps.aim = nan; it must be a number from 1e-14 to 1"),
    ({"turned": True}, r"steps.turned = True; it must be a number"),
    ({"batch": 0}, r"steps.batch = 0; it must be a number of points or steps, from 1 to 100000"),
    ({"memory": 2.0}, r"steps.memory = 2.0; it must be a number of points or steps"),
    ({"longest": 1e-6}, r"the longest step above the shortest"),
    ({"apart": 0.0}, r"lengths must be above 0"),
    ({"first": 1e-5}, r"steps.first = 1e-05; it must be above the shortest step, 1e-05"),
    ({"first": 0.3}, r"steps.first = 0.3; it must be above the shortest step, 1e-05, up to the longest one, 0.2"),
])  # fmt: skip
def test_wrong_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Steps(**options)


def test_the_next_step_would_have_the_error_that_is_aimed_at():
    """A prediction from two points has an error of order 4: a step half as long has a 16th of it."""
    steps = Steps(aim=1e-6, safety=1.0, shorten=0.25, lengthen=4.0)
    ratios = steps.ratios(np.array([16e-6, 1e-6, 0.0, 1.0]), np.array([2, 3, 4, 1]))
    assert ratios == pytest.approx([0.5, 1.0, 4.0, 0.25], rel=1e-14)
