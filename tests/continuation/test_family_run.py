"""A run along a curve: the same at half the step, its points solved together, and little memory."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import follow
from problems import Hopper
from studies.random_families import differences, random_springs, share_of_error, twice


@pytest.mark.parametrize(
    ("machine", "along", "stop"),
    [
        pytest.param(Hopper("cubic", parameters={"beta": 0.0}), "beta", -0.02, marks=pytest.mark.slow),
        pytest.param(
            Hopper("r + c*r**2 + d*r**3", parameters={"c": 0.0, "d": -0.003}), "c", 0.2, marks=pytest.mark.slow
        ),
        (Hopper("r", "1/(1 + k*z)**2", rest_length=20.0, parameters={"k": 0.0}), "k", 0.05),
        (Hopper("bilinear", parameters={"ratio": 1.0}), "ratio", 5.0),
        (Hopper("toda", parameters={"b": 0.01}), "b", 0.45),
    ],
    ids=["cubic", "quadratic", "hopper in gravity", "bilinear", "toda"],
)
def test_half_the_step_gives_the_same_curve(machine, along, stop):
    """Both families have equal events, and equal orbits wherever the parameter has the same value."""
    start = machine.values[along]
    at = np.linspace(start, stop, 7)[1:-1]
    one, two = (follow(machine, along, stop, at=at, longest=step) for step in (0.03, 0.015))
    assert len(two) > 1.2 * len(one)
    assert one.end.kind == two.end.kind
    assert [event.kind for event in one.events] == [event.kind for event in two.events]
    for a, b in zip(one.events, two.events, strict=True):
        assert a.point.value == pytest.approx(b.point.value, rel=1e-10)
        assert a.point.alpha == pytest.approx(b.point.alpha, rel=1e-7 if a.kind == "fold" else 1e-10)


@pytest.mark.parametrize(
    ("text", "parameters", "family"),
    slow_after(1, random_springs(3, seed=7)),
)
def test_random_families_keep_to_their_curve(text, parameters, family):
    curves = twice(text, parameters, family)
    assert curves is None or not differences(*curves, family)


@pytest.mark.slow
def test_launch_speeds_are_within_their_errors_where_the_range_is_wide():
    """The range is two million times as wide as the parameter; quadrature in 40 digits is the truth."""
    machine = Hopper("r + d*r**5", rest_length=90.0, parameters={"d": -5e-8})
    family = follow(machine, "d", -0.1, family=10, longest=0.1)
    assert [event.kind for event in family.events] == ["collapse", "fold"]
    assert family.end.reason == "d = -5e-08 again, on another sheet"
    assert {point.family for point in family} == {10}
    for point in family[-8:]:
        assert share_of_error(5, 10, point.value, point.alpha, point.error) < 1
        assert point.error < 1e-11 * point.alpha


@pytest.mark.slow
def test_a_family_goes_on_until_rounding_decides():
    """Along a septic spring with two barriers, which a motion passes one after the other; 40 digits are the truth."""
    machine = Hopper("r + d*r**7", rest_length=90.0, parameters={"d": 1e-3})
    family = follow(machine, "d", -0.1, at=[-3e-9, -1e-9])
    assert family.end.kind == "escaped"
    assert family[-1].alpha > 23.5
    point = family.at(-3e-9)[-1]  # beyond the fold
    assert point.alpha == pytest.approx(22.78203142, rel=1e-9)
    for each in (point, *family[-5:]):
        assert share_of_error(7, 1, each.value, each.alpha, each.error) < 1
        assert each.error < 1e-11


@pytest.mark.slow
@pytest.mark.posix
def test_memory_stays_flat_over_many_orbits():
    import resource

    def grown() -> float:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in range(4):
            assert len(follow(Hopper("cubic"), "beta", 5.0, 0.0, longest=0.004)) > 300
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before

    grown(), grown()  # with what is compiled on the way
    assert grown() < 2000  # kilobytes; the most that a process has had never falls
