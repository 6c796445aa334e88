"""Figures of oscillations."""

from orbits import find, follow
from problems import Hopper
from tests.free_machines import henon_heiles


def legend(axes):
    """The texts of the legend."""
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_families_in_one_figure():
    both = [{"y": 0.2, "duration": 6.3}, {"x": 0.1, "y'": 0.1, "duration": 6.3}]
    first, second = (follow(henon_heiles(), "energy", (0.05, 0.162), start=start, longest=0.5) for start in both)
    axes = second.plot(axes=first.plot())
    assert sorted(legend(axes)) == ["branch point", "flip", "oscillations", "oscillations", "unstable"]
    assert axes.get_xlabel() == "energy"
    assert axes.get_ylabel() == "frequency"


def test_what_is_no_motion_is_dashed():
    family = follow(Hopper(rest_length=30), "energy", (0.1, 3.0), longest=0.5)
    axes = family.plot("period", along="y1")
    assert legend(axes) == ["mode 1", "no motions", "contact pulls"]
    (mark,) = [line for line in axes.lines if line.get_label() == "contact pulls"]
    assert abs(mark.get_xdata()[0] - 1.0) < 1e-9  # where the spring carries the foot


def test_a_motion_over_its_period():
    orbit = find(henon_heiles(), at={"energy": 0.1}, start={"y": 0.2, "duration": 6.3})
    axes = orbit.plot()
    assert legend(axes) == ["x", "y"]
    assert axes.get_xlim()[1] == orbit.period
