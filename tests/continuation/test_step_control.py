"""The constants of step-size control: what they change, and what they cannot be."""

from dataclasses import FrozenInstanceError, fields
from functools import cache

import numpy as np
import pytest
from conftest import PROVED, middle

from orbits import InputError, follow, follow_fold, trace
from orbits.continuation import StepControl
from problems import Hopper

ALPHA = middle(PROVED["cubic"]["1"]["alpha"])


@cache
def cubic(stop: float = 1.0, longest: float = 0.2, **constants):
    return follow(Hopper("cubic"), "beta", stop, 0.0, longest=longest, step_control=StepControl(**constants))


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"first_step": 2.0}, r"step_control.first_step = 2.0; it is a number from 1e-08 to 1"),
        ({"largest_turn": np.nan}, "step_control.largest_turn = nan; it is a number from"),
        ({"safety": "a"}, "step_control.safety = 'a'; it is a number from"),
        ({"largest_batch": 2.5}, "step_control.largest_batch = 2.5; it is a number of"),
        ({"neighbours": 9}, "step_control.neighbours = 9; it is a number of points or steps, from 1 to 8"),
        (
            {"shortest_step": 1e-2},
            "first_step = 0.005: it lies between shortest_step = 0.01 and longest_step",
        ),
        ({"longest_step": 1e-3}, "first_step = 0.005: it lies between .* longest_step = 0.001"),
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
    with pytest.raises(InputError, match="it is a StepControl"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, step_control={"first_step": 1e-3})
    with pytest.raises(InputError, match=r"it is a share of the way, from 0\.01 to 1"):
        cubic(longest=1e-3, shortest_step=1e-3)


@pytest.mark.parametrize(
    "constants",
    [{"target_correction": 1e-9}, {"largest_correction": 1e-3}, {"largest_turn": 0.01}, {"longest_step": 0.02}],
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


def test_a_run_gives_up_after_the_rejections_allowed():
    """Towards a massless foot the machine ceases to be one: the run ends sooner where fewer rejections are allowed."""
    ends = [follow(Hopper("r"), "mass_ratio", -1.0, step_control=StepControl(most_rejections=most)) for most in (0, 16)]
    assert [family.end.kind for family in ends] == ["degenerate", "degenerate"]
    assert ends[0][-1].value >= ends[1][-1].value


@pytest.mark.slow
def test_a_curve_escapes_sooner_where_less_is_asked_of_it():
    near, far = (
        follow(Hopper("tanh"), "b", 0.9, 0.05, step_control=StepControl(escape_ratio=ratio)) for ratio in (20.0, 40.0)
    )
    assert near.end.kind == far.end.kind == "escaped"
    assert len(near) < len(far)
    assert near.end.limit == pytest.approx(1 / 3, abs=1e-4)


@pytest.mark.slow
def test_every_way_along_a_curve_takes_them():
    machine = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": 0.0, "delta": 0.0})
    fold = next(event.point for event in follow(machine, "beta", -0.02, -0.009, most=40).events if event.kind == "fold")

    def second_values(length: float):
        options = {"most": 3, "step_control": StepControl(first_step=length)}
        _, orbit, *_ = trace(machine, "beta", 1.0, **options)
        yield orbit.machine["parameters"]["beta"]
        yield follow_fold(machine, fold, "beta", "delta", 3e-5, **options)[1].value

    assert list(second_values(1e-2)) == pytest.approx([10 * value for value in second_values(1e-3)], rel=0.1)
