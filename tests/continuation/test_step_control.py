"""The constants of step-size control: what they change, and what they cannot be."""

from dataclasses import FrozenInstanceError, fields
from functools import cache

import numpy as np
import pytest
from conftest import PROVED, middle

from orbits import InputError, follow
from orbits.continuation import StepControl
from problems import Hopper

ALPHA = middle(PROVED["cubic"]["1"]["alpha"])


@cache
def cubic(stop: float = 1.0, longest: float = 0.2, **constants):
    return follow(Hopper("cubic"), "beta", stop, 0.0, longest=longest, step_control=StepControl(**constants))


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"first_step": 2.0}, r"step_control.first_step = 2.0; it must be a number from 1e-08 to 1"),
        ({"largest_turn": np.nan}, "step_control.largest_turn = nan; it must be a number from"),
        ({"safety": "a"}, "step_control.safety = 'a'; it must be a number from"),
        ({"largest_batch": 2.5}, "step_control.largest_batch = 2.5; it must be a number of"),
        ({"neighbours": 9}, "step_control.neighbours = 9; it must be a number of points or steps, from 1 to 8"),
        (
            {"shortest_step": 1e-2},
            "first_step = 0.005: it must lie between shortest_step = 0.01 and longest_step",
        ),
        ({"longest_step": 1e-3}, "first_step = 0.005: it must lie between .* longest_step = 0.001"),
    ],
)
def test_bad_constants_are_refused(constants, message):
    with pytest.raises(InputError, match=message):
        StepControl(**constants)


def test_they_are_keywords_documented_and_fixed():
    control = StepControl()
    with pytest.raises(TypeError):
        StepControl(5e-3)
    with pytest.raises(FrozenInstanceError):
        control.first_step = 1e-3
    assert all(knob.name in StepControl.__doc__ for knob in fields(control))
    with pytest.raises(InputError, match="it must be a StepControl"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, step_control={"first_step": 1e-3})
    with pytest.raises(InputError, match=r"it must be a share of the way, from 0\.01 to 1"):
        cubic(longest=1e-3, shortest_step=1e-3)


@pytest.mark.parametrize(
    "constants",
    [{"target_correction": 1e-9}, {"largest_correction": 1e-3}, {"largest_turn": 0.05}, {"longest_step": 0.02}],
    ids=lambda constants: next(iter(constants)),
)
def test_stricter_control_takes_more_steps_along_the_same_curve(constants):
    strict, usual = cubic(longest=0.2 if "longest_step" not in constants else 0.02, **constants), cubic()
    assert len(strict) > len(usual)
    assert strict[-1].alpha == pytest.approx(ALPHA, rel=1e-13)
    assert usual[-1].alpha == pytest.approx(ALPHA, rel=1e-13)


def test_the_first_step_is_as_long_as_asked_for():
    short, long = (cubic(first_step=length)[1].value for length in (1e-3, 1e-2))
    assert long == pytest.approx(10 * short, rel=0.1)
