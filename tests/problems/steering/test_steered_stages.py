"""The stages of steered motions, as `steer` takes them."""

import numpy as np
import pytest

from orbits import find
from problems import Actuated, Hopper
from problems.steering.actuator_bounds import actuator_limits
from problems.steering.steered_stages import CONTACT_FORCE_MARGIN, swing_stages

BOUNDS = {"rate": 1.0, "stroke": np.inf, "force": np.inf, "power": np.inf}


def test_swings_keep_the_contact_pressed_until_the_last():
    driven, orbit = Actuated(Hopper()), find(Hopper())
    limits = actuator_limits(driven, **BOUNDS)
    stages = swing_stages(driven.drive, 2, 3, limits, float(orbit.contact_time))
    assert [[*stage.path][-1] for stage in stages] == ["fall", "rise", "fall", "rise"]
    x, p = [0.3, 0.0, 0.0], {**driven.values, "aim": 4.0}
    forces = [float(stage.path["contact force"](x, p, [])) for stage in stages]
    assert forces == pytest.approx([0.7 - CONTACT_FORCE_MARGIN] * 3 + [0.7], abs=1e-15)
    assert [float(each) for each in stages[-1].end([1.0, 4.0, 0.0], p)] == pytest.approx([0.0] * 3, abs=1e-15)
