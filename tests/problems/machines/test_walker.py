"""A walker against published equations that were solved elsewhere, closed forms, and its conditions integrated here."""

import numpy as np
import pytest

from orbits import find
from problems import walker

TUNE = ("torso_inertia", "hip_stiffness")
# Designs with their step angle, the solution of two programs in other coordinates: rates in mid-stance, half times of
# single and double stance, and the tuned numbers.
KNOWN = [
    (
        {"leg_mass": 0.1, "leg_centre": 1.0, "leg_inertia": 0.0, "torso_height": 0.0},
        0.3, (0.093394720911678, -1.5619009862584996, -0.5297977502514608), 2.3901085903795560, 0.4044357111253,
        (0.41824193818688386, 0.39402694221511943),
    ),
    (
        {"leg_mass": 0.05, "leg_centre": 0.5, "leg_inertia": 0.05 / 12, "torso_height": 0.2},
        0.2, (0.129029428982737, -0.793348702896021, -0.381185176861880), 2.615125701614618, 0.4711610002383,
        (0.266701219273255, 0.311268251173758),
    ),
]  # fmt: skip


@pytest.fixture(scope="module", params=range(len(KNOWN)))
def known(request):
    design, angle, *figures = KNOWN[request.param]
    machine = walker(**design, torso_inertia=round(figures[3][0], 2), hip_stiffness=round(figures[3][1], 2))
    return find(machine, tune=TUNE, at={"angle": angle}), angle, *figures


def test_it_is_the_walker_that_two_programs_found(known):
    walk, angle, rates, single, double, tuned = known
    assert walk.admissible, walk.violations
    np.testing.assert_allclose(walk.rates, rates, rtol=0, atol=1e-11)
    assert walk.half_stance == pytest.approx(single, abs=1e-11)
    assert walk.half_double_stance == pytest.approx(double, abs=1e-11)
    assert [*walk.tuned.values()] == pytest.approx(tuned, abs=1e-11)
    assert walk.step == pytest.approx(2 * np.sin(angle), abs=1e-13)
    assert walk.mean_speed == pytest.approx(walk.step / (2 * (single + double)), abs=1e-11)
