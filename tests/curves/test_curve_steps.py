"""Steps along curves in closed form, and the points between their ends."""

import numpy as np
from plane_curves import Formula, circle, found_by, run_of

from orbits.curves import Steps, started
from orbits.curves.curve_steps import Tails, step

FAR = np.array([[-np.inf, np.inf]])


def first_step(problem, start, lengths, bounds, options):
    """A step of each lane from its start."""
    first = started(problem, np.array(start, float), options)
    bounds = np.broadcast_to(bounds, (len(first), 2))
    return step(problem, first.lanes, Tails.of([first], first.lanes, 4), np.array(lengths), bounds, options)


def test_a_step_with_a_large_correction_a_large_turn_or_a_prediction_off_the_tangent_is_rejected():
    for options in (Steps(), Steps(corrected=1.0, turned=0.1), Steps(corrected=1.0, moved=1e-3)):
        taken = first_step(Formula(circle), [[1.0, 0.0]], [0.2], FAR, options)
        assert (len(taken.ends), taken.lengths.tolist()) == (0, [0.1])


def test_neighbouring_points_are_as_near_as_they_should_be_and_make_room_for_requested_values():
    xs, _, _ = found_by(run_of(
        Formula(circle), (1.0, 0.0), stop=2.0, behind=-2.0, at=[0.301], options=Steps(apart=0.01)
    ))  # fmt: skip
    gaps = np.linalg.norm(np.diff(xs, axis=0), axis=1)
    assert gaps.max() <= 0.01 * 1.02
    assert gaps[:-1].min() > 0.1 * 0.004  # only the last one, at which the curve closes, may be shorter
